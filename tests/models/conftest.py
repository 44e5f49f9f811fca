"""Runs are verified many times, each edited: what was accepted of the same bytes is not judged again."""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cpcal.checker import Refused
from cpcal.checker.hand_eye import HandEyeCertificates, check_hand_eye
from cpcal.common.values import Floats
from cpcal.models.hand_eye import CAMERA, HandEyeFrames, HandEyeStudy, study_json, study_of_board
from cpcal.models.hand_eye_fit import classical_answer
from cpcal.questions import hand_eye
from cpcal.robot import Pose, compose, inverse, normalised, quaternion_from_rotation_vector, quaternion_product
from tests.models.known_robot import known

__all__ = ["known"]


def unknowns_of(frames: HandEyeFrames) -> Floats:
    """(24,): R and t of both frames, as users want them."""
    x = frames.e_rotation.T
    return np.concatenate([x.ravel(), -x @ frames.e_translation, frames.f_rotation.ravel(), frames.f_translation])


def cart(seed: int, images: int = 12, tilt: float = 0.0) -> tuple[HandEyeStudy, HandEyeFrames]:
    """A camera on a cart that turns about the height alone, but for a tilt (rad): no pixel tells how high it is."""
    random = np.random.default_rng(seed)
    facing = normalised(np.array([0.5, -0.5, 0.5, -0.5]))
    camera = Pose(np.array([100.0, 20.0, 300.0]), facing)
    board = np.array([[x, y, 0.0] for x in (-100.0, -30.0, 30.0, 100.0) for y in (-70.0, 0.0, 70.0)])
    leaning = quaternion_from_rotation_vector(np.array([0.1, 0.3, 0.05]))
    target = Pose(np.array([1500.0, 50.0, 350.0]), quaternion_product(facing, leaning))
    turns = random.uniform(-1.0, 1.0, (images, 3)) * [tilt, tilt, 0.35]
    where = random.uniform([400.0, -150.0, 0.0], [800.0, 150.0, 0.0], (images, 3))
    hand, e = Pose(where, quaternion_from_rotation_vector(turns)), inverse(camera)
    seen = compose(compose(e, inverse(hand)), target)
    names = tuple(f"i{k}" for k in range(images))
    exact = study_of_board(hand, seen, board, setup="eye-in-hand", camera=CAMERA, images=names)
    study = replace(exact, pixels=exact.pixels + random.uniform(-0.1, 0.1, exact.pixels.shape))
    return study, HandEyeFrames(e.rotation, e.position, target.rotation, target.position)


def statements_of(run: Path) -> list[tuple[bool, str]]:
    """Of `cpcal verify`, in this process."""
    return [*check_hand_eye(run), hand_eye.verify_center(run)]


def bytes_of(folder: Path, name: Any, seen: tuple[Any, ...] = ()) -> Any:
    """Digests of a certificate and of all that it rests on; of the whole folder where it does not say what that is."""
    try:
        given = (folder / name).read_bytes()
        header = json.loads(given.splitlines()[0])
        rests = [one for one in (header["after"], *header["poses"]) if one is not None]
        if name not in seen:
            return sha256(given).digest(), [bytes_of(folder, one, (*seen, name)) for one in rests]
    except (OSError, ValueError, TypeError, KeyError, IndexError):
        pass
    return [(path.name, sha256(path.read_bytes()).digest()) for path in sorted(folder.glob("*.cert.jsonl"))]


@pytest.fixture(scope="package", autouse=True)
def judged_once() -> Iterator[None]:
    """Certificates that rest on the same bytes, and least squares of the same study."""
    claims: dict[object, Any] = {}
    answers: dict[object, Any] = {}
    accepted, answer = HandEyeCertificates.accepted, classical_answer

    def remembered(self: HandEyeCertificates, name: Any) -> Any:
        key = repr((name, self.digest, bytes_of(self.folder, name)))
        if key not in claims:
            held, self.known = self.known, {file: one for file, one in self.known.items() if isinstance(one, Refused)}
            accepted(self, name)
            claims[key] = {file: one for file, one in self.known.items() if not isinstance(one, Refused)}
            self.known = held | self.known
        self.known.update(claims[key])
        return self.known[name]

    def answered(study: HandEyeStudy) -> Any:
        key = study_json(study), study.known
        if key not in answers:
            answers[key] = answer(study)
        return answers[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(HandEyeCertificates, "accepted", remembered)
        patch.setattr(hand_eye, "classical_answer", answered)
        yield


@pytest.fixture
def refused(tmp_path: Path) -> Callable[..., None]:
    """Fails unless a run (a folder) is refused in the sentence that begins with `what` and holds `reason`, when
    `change` was made to the data of a JSON file, or to the text of another."""

    def judge(run: Path, name: str, change: Callable[[Any], Any], what: str, reason: str) -> None:
        shutil.copytree(run, tmp_path / "run")
        path = tmp_path / "run" / name
        if path.suffix == ".json":
            data = json.loads(path.read_text())
            change(data)
            path.write_text(json.dumps(data))
        else:
            path.write_text(change(path.read_text()))
        found = {sentence.split(":")[0]: (ok, sentence) for ok, sentence in statements_of(tmp_path / "run")}
        accepted, sentence = found[what]
        assert not accepted, found
        assert re.search(f"REFUSED, .*{reason}", sentence), found

    return judge
