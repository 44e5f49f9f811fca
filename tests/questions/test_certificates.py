"""certify writes certificates: they prove exactly what the result says."""

from collections.abc import Callable
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

import cpcal
from cpcal.checker import Accepted, check, check_run
from cpcal.questions import save_result

SMALL: dict[str, Any] = {"seed": 1, "extremal": False, "random_poses": 16}
Asked = Callable[..., tuple[cpcal.LegResult, Path]]


@pytest.fixture
def asked(tmp_path: Path) -> Asked:
    """Simulate, save, certify leg 1 with certificates; the leg as result.json says it, and the run."""

    def ask(sim: dict[str, Any], **options: Any) -> tuple[cpcal.LegResult, Path]:
        cpcal.save_campaign(cpcal.simulate(**sim), tmp_path / "campaign")
        run = tmp_path / "run"
        campaign = cpcal.load_campaign(tmp_path / "campaign")
        result = cpcal.certify(campaign, **({"legs": [1], "certificates": run, "delta": 2.0} | options))
        save_result(result, run, campaign)
        return cpcal.load_result(run).legs[0], run

    return ask


def accepted(run: Path, name: str | None) -> Accepted:
    assert name is not None
    (leg,) = check_run(run)
    assert leg.refused is None
    found = check(run / name)
    assert found == leg.accepted
    return found


def agrees(leg: cpcal.LegResult, found: Accepted) -> None:
    """The bracket, the point and the enclosure of the result, bit by bit."""
    claims = found.claims
    assert (found.leg, found.chosen) == (leg.leg, tuple(range(found.count)))
    assert claims.eps_lo == F(leg.bracket.lo)
    assert claims.eps_hi == claims.cap == F(leg.bracket.hi)
    assert claims.point is not None
    assert leg.bracket.point is not None
    assert claims.point.at == (*map(F, leg.bracket.point), F(leg.bracket.hi))
    assert claims.point.holds == found.chosen
    assert claims.enclosure is not None
    for side, values in zip(claims.enclosure, (leg.bracket.enclosure.lo, leg.bracket.enclosure.hi), strict=True):
        assert side[:-1] == tuple(F(float(v)) for v in values)
    for a, b, c, d in zip(found.lo, *claims.enclosure, found.hi, strict=True):
        assert a <= b <= c <= d


@pytest.mark.parametrize(
    ("joint_error", "factor", "model"),
    [(10.0, 0.0, "plain"), (10.0, 3.0, "plain"), (0.0, 3.0, "plain"), (10.0, 3.0, "gain"), (10.0, 3.0, "lateral")],
)
def test_the_certificate_says_what_the_result_says(asked: Asked, joint_error: float, factor: float, model: str) -> None:
    leg, run = asked(SMALL | {"joint_error": joint_error, "factor": factor}, model=model)
    assert leg.bracket.certificate == "leg1.cert.jsonl"
    found = accepted(run, leg.bracket.certificate)
    agrees(leg, found)
    assert (found.model, found.unknowns) == (model, (*leg.bracket.enclosure.names, "eps"))
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    assert (leg.bracket.lo == 0.0) == (joint_error == 0.0)


def test_the_same_bytes_twice_and_for_one_leg_or_more(tmp_path: Path) -> None:
    cpcal.save_campaign(cpcal.simulate(**SMALL, joint_error=10.0, factor=0.0), tmp_path / "campaign")
    campaign = cpcal.load_campaign(tmp_path / "campaign")

    def written(name: str, legs: list[int]) -> dict[str, bytes]:
        cpcal.certify(campaign, legs=legs, delta=2.0, certificates=tmp_path / name)
        return {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}

    both = written("both", [1, 2])
    of = {k: {f"leg{k}{kind}.cert.jsonl" for kind in ("", ".passes", ".recommended")} for k in (1, 2)}
    assert set(both) == {"campaign.json", *of[1], *of[2]}
    assert written("again", [1, 2]) == both
    kept = {"campaign.json": both["campaign.json"]}
    assert written("one", [2]) == kept | {name: both[name] for name in of[2]}
    # an earlier run's certificates do not stay
    assert written("both", [1]) == kept | {name: both[name] for name in of[1]}
