"""The checker of pages, in JavaScript: it accepts and refuses what the one in Python does, where and why it does.

It was written from docs/certificate-format.md alone.
"""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Refused
from tests.checker.conftest import KINDS
from tests.checker.forged import forged_claims, forged_steps, forged_values
from tests.checker.forged.forging import FORGERIES, PROOFS

mini_racer = pytest.importorskip("py_mini_racer", reason="mini-racer is not installed (pip install 'cpcal[test]')")

assert all((forged_claims, forged_steps, forged_values))  # to load them fills FORGERIES
CASES = [(name, kind) for name, (_, kinds) in FORGERIES.items() for kind in kinds]
DRIVER = """
const bytesOf = text => Uint8Array.from(text, c => c.charCodeAt(0));
function told(certificate, campaign, sha256) {
  try {
    const known = campaign === null ? null : readCampaign(bytesOf(campaign), sha256);
    const {claims, steps} = checkCertificate(bytesOf(certificate), known);
    return {steps, infeasible: claims.infeasible, eps: claims.epsilon !== null, point: claims.point !== null};
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return {line: error.line, code: error.code, message: error.message};
  }
}
"""
Second = Callable[[bytes, Path | None], dict[str, Any]]


@pytest.fixture(scope="module")
def second() -> Second:
    engine = mini_racer.MiniRacer()
    engine.eval((files("cpcal.report") / "browser" / "checker.js").read_text())
    engine.eval(DRIVER)

    def told(content: bytes, folder: Path | None) -> dict[str, Any]:
        campaign = None if folder is None else (folder / "campaign.json").read_bytes()
        sha256 = None if campaign is None else hashlib.sha256(campaign).hexdigest()
        text = None if campaign is None else campaign.decode("latin-1")
        found: dict[str, Any] = engine.call("told", content.decode("latin-1"), text, sha256)
        return found

    return told


def encoded(lines: list[dict[str, Any]]) -> bytes:
    return b"".join(json.dumps(line).encode() + b"\n" for line in lines)


def verdict_of(checked: Any, content: bytes, folder: Path | None) -> dict[str, Any]:
    """Of the checker in Python, as the other one tells it."""
    try:
        accepted = checked(content, folder)
    except Refused as refused:
        return {"line": refused.line or 0, "code": refused.code}
    claims = accepted.claims
    told = {"infeasible": claims.infeasible, "eps": claims.eps_lo is not None, "point": claims.point is not None}
    return {**told, "steps": len(content.splitlines())}


def agree(checked: Any, second: Second, content: bytes, folder: Path | None) -> str:
    """The code of the refusal, or "" where both accept."""
    first, other = verdict_of(checked, content, folder), second(content, folder)
    other.pop("message", None)
    if "limit" in (first.get("code"), other.get("code")) and "line" in first and "line" in other:
        return "limit"
    assert other == first
    return str(first.get("code", ""))


@pytest.mark.parametrize("kind", KINDS)
def test_true_certificates_are_accepted(
    kind: str, request: pytest.FixtureRequest, checked: Any, second: Second
) -> None:
    proof = request.getfixturevalue(kind)
    assert agree(checked, second, encoded(proof.lines), proof.folder) == ""


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_forgeries_are_refused_alike(
    name: str, kind: str, request: pytest.FixtureRequest, checked: Any, second: Second
) -> None:
    proof = request.getfixturevalue(PROOFS[kind])
    lines = proof.copy()
    FORGERIES[name][0](lines, proof)
    assert agree(checked, second, encoded(lines), proof.folder)


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"\n", b"{}\n", b"[]\n", b"null\n", b"\xff\xfe{\n", b"\xef\xbb\xbf{}\n", b"\x00" * 100),
        *(b'{"format": NaN}\n', b'{"format": "\\ud800"}\n', b'{"format": 1.5}\n', b'{"format": 01}\n', b'{"a": 1,}\n'),
        *(b"[" * 100_000 + b"]" * 100_000, b'{"format": "cpcal-certificate/4"} {}\n', b'{"a": "\t"}\n'),
    ],
    ids=range(16),
)
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


def test_another_campaign_is_refused_alike(exact_proof: Any, checked: Any, second: Second, tmp_path: Path) -> None:
    text = (exact_proof.folder / "campaign.json").read_text()
    document = json.loads(text)
    broken = [
        text + " ",
        text.replace("cpcal-campaign-exact/1", "cpcal-campaign-exact/2"),
        "{}",
        text.replace('"', "", 1),
    ]
    document["measurements"][0][2] = "1e999"
    broken.append(json.dumps(document))
    document["measurements"][0][2] = "0x1"
    broken.append(json.dumps(document))
    for k, changed in enumerate(broken):
        folder = tmp_path / str(k)
        folder.mkdir()
        (folder / "campaign.json").write_text(changed)
        assert agree(checked, second, encoded(exact_proof.lines), folder) == "campaign"
