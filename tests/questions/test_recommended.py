"""The parameters to load: right for ALL readings, proved; and worse sensors never turn a fail into a pass."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.checker import check_run
from cpcal.common.values import Floats
from cpcal.models import leg_model, leg_readings, reading_moves, reading_range
from cpcal.questions import LegResult, Result, recommendation, save_result, verdict_of
from cpcal.robot import Campaign, Pose, Robot, Uncertainty, leg_vectors, rotation_matrix
from cpcal.solver.certificate.float_rows import AllReadings

LEG = 2


def campaign(scale: float = 1.0) -> Campaign:
    """The same readings always, as if their deviations were `scale` times those that they have."""
    found = cpcal.simulate(seed=1, joint_error=1.0, factor=3.0, truncate=3.0)
    known = found.uncertainty
    assert known is not None
    position, rotation, length = (scale * s for s in (known.position, known.rotation, known.length))
    arrays = (found.robot, found.position, found.quaternion, found.length)
    return Campaign.of(
        *arrays, pose=found.pose, run=found.run, uncertainty=Uncertainty(position, rotation, length, 3.0)
    )


def certified(of: Campaign, **options: object) -> tuple[Result, LegResult]:
    result = cpcal.certify(of, legs=[LEG], support="none", **options)
    return result, result.legs[0]


def errors(of: Campaign, x: Floats, signs: Floats) -> Floats:
    """|g| (N,) at the plain parameters x, from its definition, with the readings at `signs` (7,) of their sets."""
    turn = 0.5 * signs[3:6] * of.rotation_radius
    rotation = rotation_matrix(np.column_stack([np.ones(len(of)), turn])) @ rotation_matrix(of.quaternion)
    v = of.position + signs[:3] * of.position_radius + rotation @ x[3:6] - x[:3]
    length = of.length[:, LEG - 1] + signs[6] * of.length_radius[:, LEG - 1]
    return np.abs(np.linalg.norm(v, axis=1) - length - x[6])


@pytest.fixture(scope="module")
def free() -> LegResult:
    return certified(campaign())[1]


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_the_largest_error_bounds_that_of_every_reading_and_is_reached(scale: float) -> None:
    of = campaign(scale)
    found = certified(of)[1].recommended
    assert found is not None
    x, rng = np.array(found.point), np.random.default_rng(0)
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 7)).reshape(7, -1).T
    sampled = max(errors(of, x, signs).max() for signs in (*corners, *rng.uniform(-1.0, 1.0, (50, 7))))
    assert sampled <= found.largest <= 1.001 * sampled


def largest(of: Campaign, x: Floats, factor: float = 1.0) -> float:
    """As a certificate would claim it."""
    return AllReadings("plain", x.tolist(), *leg_readings(of, LEG)).least_eps(factor)


@pytest.mark.parametrize("model", ["gain", "lateral"])
def test_in_every_model_it_is_below_an_interval_evaluation_that_grows_with_the_half_widths(model: str) -> None:
    of, (_, leg) = campaign(), certified(campaign(), model=model)
    assert leg.recommended is not None
    x = np.array(leg.recommended.point)
    ranges = [reading_range(of, LEG, leg_model(model), x, factor) for factor in (0.0, 0.5, 1.0)]
    for inner, outer in pairwise(ranges):
        assert (outer.lo < inner.lo).all()
        assert (inner.hi < outer.hi).all()
    least, most = (max(-r.lo.min(), r.hi.max()) for r in (ranges[0], ranges[-1]))
    assert least < leg.recommended.largest <= most <= 1.2 * leg.recommended.largest


def test_readings_in_which_the_error_is_not_monotone_count_too() -> None:
    """A vertical leg: moved sideways, either way, it gets longer."""
    identity, up = np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 100.0]])
    robot = Robot.from_parameters("one", np.zeros((1, 7)))
    sideways = Uncertainty(np.array([10.0, 0.0, 0.0]), np.zeros(3), np.zeros(1))
    of = Campaign.of(robot, up, identity, np.array([[100.0]]), uncertainty=sideways)
    for found in (reading_range(of, 1, leg_model("plain"), np.zeros(7)).hi[0],
                  AllReadings("plain", [0.0] * 7, *leg_readings(of, 1)).least_eps()):  # fmt: skip
        assert found >= np.hypot(100.0, 10.0) - 100.0


def test_nothing_is_proved_of_readings_at_which_a_model_is_not_defined() -> None:
    """The square of a leg less h is negative, of all readings or of some of the shortest leg."""
    of, lateral = campaign(), leg_model("lateral")
    near = float((leg_vectors(of.robot, Pose(of.position, of.quaternion))[:, LEG - 1] ** 2).sum(axis=-1).min())
    for h, proved in ((1e6, False), (near, False), (0.0, True)):
        found = reading_range(of, LEG, lateral, np.append(of.robot.parameters[LEG - 1], h))
        assert np.isfinite(found.hi).all() == proved


def test_worse_sensors_never_turn_a_fail_into_a_pass(free: LegResult) -> None:
    assert free.passes_from is not None
    words = []
    for scale in (1e-3, 1e-2, 0.1, 0.3, 0.6, 1.0):
        result, _ = certified(campaign(scale), tolerance=0.4)
        words.append(verdict_of(result, result.legs[0]).word)
    assert words[0] == "fail"  # even then the model has an error of more than that
    assert "pass" not in words
    assert words[-1] == "undecided"
    order = ["pass", "fail", "undecided"]
    words = [
        verdict_of(r, leg).word for r, leg in (certified(campaign(s), tolerance=0.95) for s in (1e-3, 0.3, 1.0, 3.0))
    ]
    assert words[0] == "pass"
    assert sorted(words, key=order.index) == words
    assert words[-1] == "undecided"


@pytest.mark.parametrize("share", [0.25, 0.75])
def test_what_is_recommended_conforms_with_the_least_sum_of_squares(share, free, tmp_path):
    of = campaign()
    assert free.recommended is not None
    assert free.passes_from is not None
    tolerance = free.passes_from.eps + share * (free.recommended.largest - free.passes_from.eps)
    result, leg = certified(of, tolerance=tolerance, certificates=tmp_path)
    found = leg.recommended
    assert found is not None
    assert found.why == "constrained least squares"
    assert (1.0 - 1e-6) * tolerance < found.largest <= tolerance
    assert verdict_of(result, leg).word == "pass"
    assert f"conforms to {tolerance}" in recommendation(result, leg)
    save_result(result, tmp_path, of)
    (checked,) = check_run(tmp_path)
    assert checked.refused is None
    assert {key for key, _ in checked.points} == {"recommended", "passes_from"}
    # steps that lower the weighted sum of squares leave what conforms
    x = np.array(found.point)
    weight = 1.0 / np.linalg.norm(reading_moves(of, LEG, free.recommended.point), axis=1)
    cost = np.sum((weight * errors(of, x, np.zeros(7))) ** 2)
    for step in np.random.default_rng(1).standard_normal((200, 7)) * 1e-3:
        other = x + step
        if np.sum((weight * errors(of, other, np.zeros(7))) ** 2) < 0.999999 * cost:
            assert largest(of, other) > tolerance


def test_the_factor_on_the_half_widths_is_the_largest_at_which_the_point_conforms(tmp_path: Path) -> None:
    of = campaign(3.0)
    result, leg = certified(of, tolerance=1.2, certificates=tmp_path)
    assert verdict_of(result, leg).word == "undecided"
    assert recommendation(result, leg) == "least squares; not shown to conform"
    assert leg.recommended is not None
    assert leg.reduced is not None
    x, factor = np.array(leg.recommended.point), leg.reduced.factor
    found = [largest(of, x, f) for f in (factor, factor + 1.1 / 1024)]
    assert 0.0 < factor < 1.0
    assert found[0] <= 1.2 < found[1]
    save_result(result, tmp_path, of)
    (checked,) = check_run(tmp_path)
    assert (checked.refused, checked.points[-1][0]) == (None, "reduced")
    # where the readings as they are exceed the tolerance, no better sensor helps these parameters
    never = certified(of, tolerance=float(errors(of, x, np.zeros(7)).max()) * 0.99)[1].reduced
    assert never == replace(leg.reduced, factor=0.0, certificate=None)


def test_with_outliers_a_pass_is_over_the_others() -> None:
    good = cpcal.simulate(seed=2, joint_error=0.1, noise=0.1, truncate=3.0, extremal=False, random_poses=30)
    length = good.length.copy()
    length[17, LEG - 1] += 5.0
    of = replace(good, length=length)
    fails, _ = certified(of, tolerance=0.5)
    result, leg = certified(of, tolerance=0.5, outliers=1)
    assert verdict_of(fails, fails.legs[0]).word == "fail"
    assert verdict_of(result, leg).word == "pass"
    assert leg.bracket.left_out == (of.measurement_ids[17],)
    assert leg.recommended is not None
    assert (
        np.delete(errors(of, np.array(leg.recommended.point), np.zeros(7)), 17).max() <= leg.recommended.largest <= 0.5
    )
