"""Given points, fits, parameters to load: right for all readings, proved, against exact arithmetic and samples."""

import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.checker import check, check_run
from cpcal.cli.verify import checked_certificates
from cpcal.common.values import Floats
from cpcal.models import fit_model, leg_model, leg_readings, leg_statement, reading_moves, reading_range
from cpcal.questions import LegResult, Result, calibrate_study, recommendation, save_result, verdict_of
from cpcal.questions.points import certify_fits, fits_of
from cpcal.robot import Campaign, ModelChoice, Pose, Robot, Uncertainty, leg_vectors, rotation_matrix
from cpcal.simulate import simulate_study, true_robot
from cpcal.solver.certificate.float_rows import AllReadings, at_point, failing, holding

SMALL = {"extremal": False, "random_poses": 24}


@pytest.mark.parametrize("eps", [0.0, 0.5])
@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_verdicts_agree_with_exact_fractions(factor: float, eps: float) -> None:
    campaign = cpcal.simulate(seed=2, joint_error=10.0, factor=factor, **SMALL)
    x = fit_model(campaign, 3)
    found = cpcal.certify_point(campaign, 3, x, eps=eps)
    problem, at = leg_statement(campaign, 3).problem, at_point([*x, eps])
    for k, name in enumerate(campaign.measurement_ids):
        assert (holding(problem, at, k) is not None) == (name in found.holds)
        assert (failing(problem, at, k) is not None) == (name in found.fails)
    assert found.verified.fails > 0


@pytest.mark.parametrize("model", ["plain", "gain", "lateral"])
@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_the_certificate_says_the_same(factor: float, model: str, tmp_path: Path) -> None:
    cpcal.save_campaign(cpcal.simulate(seed=2, joint_error=10.0, factor=factor, **SMALL), tmp_path)
    campaign = cpcal.load_campaign(tmp_path)
    path = tmp_path / "point.cert.jsonl"
    x = fit_model(campaign, 2, leg_model(model))
    plain = cpcal.certify_point(campaign, 2, x, eps=0.3, model=model)
    found = cpcal.certify_point(campaign, 2, x, eps=0.3, certificate=path, model=model)
    assert (found.holds, found.fails) == (plain.holds, plain.fails)
    accepted = check(path)
    assert accepted.model == model
    assert accepted.claims.point is not None
    ids = campaign.measurement_ids
    assert tuple(ids[k] for k in accepted.claims.point.holds) == found.holds
    assert tuple(ids[k] for k in accepted.claims.point.fails) == found.fails
    assert found.holds
    assert found.fails


def test_what_float64_cannot_decide_neither_holds_nor_fails() -> None:
    """The point solves the one equation exactly, which outward rounding does not see."""
    robot = cpcal.Robot("one leg", [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0])
    pose = [[0.0, 0.0, 300.1]], [[0.6, 0.0, 0.0, 0.8]]
    campaign = cpcal.Campaign.of(robot, *pose, [[300.1 - 300.0]], exact=True)
    found = cpcal.certify_point(campaign, 1, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0])
    assert (found.holds, found.fails) == ((), ())
    assert found.verified.verdict is cpcal.Verdict.UNKNOWN
    assert "1 are undecided" in found.verified.sentence("It")


