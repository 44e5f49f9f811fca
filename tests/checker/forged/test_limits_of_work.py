"""Where the campaign of a certificate is looked for, and how much work the checker takes on."""

import json
from fractions import Fraction as F
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Refused, Unusable, check
from cpcal.checker.files import Budget
from cpcal.files.folders import NAME


def test_the_campaign_beside_a_certificate_is_found(tmp_path: Path, exact_proof: Any) -> None:
    """By its digest, among others."""
    path = tmp_path / "leg1.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in exact_proof.lines))
    data = (exact_proof.folder / NAME).read_bytes()
    own = tmp_path / f"{sha256(data).hexdigest()[:12]}.{NAME}"
    own.write_bytes(data)
    (tmp_path / NAME).write_bytes(data + b"\n")
    assert check(path).claims.eps_lo == F(exact_proof.eps_lo)
    own.unlink()
    with pytest.raises(Refused, match="SHA-256"):
        check(path)


# limits of the checker, here so low that they are reached -----------------------------------------------------------


def test_too_many_open_boxes(verdict: Any, network_proof: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cpcal.checker.certificate._MOST_OPEN", 5)
    lines = network_proof.copy()[:-1]
    lines[-1].update(epsilon=None, enclosure=None)
    cut = lines[0]["lo"][0]
    for n in range(5):
        lines.append({"split": 2 * n, "unknown": 0, "at": cut, "into": [2 * n + 1, 2 * n + 2]})
    assert verdict(lines[:-1], None).steps == 4
    with pytest.raises(Refused, match="too many boxes") as caught:
        verdict(lines, None)
    assert caught.value.line == len(lines)


def test_too_much_work(tmp_path: Path, network_proof: Any) -> None:
    """It is counted as the check goes on, and the refusal names the line where it is used up."""
    lines, path = network_proof.copy(), tmp_path / "c.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    low, high = 0, 1 << 23
    while high - low > 1:
        middle = (low + high) // 2
        try:
            check(path, work=middle)
            high = middle
        except Refused as refused:
            assert "work" in refused.reason  # noqa: PT017
            low = middle
    idle = {"pass": 0, "cap": lines[-1]["cap"], "rows": [], "bounds": []}
    path.write_text("".join(json.dumps(line) + "\n" for line in [*lines, idle]))
    with pytest.raises(Refused, match="more work than") as caught:
        check(path, work=high)
    assert caught.value.line == len(lines) + 1


def test_a_step_of_two_certificates_costs_once(tmp_path, uncertain_proof, monkeypatch):
    """If it is the same to the last byte, from the same box, about the same leg; another one is checked."""
    path, campaign = tmp_path / "c.jsonl", uncertain_proof.folder / NAME
    budget, spent = Budget(1 << 40), []
    monkeypatch.setattr("cpcal.checker.certificate._LONG_LINE", 0)
    monkeypatch.setattr("cpcal.checker.certificate._LONG_STEP", 1000)

    def checked(lines: list[Any]) -> Any:
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))
        before = budget.left
        try:
            return check(path, campaign, work=budget)
        finally:
            spent.append(before - budget.left)

    assert checked(uncertain_proof.lines) == checked(uncertain_proof.lines)
    assert 2 * spent[1] < spent[0]
    wider = uncertain_proof.copy()
    for side, less in (("lo", "-0x1p-20"), ("hi", "0x1p-20")):
        wider[0][side][0] = float.hex(float.fromhex(wider[0][side][0]) + float.fromhex(less))
    with pytest.raises(Refused, match="prove less"):
        checked(wider)
    assert 2 * spent[2] > spent[0]
    less = uncertain_proof.copy()
    next(line for line in less if "bounds" in line)["bounds"][0][3]["rows"] = []
    with pytest.raises(Refused, match="prove less"):
        checked(less)


def test_too_many_terms(verdict: Any, network_proof: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = network_proof.lines
    terms = [sum(len(c[p] or []) for p in ("body", "at_least", "at_most")) for c in lines[1 : network_proof.head]]
    monkeypatch.setattr("cpcal.checker.certificate._MOST_TERMS", sum(terms))
    verdict(lines, None)
    monkeypatch.setattr("cpcal.checker.certificate._MOST_TERMS", sum(terms) - 1)
    with pytest.raises(Refused, match="terms") as caught:
        verdict(lines, None)
    assert caught.value.line == network_proof.head


def test_too_many_unknowns(verdict: Any, tmp_path: Path) -> None:
    """So that open boxes stay small."""
    many = 1001
    header = {"format": "cpcal-certificate/6", "about": "", "unknowns": [f"x{k}" for k in range(many)], "objective": 0}
    box = {"constraints": 0, "lo": ["0x0p+0"] * many, "hi": ["0x1p+0"] * many}
    with pytest.raises(Refused, match="unknowns") as caught:
        verdict([header | box], tmp_path)
    assert caught.value.line == 1


def test_an_enclosure_that_leaves_out_the_objective(verdict: Any, exact_proof: Any) -> None:
    lines = exact_proof.copy()
    lines[1]["enclosure"]["lo"][7] = lines[1]["cap"]
    with pytest.raises(Refused, match="reaches out"):
        verdict(lines, exact_proof.folder)


def test_no_campaign(verdict: Any, exact_proof: Any, tmp_path: Path) -> None:
    for folder in (tmp_path / "nowhere", None):
        with pytest.raises(Unusable, match="cannot be read"):
            verdict(exact_proof.lines, folder)
