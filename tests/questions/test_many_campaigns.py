"""certify on simulated campaigns: brackets, reading sets, deficient data, both arithmetics, questions about one eps."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cpcal import Box, Campaign, InputError, LegResult, PluginError, Result, Verdict, certify, simulate, status_of
from cpcal.common.values import Floats
from cpcal.models import model_residuals
from cpcal.questions import CampaignNote, Options
from cpcal.robot import rotation_matrix
from cpcal.simulate import true_robot
from cpcal.solver.optimize.bound import Alone, support


def without_sets(campaign: Campaign) -> Campaign:
    return Campaign.of(campaign.robot, campaign.position, campaign.quaternion, campaign.length, exact=True)


def part(campaign: Campaign, rows: Floats | list[int], *, exact: bool = False) -> Campaign:
    """Some measurements; a repeated one gets a run of its own."""
    radii = (
        {}
        if exact
        else {name: getattr(campaign, name)[rows] for name in ("position_radius", "rotation_radius", "length_radius")}
    )
    return Campaign.of(
        campaign.robot, campaign.position[rows], campaign.quaternion[rows], campaign.length[rows],
        run=[str(k) for k in range(len(rows))], exact=exact, **radii,
    )  # fmt: skip


def only(campaign: Campaign, leg: int = 1, **options: object) -> LegResult:
    return certify(campaign, legs=[leg], **options).legs[0]  # type: ignore[arg-type]


def status(leg: LegResult, **asked: Any) -> str:
    note = CampaignNote("0" * 64, "R", 64)
    return status_of(Result(campaign=note, options=Options(**asked), version="0", legs=(leg,)), leg)


@pytest.fixture(scope="module")
def bent() -> Campaign:
    """64 extremal poses, joint error 1 mm, reading sets of 3 sigma."""
    return simulate(seed=11, joint_error=1.0)


@pytest.fixture(scope="module")
def certified(bent: Campaign) -> LegResult:
    return only(bent)


@pytest.fixture(scope="module")
def exact(bent: Campaign) -> LegResult:
    """The same without the sets."""
    return only(without_sets(bent))


# exact readings ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("joint_error", "leg"), [(0.0, 2), (1.0, 1), (10.0, 3)])
def test_brackets_close_in_small_and_large_boxes_and_agree(joint_error: float, leg: int) -> None:
    campaign = without_sets(simulate(seed=3, joint_error=joint_error))
    near, far = only(campaign, leg, delta=100.0), only(campaign, leg, delta=1000.0)
    for found in (near, far):
        assert found.bracket.verdict is Verdict.PROVED
        assert 0.0 < found.bracket.lo <= found.bracket.hi <= found.bracket.lo * (1 + 1.01e-6)
        assert found.bracket.point is not None
        worst = np.abs(model_residuals(campaign, leg, found.bracket.point)).max()
        assert worst == pytest.approx(found.bracket.hi, rel=1e-9)
        assert found.bracket.point in found.bracket.enclosure
        assert found.support
        assert set(found.support) <= set(campaign.measurement_ids)
    least_squares = np.abs(model_residuals(campaign, leg, near.bracket.center)).max()
    assert near.bracket.hi < least_squares
    if (np.abs(np.subtract(far.bracket.point, near.bracket.center)) < 99.0).all():  # type: ignore[arg-type]
        assert near.bracket.lo <= far.bracket.hi
        assert far.bracket.lo <= near.bracket.hi
    assert far.bracket.lo <= near.bracket.hi  # the larger box holds the smaller one's optimum


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_the_support_alone_forces_the_bound(factor: float) -> None:
    campaign = simulate(seed=1, joint_error=1.0, factor=factor)
    found = only(campaign, 2)
    assert 0 < len(found.support) <= 20
    rows = [campaign.measurement_ids.index(name) for name in found.support]
    # the same box: the fit of the few would be elsewhere, so look wide around it
    alone = only(part(campaign, rows, exact=not factor), 2, delta=300.0, center="nominal", gap=1e-5)
    assert alone.bracket.lo == pytest.approx(found.bracket.lo, rel=1e-4)


def test_few_measurements_that_prove_less_are_no_support() -> None:
    """Those that say most at the best point join; where they prove less too, all with a weight are the support."""
    network, rows = SimpleNamespace(domain=Box(("eps",), [0.0], [2.0])), SimpleNamespace()
    rows.telling = lambda point, most: [np.array([3, 4])]
    problem: Any = SimpleNamespace(name="eps", network=network, rows=rows)
    found: Any = SimpleNamespace(lo=1.0, hi=1.0, interrupted=False, decisive_rows=((0, 3),), rows=((0, 3), (0, 5)))
    found.witness = SimpleNamespace(point=np.zeros(1))
    for enough, members in ((1, (3,)), (2, (3, 4)), (3, (3, 5))):
        alone = lambda some, _, enough=enough: Alone(1.0 if len(some) >= enough else 0.95, None, False)  # noqa: E731
        assert support(problem, found, 1e-6, alone) == members


# reading sets -----------------------------------------------------------------------------------------------


def sampled(campaign: Campaign, leg: int, x: Floats, rng: np.random.Generator, count: int = 100) -> Floats:
    """For every measurement the smallest |g(x, M)| over random readings M of its set, many of them corners."""
    best = np.full(len(campaign), np.inf)
    base = rotation_matrix(campaign.quaternion)
    for k in range(count):
        draw = rng.uniform(-1, 1, (len(campaign), 7)) if k % 2 else rng.choice([-1.0, 1.0], (len(campaign), 7))
        position = campaign.position + draw[:, :3] * campaign.position_radius
        s = 0.5 * draw[:, 3:6] * campaign.rotation_radius
        turned = rotation_matrix(np.concatenate([np.ones((len(s), 1)), s], axis=1)) @ base
        length = campaign.length[:, leg - 1] + draw[:, 6] * campaign.length_radius[:, leg - 1]
        arm = np.einsum("kij,j->ki", turned, x[3:6])
        best = np.minimum(best, np.abs(np.linalg.norm(position + arm - x[:3], axis=1) - length - x[6]))
    return best


def test_bracket_with_reading_sets(certified: LegResult, exact: LegResult) -> None:
    assert 0.0 < certified.bracket.lo <= certified.bracket.hi < exact.bracket.lo
    assert certified.bracket.hi - certified.bracket.lo <= 2e-3
    assert certified.bracket.verdict is Verdict.PROVED
    assert certified.bracket.point in certified.bracket.enclosure
    assert certified.bracket.hi > 0.0
    assert "fits within the stated reading uncertainty" not in status(certified)


def test_no_sample_of_readings_refutes_the_lower_bound(bent: Campaign, certified: LegResult) -> None:
    """For every x some measurement has |g| >= eps_lo for ALL readings: sampled ones included."""
    rng = np.random.default_rng(1)
    assert certified.bracket.point is not None
    for size in (0.0, 1e-3, 1e-2, 0.1, 1.0):
        for x in np.add(certified.bracket.point, size * rng.normal(size=(6, 7))):
            assert sampled(bent, 1, x, rng).max() >= certified.bracket.lo


# deficient data ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("rows", [[5] * 64, [0, 9, 40], [3]], ids=["one pose 64 times", "three poses", "one"])
def test_deficient_campaigns_are_answered_truthfully(bent: Campaign, rows: list[int], exact: bool) -> None:
    campaign = part(bent, rows, exact=exact)
    found = only(campaign, 2, delta=50.0, time_limit=10.0)
    assert 0.0 == found.bracket.lo <= found.bracket.hi <= 1e-9
    assert found.bracket.point is not None
    if exact:
        assert np.abs(model_residuals(campaign, 2, found.bracket.point)).max() <= max(found.bracket.hi, 1e-12)
    else:
        assert found.bracket.hi == 0.0
    # many other parameters fit as well: shift base and mobile centres together, say
    assert (found.bracket.enclosure.width[:3] > 1.0).all()


# options ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["exact", "certified"])
def test_questions_about_one_eps(bent: Campaign, request: pytest.FixtureRequest, kind: str) -> None:
    campaign = without_sets(bent) if kind == "exact" else bent
    known: LegResult = request.getfixturevalue(kind)
    above, below = only(campaign, eps=known.bracket.hi * 1.001), only(campaign, eps=known.bracket.lo * 0.98)
    assert above.bracket.verdict is Verdict.PROVED
    assert above.bracket.point is not None
    assert "Some x" in status(above, eps=1.0)
    assert below.bracket.verdict is Verdict.REFUTED
    assert below.bracket.point is None
    assert below.bracket.enclosure.is_empty
    assert 0 < len(below.support) <= 64  # who refutes it
    assert "No x" in status(below, eps=1.0)
    assert (above.bracket.lo, below.bracket.lo) == (0.0, known.bracket.lo * 0.98)  # of no other eps anything is said


def test_bad_options_are_reported_together(bent: Campaign) -> None:
    with pytest.raises(InputError) as error:
        certify(bent, legs=[0, 1, 1], delta=-1.0, center="mean", gap=1.0, time_limit=0.0, eps=float("nan"))
    assert len(error.value.problems) == 7
    with pytest.raises(PluginError, match=r"hc4, .*lifted"):
        certify(bent, contractors=["none"])
    for wrong in ({"support": "all"}, {"outliers": 64}, {"outliers": 1, "eps": 1.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            certify(bent, **wrong)
    for endless in (2e6, 1e300, float("inf")):
        with pytest.raises(InputError, match="delta"):
            certify(bent, delta=endless)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_perfect_robot_is_not_refuted(seed: int) -> None:
    campaign = simulate(seed=seed, truncate=3.0)
    found = only(campaign, 4)
    assert (found.bracket.lo, found.bracket.hi) == (0.0, 0.0)
    assert found.bracket.hi == 0.0
    assert found.support == ()
    assert found.bracket.verdict is Verdict.PROVED
    assert "fits within the stated reading uncertainty (for some readings): proved" in status(found)
    truth = true_robot(campaign)
    assert truth is not None
    assert truth.parameters[3] in found.bracket.enclosure  # all x with eps = 0, the true leg among them