def test_points_of_models(tmp_path: Path) -> None:
    campaign = cpcal.simulate(seed=3, joint_error=0.0, factor=3.0, truncate=2.9, **SMALL)
    campaign = replace(campaign, length=campaign.length / 1.02, model=ModelChoice("gain", {}))
    x = [*true_robot(campaign).parameters[0], 0.02]
    assert cpcal.certify_point(campaign, 1, x).verified.verdict is cpcal.Verdict.PROVED  # as the campaign has it
    assert cpcal.certify_point(campaign, 1, x[:7], model="plain").verified.verdict is cpcal.Verdict.REFUTED
    with pytest.raises(cpcal.InputError, match="a point of the gain model is 8 finite numbers"):
        cpcal.certify_point(campaign, 1, x[:7])
    own = cpcal.LegModel("mine", "L + l + k", (cpcal.Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
    assert cpcal.certify_point(campaign, 1, x, model=own).verified.verdict is cpcal.Verdict.REFUTED
    with pytest.raises(cpcal.InputError, match="a user-defined model, has none"):
        cpcal.certify_point(campaign, 1, x, model=own, certificate=tmp_path / "none")
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.certify_point(campaign, 9, x, model="gian", eps=-1.0)
    assert [p.where for p in refused.value.problems] == ["model", "leg", "eps"]


def test_an_error_as_large_as_the_leg_is_long_is_no_question() -> None:
    """The model takes legs to be longer than the error: at such a one every point would be called proved to fail."""
    campaign = cpcal.simulate(seed=1, **SMALL)
    x = campaign.robot.parameters[0]
    length = float(np.min(campaign.length[:, 0] - campaign.length_radius[:, 0])) + float(x[6])
    assert cpcal.certify_point(campaign, 1, x, eps=length - 1.0).verified.holds == len(campaign)
    with pytest.raises(cpcal.InputError, match="mm is no error of leg 1, which is "):
        cpcal.certify_point(campaign, 1, x, eps=length)


@pytest.fixture(scope="module")
def found():
    return calibrate_study(simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0))


@pytest.fixture(scope="module")
def folder(found, tmp_path_factory):
    return tmp_path_factory.mktemp("fits") / "fits"


@pytest.fixture(scope="module")
def fits(found, folder):
    return certify_fits(found.campaign, found.record, folder, legs=[5, 2])


def test_both_fits_are_verified_with_certificates(found, fits, folder):
    accepted = checked_certificates(folder)
    assert fits_of(folder, found.campaign, [2, 5], accepted) == fits
    assert sorted(accepted) == [f"{name}.leg{leg}.cert.jsonl" for name in ("x_c", "x_c_sigma") for leg in (2, 5)]
    for verified, fit in ((fits["x_c"], found.x_c), (fits["x_c_sigma"], found.x_c_sigma)):
        assert [leg.leg for leg in verified] == [2, 5]
        for leg in verified:
            alone = cpcal.certify_point(found.campaign, leg.leg, fit.parameters[leg.leg - 1])
            assert (leg.verified, leg.point) == (alone.verified, alone.point)
            assert leg.verified.verdict is cpcal.Verdict.REFUTED


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda run: (run / "x_c.leg2.cert.jsonl").unlink(), "it is missing"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg1.cert.jsonl"), "is called so"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg5.cert.jsonl"), "is called so"),
        (lambda run: (run / "x_c.leg2.cert.jsonl").write_text(""), "it is empty"),
        (lambda run: [path.unlink() for path in run.glob("*.jsonl")], "it is missing"),
    ],
)
def test_a_folder_that_was_touched_is_refused(found, fits, folder, tmp_path, change, reason):
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    change(run)
    with pytest.raises(cpcal.InputError, match=reason):
        fits_of(run, found.campaign, [2, 5], checked_certificates(run))


def test_a_point_of_another_model_is_no_fit(found, fits, folder, tmp_path):
    at = [*fits["x_c"][0].point, 0.0]
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    cpcal.certify_point(found.campaign, 2, at, model="gain", certificate=tmp_path / "x_c.leg2.cert.jsonl")
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(tmp_path, found.campaign, [2, 5], checked_certificates(tmp_path))


def test_another_campaign_is_refused(found, fits, folder, tmp_path):
    other = cpcal.simulate(seed=2)
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(folder, other, [2, 5], checked_certificates(folder))
    with pytest.raises(cpcal.InputError, match="another campaign"):
        certify_fits(other, found.record, tmp_path)


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
    assert {name.split(".")[1] for name, _ in checked.proofs[1:]} == {"recommended", "passes"}
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
    assert (checked.refused, checked.proofs[-1][0]) == (None, "leg2.reduced.cert.jsonl")
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
