"""The checker of pages, in JavaScript: it accepts and refuses what the one in Python does, where and why it does.

It was written from docs/certificate-format.md alone. forged/test_forged.py asks both about every forgery.
"""

import random
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Refused
from cpcal.checker.leg import EXTRA
from cpcal.solver.certificate.exact_network import number
from tests.checker.conftest import KINDS, saved
from tests.checker.malformed.test_bytes import NO_CERTIFICATES
from tests.checker.second import Second, agreed, encoded, told

pytest.importorskip("py_mini_racer", reason="mini-racer is not installed (pip install 'cpcal[test]')")


def agree(checked: Any, second: Second, content: bytes, folder: Path | None) -> str:
    """The code of the refusal, or "" where both accept."""
    try:
        first = checked(content, folder)
    except Refused as refused:
        first = refused
    return agreed(told(first, content), second(content, folder))


@pytest.mark.parametrize("kind", KINDS)
def test_true_certificates_are_accepted(kind, request, checked, second):
    proof = request.getfixturevalue(kind)
    assert agree(checked, second, encoded(proof.lines), proof.folder) == ""


@pytest.mark.parametrize("content", NO_CERTIFICATES, ids=range(len(NO_CERTIFICATES)))
def test_what_is_no_certificate(content: bytes, exact_proof: Any, checked: Any, second: Second) -> None:
    assert agree(checked, second, content, exact_proof.folder)


def test_mutations_end_alike(short_proof: Any, checked: Any, second: Second) -> None:
    rng = random.Random(1)
    content = encoded(short_proof.lines)
    refused = 0
    for _ in range(150):
        at = rng.randrange(len(content))
        piece = bytes(rng.choice(b'0123456789abcdef-+.,:"[]{}px \n') for _ in range(rng.randrange(3)))
        refused += bool(
            agree(checked, second, content[:at] + piece + content[at + rng.randrange(3) :], short_proof.folder)
        )
    assert refused > 50


@pytest.mark.parametrize("model", EXTRA)
def test_both_ask_the_same_eps_of_a_point_for_all_readings(model, uncertain_proof, checked, second, tmp_path):
    """To the last of 50 bits, of sets so wide that what turns over within them counts: in the same exact numbers."""
    rng, folder = random.Random(model), tmp_path / "wide"
    saved(folder, joint_error=10.0, factor=300.0, extremal=False, random_poses=16)
    digest = sha256((folder / "campaign.json").read_bytes()).hexdigest()
    head = uncertain_proof.lines[0] | {"campaign": digest}
    for part in ("0x1p+0", "0x1.8p-1", "0x0p+0"):
        extra = [rng.uniform(-0.01, 0.01) for _ in EXTRA[model]]
        at = [v + rng.uniform(-0.5, 0.5) for v in uncertain_proof.point[:7]] + extra

        def claimed(eps: float, at: list[float] = at, part: str = part) -> bytes:
            x = [number(v) for v in (*at, eps)]
            point = {"at": x, "holds": "all", "readings": None, "factor": part, "fails": []}
            claims = {"cap": x[-1], "infeasible": False, "epsilon": None, "enclosure": None, "point": point}
            return encoded([{**head, "model": model, "lo": x, "hi": x}, claims])

        low, high = 0.0, 256.0
        while high - low > 2.0**-42:
            middle = (low + high) / 2
            try:
                checked(claimed(middle), folder)
                high = middle
            except Refused:
                low = middle
        assert 0.0 < low < high < 256.0
        assert agree(checked, second, claimed(high), folder) == ""
        assert agree(checked, second, claimed(low), folder) == "proof"
