"""One unit in the last place beyond what is proved, other campaigns, and the checker's own limits."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker.campaign import ExactCampaign
from cpcal.checker.refusal import Refused

UP, DOWN = math.inf, -math.inf


def moved(text: str, towards: float) -> str:
    return math.nextafter(float.fromhex(text), towards).hex()


def length(m: Any, x: list[F]) -> F:
    """||v||^2 at the centre of the set, with the rotation in cross products."""
    w, *q = m.quaternion
    scale = w * w + sum((c * c for c in q), F(0))
    b = x[3:6]
    t = [2 * (q[1] * b[2] - q[2] * b[1]), 2 * (q[2] * b[0] - q[0] * b[2]), 2 * (q[0] * b[1] - q[1] * b[0])]
    u = [q[1] * t[2] - q[2] * t[1], q[2] * t[0] - q[0] * t[2], q[0] * t[1] - q[1] * t[0]]
    v = [m.position[i] + b[i] + (w * t[i] + u[i]) / scale - x[i] for i in range(3)]
    return sum((c * c for c in v), F(0))


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
    claims["point"]["at"][-1] = eps.hex()
    return lines[: proof.head + 1]


@pytest.mark.parametrize("name", ["exact_proof", "uncertain_proof", "network_proof"])
def test_bounds_one_ulp_beyond_the_proof(name: str, request: pytest.FixtureRequest, verdict: Any) -> None:
    """The bound that is written is the last float64 that is proved; the next one is refused."""
    proof = request.getfixturevalue(name)
    for n in range(3):
        lines = proof.copy()
        entry = lines[-1]["bounds"][n]
        entry[2] = moved(entry[2], UP if entry[1] == "lo" else DOWN)
        with pytest.raises(Refused, match="prove less") as caught:
            verdict(lines, proof.folder)
        assert caught.value.line == len(lines)


def test_eps_one_ulp_below_the_least_that_the_point_shows(verdict: Any, exact_proof: Any) -> None:
    """For exact readings that is the largest | ||v|| - (L + l) |; here it is found by bisection."""
    x = [F(v) for v in exact_proof.point]
    exact = ExactCampaign(exact_proof.folder, 1)
    rows = [exact.measurement(k) for k in range(len(exact))]

    def shown(eps: float) -> bool:
        return all((m.length + x[6] - F(eps)) ** 2 <= length(m, x) <= (m.length + x[6] + F(eps)) ** 2 for m in rows)

    low, high = last_shown(shown, 0.9 * exact_proof.eps_hi, 1.1 * exact_proof.eps_hi)
    assert exact_proof.eps_lo <= low
    assert verdict(with_eps(exact_proof, high), exact_proof.folder).claims.eps_hi == F(high)
    with pytest.raises(Refused, match="not proved that the point satisfies") as caught:
        verdict(with_eps(exact_proof, low), exact_proof.folder)
    assert caught.value.line == 2


def test_a_reading_would_have_to_be_outside_its_set(verdict: Any, uncertain_proof: Any) -> None:
    """With 99 in 100 of eps_hi the readings that solve it are a little outside their sets."""
    assert verdict(with_eps(uncertain_proof, uncertain_proof.eps_hi), uncertain_proof.folder).claims.point is not None
    with pytest.raises(Refused, match="not proved that the point satisfies"):
        verdict(with_eps(uncertain_proof, 0.99 * uncertain_proof.eps_hi), uncertain_proof.folder)


def test_a_point_of_the_uncertain_campaign_that_fails_is_proved_to_fail(verdict: Any, uncertain_proof: Any) -> None:
    lines = with_eps(uncertain_proof, 0.5 * uncertain_proof.eps_hi)
    claims = lines[uncertain_proof.head]
    x = tuple(float.fromhex(v) for v in claims["point"]["at"])
    bad = [k for k in range(16) if uncertain_proof.problem.fails(k, tuple(map(F, x)))]
    good = [k for k in range(16) if uncertain_proof.problem.holds(k, tuple(map(F, x)))]
    assert bad
    assert not set(bad) & set(good)
    claims["epsilon"]["hi"] = None
    claims["point"].update(holds=good, fails=bad)
    point = verdict(lines, uncertain_proof.folder).claims.point
    assert (point.holds, point.fails) == (tuple(good), tuple(bad))
    for k in set(range(16)) - set(bad):
        claims["point"].update(holds=[], fails=[k])
        with pytest.raises(Refused, match="not proved that the point fails"):
            verdict(lines, uncertain_proof.folder)


def test_a_leg_shorter_than_eps(verdict: Any, exact_proof: Any) -> None:
    """With eps a little larger than the shortest leg all squares are in order; the leg itself is not."""
    rows = ExactCampaign(exact_proof.folder, 1)
    shortest = min(float(rows.measurement(k).length) for k in range(len(rows))) + exact_proof.point[6]
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


def rewritten(folder: Path, change: Callable[[dict[str, str]], None], rows: slice = slice(None)) -> str:
    """The digest of the campaign with some rows changed."""
    file = folder / "measurements.csv"
    names, *cells = [row.split(",") for row in file.read_text().splitlines()]
    found = [dict(zip(names, row, strict=True)) for row in cells]
    for row in found[rows]:
        change(row)
    file.write_text("\n".join(",".join(row.values()) for row in [dict(zip(names, names, strict=True)), *found]) + "\n")
    return ExactCampaign(folder, 1).sha256


@pytest.mark.parametrize("name", ["campaign.toml", "measurements.csv"])
def test_a_campaign_changed_after_the_fact(name: str, verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    file = moved_campaign / name
    content = file.read_bytes()
    file.write_bytes(content + b"\n")
    with pytest.raises(Refused, match="SHA-256") as caught:
        verdict(exact_proof.lines, moved_campaign)
    assert caught.value.line == 1
    digit = max(content.rfind(d) for d in b"123456789")
    file.write_bytes(content[:digit] + b"0" + content[digit + 1 :])
    with pytest.raises(Refused, match="SHA-256"):
        verdict(exact_proof.lines, moved_campaign)


def test_another_campaign_with_its_own_digest(verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    """The digest is put right again; the proof is not."""

    def longer(row: dict[str, str]) -> None:
        row["L1"] = repr(float(row["L1"]) + 1.0)

    lines = exact_proof.copy()
    lines[0]["campaign"] = rewritten(moved_campaign, longer, slice(1))
    with pytest.raises(Refused, match="point satisfies measurement 0"):
        verdict(lines, moved_campaign)
    lines[1]["point"] = lines[1]["epsilon"]["hi"] = None
    lines[2]["bounds"] = [e for e in lines[2]["bounds"] if e[0] == 7]
    assert 0 in {k for _, k, _ in lines[2]["bounds"][0][3]["rows"]}
    with pytest.raises(Refused):
        verdict(lines, moved_campaign)


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        ({"qw": "0", "qx": "0", "qy": "0", "qz": "0"}, "no rotation"),
        ({"qw": "nan"}, "cannot be read"),
        ({"L1": "inf"}, "cannot be read"),
        ({"L1": ""}, "cannot be read"),
        ({"x": "1e999"}, "cannot be read"),
        ({"y": "one"}, "cannot be read"),
    ],
)
def test_a_row_that_is_none(
    cells: dict[str, str], reason: str, verdict: Any, exact_proof: Any, moved_campaign: Path
) -> None:
    lines = exact_proof.copy()
    lines[0]["campaign"] = rewritten(moved_campaign, lambda row: row.update(cells))
    with pytest.raises(Refused, match=reason) as caught:
        verdict(lines, moved_campaign)
    assert caught.value.line == 0


def test_a_negative_half_width(verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    file = moved_campaign / "measurements.csv"
    first, *rows = file.read_text().splitlines()
    file.write_text("\n".join([first + ",dx", *(row + ",-1.0" for row in rows)]) + "\n")
    lines = exact_proof.copy()
    lines[0]["campaign"] = ExactCampaign(moved_campaign, 1).sha256
    with pytest.raises(Refused, match="negative half-width"):
        verdict(lines, moved_campaign)


def test_no_campaign(verdict: Any, exact_proof: Any, tmp_path: Path) -> None:
    with pytest.raises(Refused, match="cannot be read"):
        verdict(exact_proof.lines, tmp_path / "nowhere")
    with pytest.raises(Refused, match="is needed"):
        verdict(exact_proof.lines, None)


# limits of the checker, here so low that they are reached -----------------------------------------------------------


def test_too_many_open_boxes(verdict: Any, network_proof: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cpcal.checker.checker._MOST_OPEN", 5)
    lines = network_proof.copy()[:-1]
    lines[-1].update(epsilon=None, enclosure=None)
    cut = lines[0]["lo"][0]
    for n in range(5):
        lines.append({"split": 2 * n, "unknown": 0, "at": cut, "into": [2 * n + 1, 2 * n + 2]})
    assert verdict(lines[:-1], None).steps == 4
    with pytest.raises(Refused, match="too many boxes") as caught:
        verdict(lines, None)
    assert caught.value.line == len(lines)


def test_too_many_steps(verdict: Any, network_proof: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cpcal.checker.checker._MOST_STEPS", 3)
    lines = network_proof.copy()
    idle = {"pass": 0, "cap": lines[-1]["cap"], "bounds": []}
    assert verdict([*lines, idle, idle], None).steps == 3
    with pytest.raises(Refused, match="more than 3 steps") as caught:
        verdict([*lines, idle, idle, idle], None)
    assert caught.value.line == len(lines) + 3


def test_too_many_terms(verdict: Any, network_proof: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = network_proof.lines
    terms = [sum(len(c[p] or []) for p in ("body", "at_least", "at_most")) for c in lines[1 : network_proof.head]]
    monkeypatch.setattr("cpcal.checker.constraints._MOST_TERMS", sum(terms))
    verdict(lines, None)
    monkeypatch.setattr("cpcal.checker.constraints._MOST_TERMS", sum(terms) - 1)
    with pytest.raises(Refused, match="terms") as caught:
        verdict(lines, None)
    assert caught.value.line == network_proof.head


def test_claims_about_no_measurements(verdict: Any, exact_proof: Any) -> None:
    lines = exact_proof.copy()
    lines[0]["only"] = []
    with pytest.raises(Refused, match="no measurements"):
        verdict(lines, exact_proof.folder)


def test_too_many_unknowns(verdict: Any, tmp_path: Path) -> None:
    """So that open boxes stay small."""
    from cpcal.checker.constraints import MOST_UNKNOWNS

    many = MOST_UNKNOWNS + 1
    header = {"format": "cpcal-certificate/3", "about": "", "unknowns": [f"x{k}" for k in range(many)], "objective": 0}
    box = {"constraints": 0, "lo": ["0x0p+0"] * many, "hi": ["0x1p+0"] * many}
    with pytest.raises(Refused, match="unknowns") as caught:
        verdict([header | box], tmp_path)
    assert caught.value.line == 1


def test_an_enclosure_that_leaves_out_the_objective(verdict: Any, exact_proof: Any) -> None:
    lines = exact_proof.copy()
    lines[1]["enclosure"]["lo"][7] = lines[1]["cap"]
    with pytest.raises(Refused, match="reaches out"):
        verdict(lines, exact_proof.folder)
