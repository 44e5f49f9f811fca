"""One unit beyond what is proved, other campaigns, where they are looked for, and the checker's own limits."""

import hashlib
import json
import math
import shutil
from collections.abc import Callable
from fractions import Fraction as F
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import ExactCampaign, Refused, Unusable, check
from cpcal.checker.files import Budget
from cpcal.files.folders import CAMPAIGN_NAME
from cpcal.solver.certificate.float_rows import at_point, holding, stretchings
from tests.checker.second import agreed, encoded, told
from tests.checker.valid.exact_legs import in_fractions, parts

UP, DOWN = math.inf, -math.inf


def last_shown(shown: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """Neighbours, the first of which is not shown and the second is."""
    while math.nextafter(low, UP) < high:
        middle = (low + high) / 2
        low, high = (low, middle) if shown(middle) else (middle, high)
    return low, high


def with_eps(proof: Any, eps: float) -> list[dict[str, Any]]:
    """The point with another eps, and nothing said of a least one."""
    lines: list[dict[str, Any]] = proof.copy()
    lines[0]["hi"][-1] = max(2 * eps, proof.eps_hi).hex()
    claims = lines[proof.head]
    claims["cap"] = lines[0]["hi"][-1]
    claims.update(epsilon={"lo": "0x0p+0", "hi": eps.hex()}, enclosure=None)
    point = claims["point"]
    point["at"][-1] = eps.hex()
    if point["readings"] is not None:
        x = at_point([float.fromhex(v) for v in point["at"]])
        point["readings"] = stretchings(proof.problem, x, proof.problem.chosen)
    return lines[: proof.head + 1]


def test_eps_one_ulp_below_the_least_that_the_point_shows(verdict: Any, exact_proof: Any) -> None:
    """For exact readings that is the largest | ||v|| - (L + l) |; here it is found by bisection."""
    x = [F(v) for v in exact_proof.point]
    exact = ExactCampaign(exact_proof.folder / CAMPAIGN_NAME)
    rows = [in_fractions(exact.measurement(k, 1)) for k in range(len(exact))]

    def shown(eps: float) -> bool:
        pairs = (parts(m, "plain", x, [F(0)] * 7) for m in rows)
        return all((base - F(eps)) ** 2 <= square <= (base + F(eps)) ** 2 for square, base in pairs)

    low, high = last_shown(shown, 0.9 * exact_proof.eps_hi, 1.1 * exact_proof.eps_hi)
    assert exact_proof.eps_lo <= low
    assert verdict(with_eps(exact_proof, high), exact_proof.folder).claims.eps_hi == F(high)
    with pytest.raises(Refused, match="not proved that the point satisfies") as caught:
        verdict(with_eps(exact_proof, low), exact_proof.folder)
    assert caught.value.line == 2


def test_a_point_of_the_uncertain_campaign_that_fails_is_proved_to_fail(verdict: Any, uncertain_proof: Any) -> None:
    lines = with_eps(uncertain_proof, 0.5 * uncertain_proof.eps_hi)
    claims = lines[uncertain_proof.head]
    x = tuple(float.fromhex(v) for v in claims["point"]["at"])
    rows = [uncertain_proof.fails(k, x) for k in range(16)]
    at = at_point(x)
    signs = [holding(uncertain_proof.problem, at, k) for k in range(16)]
    bad = [k for k in range(16) if rows[k] is not None]
    good = [k for k in range(16) if signs[k] is not None]
    assert bad
    assert not set(bad) & set(good)
    claims["epsilon"]["hi"] = None
    claims["point"].update(holds=good, readings=[signs[k] for k in good], fails=[[*rows[k]] for k in bad])
    point = verdict(lines, uncertain_proof.folder).claims.point
    assert (point.holds, point.fails) == (tuple(good), tuple(bad))
    for k in set(range(16)) - set(bad):
        claims["point"].update(holds=[], readings=None, fails=[[*rows[bad[0]][:1], k, *rows[bad[0]][2:]]])
        with pytest.raises(Refused, match="not proved that the point fails"):
            verdict(lines, uncertain_proof.folder)


def test_a_leg_shorter_than_eps(verdict: Any, exact_proof: Any) -> None:
    """With eps a little larger than the shortest leg all squares are in order; the leg itself is not."""
    rows = ExactCampaign(exact_proof.folder / CAMPAIGN_NAME)
    shortest = min(float(in_fractions(rows.measurement(k, 1)).length) for k in range(len(rows))) + exact_proof.point[6]
    below, above = with_eps(exact_proof, 0.99 * shortest), with_eps(exact_proof, 1.01 * shortest)
    assert verdict(below, exact_proof.folder).claims.eps_hi == F(0.99 * shortest)
    with pytest.raises(Refused, match="not proved that the point satisfies"):
        verdict(above, exact_proof.folder)


# the campaign ---------------------------------------------------------------------------------------------------


@pytest.fixture
def moved_campaign(tmp_path: Path, exact_proof: Any) -> Path:
    folder = tmp_path / "other"
    shutil.copytree(exact_proof.folder, folder)
    return folder


def rewritten(folder: Path, change: Callable[[list[list[Any]]], None]) -> str:
    """The digest of the campaign after a change of its measurements."""
    data = json.loads((folder / CAMPAIGN_NAME).read_text())
    change(data["measurements"])
    (folder / CAMPAIGN_NAME).write_text(json.dumps(data))
    return hashlib.sha256((folder / CAMPAIGN_NAME).read_bytes()).hexdigest()


def test_a_campaign_changed_after_the_fact(verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    """A byte more, or a digit less, and the digest is another one."""
    file = moved_campaign / CAMPAIGN_NAME
    content = file.read_bytes()
    digit = max(content.rfind(d) for d in b"123456789")
    for changed in (content + b"\n", content[:digit] + b"0" + content[digit + 1 :]):
        file.write_bytes(changed)
        with pytest.raises(Refused, match="SHA-256") as caught:
            verdict(exact_proof.lines, moved_campaign)
        assert caught.value.line == 1


CELLS: list[tuple[int, Any, str]] = [
    (5, "0", "no rotation"), (5, "nan", "no decimal"), (9, "inf", "no decimal"), (9, "", "no decimal"),
    (2, "1e999", "too large"), (2, "9" * 40, "no decimal"), (3, "one", "no decimal"),
    (3, "0x1p+0", "no decimal"), (3, " 1", "no decimal"), (3, "1_0", "no decimal"), (3, "\uff11", "no decimal"),
    (3, 1, "no decimal"), (3, True, "no decimal"), (3, None, "no decimal"), (3, ["1"], "no decimal"),
    (15, "-1.0", "negative half-width"), (18, "-1e-300", "negative half-width"),
    (21, "-1.0", "negative half-width"),
]  # fmt: skip


@pytest.mark.parametrize(("column", "cell", "reason"), CELLS)
def test_a_row_that_is_none(column, cell, reason, verdict, exact_proof, moved_campaign, second):
    def change(rows: list[list[Any]]) -> None:
        for row in rows:
            row[column] = cell
            if reason == "no rotation":
                row[6:9] = "000"

    lines = exact_proof.copy()
    lines[0]["campaign"] = rewritten(moved_campaign, change)
    with pytest.raises(Refused, match=reason) as caught:
        verdict(lines, moved_campaign)
    both_refuse(caught.value, second, lines, moved_campaign)


def both_refuse(refused: Refused, second: Any, lines: list[dict[str, Any]], folder: Path) -> None:
    """The campaign, in no line of the certificate."""
    first = told(refused, b"")
    assert first == {"line": 0, "code": "campaign"}
    if second is not None:
        assert agreed(first, second(encoded(lines), folder))


OTHERS: dict[str, Callable[[dict[str, Any]], object]] = {
    "another format": lambda d: d.update(format="cpcal-campaign-exact/2"),
    "nested too deeply": lambda d: d.update(provenance=json.loads("[" * 29 + "]" * 29)),
    "no format": lambda d: d.pop("format"),
    "an unknown key": lambda d: d.update(note="trust me"),
    "no robot": lambda d: d.pop("robot"),
    "no measurements": lambda d: d.update(measurements=[]),
    "measurements in an object": lambda d: d.update(measurements={}),
    "a row too short": lambda d: d["measurements"][3].pop(),
    "a row too long": lambda d: d["measurements"][3].append("0"),
    "all rows shorter": lambda d: [row.pop() for row in d["measurements"]],
    "a row that is a text": lambda d: d["measurements"].append("row"),
    "a pose and a run twice": lambda d: d["measurements"][3].__setitem__(slice(2), d["measurements"][5][:2]),
    "a name twice by its sign /": lambda d: [
        row.__setitem__(slice(2), name)
        for row, name in zip(d["measurements"], (["a", "b/c"], ["a/b", "c"]))  # noqa: B905
    ],
    "rows of nothing": lambda d: d.update(measurements=[[], []]),
}
CONTENTS = {
    "a float": b'{"measurements": 1.5}', "an infinite float": b'{"measurements": 1e999}',
    "a long integer": b'{"measurements": ' + b"9" * 5000 + b"}", "a key twice": b'{"format": 1, "format": 1}',
    "NaN": b'{"measurements": NaN}', "not UTF-8": b'{"\xff": 1}', "a byte order mark": b"\xef\xbb\xbf{}",
    "nothing": b"",
}  # fmt: skip


@pytest.mark.parametrize("name", [*OTHERS, *CONTENTS])
def test_files_that_are_no_campaign(name, verdict, exact_proof, moved_campaign, second):
    data, lines = json.loads((moved_campaign / CAMPAIGN_NAME).read_text()), exact_proof.copy()
    OTHERS.get(name, len)(data)
    content = CONTENTS.get(name, json.dumps(data).encode())
    (moved_campaign / CAMPAIGN_NAME).write_bytes(content)
    lines[0]["campaign"] = hashlib.sha256(content).hexdigest()
    with pytest.raises(Refused, match=r"campaign\.json") as caught:
        verdict(lines, moved_campaign)
    both_refuse(caught.value, second, lines, moved_campaign)


def test_the_campaign_beside_a_certificate_is_found(tmp_path: Path, exact_proof: Any) -> None:
    """By its digest, among others."""
    path = tmp_path / "leg1.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in exact_proof.lines))
    data = (exact_proof.folder / CAMPAIGN_NAME).read_bytes()
    own = tmp_path / f"{sha256(data).hexdigest()[:12]}.{CAMPAIGN_NAME}"
    own.write_bytes(data)
    (tmp_path / CAMPAIGN_NAME).write_bytes(data + b"\n")
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
    path, campaign = tmp_path / "c.jsonl", uncertain_proof.folder / CAMPAIGN_NAME
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
