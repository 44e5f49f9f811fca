"""Runs of the room are verified many times, each with something else edited: certificates are judged once."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Accepted, check
from cpcal.checker.files import Budget
from cpcal.handeye import verify as verify_hand_eye
from cpcal.handeye.chain import Chain
from cpcal.handeye.classical_answer import classical_answer
from cpcal.handeye.files import hand_eye_files
from cpcal.handeye.study import HandEyeStudy
from cpcal.solver.interval import Box
from tests.remembered import remembered

Verify = Callable[[Path], list[tuple[bool, str]]]


@pytest.fixture(scope="package", autouse=True)
def judged_once() -> Iterator[None]:
    """What was accepted of the same bytes is not judged again; what is refused is judged each time."""
    claims: dict[object, Any] = {}
    answers: dict[object, Any] = {}
    claimed, answer = verify_hand_eye._claimed, classical_answer

    def of_study(study: HandEyeStudy) -> bytes:
        return b"".join(hand_eye_files(study).values())

    def remembered_claim(run: Path, chain: Chain, study: HandEyeStudy, box: Box, *more: Any) -> Any:
        files = [path.read_bytes() for name in chain.certificates if (path := run / name).exists()]
        whole = chain, box.lo.tolist(), box.hi.tolist(), more[:-1], more[-1].most, of_study(study), files
        key = sha256(repr(whole).encode()).digest()
        if key not in claims:
            claims[key] = claimed(run, chain, study, box, *more)  # type: ignore[arg-type]
        return claims[key]

    def remembered_answer(study: HandEyeStudy) -> Any:
        key = of_study(study)
        if key not in answers:
            answers[key] = answer(study)
        return answers[key]

    known = remembered(check)

    def checked(path: Path, *, work: Budget) -> Accepted:
        return known(path) if path.is_file() else check(path, work=work)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verify_hand_eye, "check", checked)
        patch.setattr(verify_hand_eye, "_claimed", remembered_claim)
        patch.setattr(verify_hand_eye, "classical_answer", remembered_answer)
        yield


@pytest.fixture
def refused(tmp_path: Path) -> Callable[..., None]:
    """Fails unless a run (a folder) is refused in the sentence that begins with `what` and holds `reason`, when
    `change` was made to the data of a JSON file, or to the text of another."""

    def judge(run: Path, name: str, change: Callable[[Any], Any], verify: Verify, what: str, reason: str) -> None:
        shutil.copytree(run, tmp_path / "run")
        path = tmp_path / "run" / name
        if path.suffix == ".json":
            data = json.loads(path.read_text())
            change(data)
            path.write_text(json.dumps(data))
        else:
            path.write_text(change(path.read_text()))
        found = {sentence.split(":")[0]: (accepted, sentence) for accepted, sentence in verify(tmp_path / "run")}
        accepted, sentence = found[what]
        assert not accepted, found
        assert re.search(f"REFUSED, .*{reason}", sentence), found

    return judge
