"""The whole certificate, from a run to its page: what is assumed stands first, what is proved holds."""

import re
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.checker import Refused
from cpcal.checker.platform import check_accuracy
from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256
from cpcal.files.folders import save_campaign_json
from cpcal.models import PARAMETERS, fit_model
from cpcal.models.platform import Workspace, rotated
from cpcal.questions.accuracy import (
    FAR,
    NamedPoses,
    certify_accuracy,
    distance_from_measured,
    expanded_uncertainty,
    load_accuracy,
    measured_poses,
    proposed_workspace,
    save_accuracy,
    suggested_error,
)
from cpcal.questions.result import Recommended
from cpcal.report.accuracy_page import assumption, degrees_up, headline, sentences, write_accuracy
from cpcal.robot import (
    ROBOTS,
    Pose,
    Robot,
    central_pose,
    distances,
    forward_kinematics,
    inverse_kinematics,
    pose_jacobian,
)
from cpcal.simulate import true_robot
from tests.models.known_robot import ERROR, known, reached_poses
from tests.report.made import made_leg, made_result

__all__ = ["known"]


@pytest.fixture(scope="module")
def result(known):
    return cpcal.certify(known.campaign, delta=8.0, support="none", gap=0.5)


@pytest.fixture(scope="module")
def named(known):
    readings = np.random.default_rng(8).uniform(5.0, 135.0, (3, 6))
    centre = central_pose(known.controller, np.full(6, 70.0))
    return NamedPoses(("p1", "p2", "p3"), forward_kinematics(known.controller, readings, centre))


@pytest.fixture(scope="module")
def found(known, result, named):
    return certify_accuracy(known.campaign, result, poses=named, assume=ERROR)


def inside(campaign, found):
    """Whether the true poses of a simulated campaign are off by no more than is proved."""
    poses = Pose(np.array([p.position for p in found.poses]), np.array([p.quaternion for p in found.poses]))
    true = reached_poses(campaign, Robot.from_parameters("controller", found.parameters), poses)
    off = zip(found.poses, *distances(true, poses), strict=True)
    return all(p.proved and mm <= p.position_bound and rad <= p.rotation_bound for p, mm, rad in off)


def test_the_truth_is_inside_and_what_is_assumed_is_said_first(known, found):
    assert inside(known.campaign, found)
    assert all(e.stated and e.eps == ERROR and e.refuted_below <= ERROR for e in found.legs)
    assert headline(found).startswith("Simulated: the tool (origin of the mobile frame) is off by at most: ")
    assert assumption(found).startswith("ASSUMED: ")
    assert "0.02 mm" in assumption(found)
    proved = [s for s in sentences(found) if s.startswith("PROVED")]
    printed = float(re.search(r"within ([\d.]+) mm", proved[0])[1])
    assert printed >= max(pose.position_bound for pose in found.poses)


@given(st.floats(1e-9, 3.2))
def test_printed_degrees_are_never_less_than_the_angle(angle):
    pi = Fraction(3141592653589793, 10**15)  # a little less, so that this asks for a little more than the angle
    assert Fraction(degrees_up(angle)) * pi >= 180 * Fraction(angle)


def test_it_is_written_and_read_again_and_the_page_says_what_is_assumed_before_what_is_proved(found, tmp_path):
    save_accuracy(found, tmp_path)
    assert load_accuracy(tmp_path) == found
    page = write_accuracy(found, tmp_path).read_text()
    first, *others = (f">{word}</span>:" for word in ("ASSUMED", "PROVED under the assumption", "ESTIMATED"))
    assert all(page.index(headline(found)[:60]) < page.index(first) < page.index(other) for other in others)
    assert len({page[: page.index(word)].rpartition("class=")[2] for word in (first, *others)}) == 3


def test_what_is_suggested_is_more_than_the_residuals_and_rises_with_lengths_far_from_measured(known):
    eps, residual = suggested_error(known.campaign, 1)
    assert eps == pytest.approx(residual * np.sqrt(2.0))  # 14 measurements for 7 parameters
    assert suggested_error(known.campaign, 1, 0.1) == (eps, residual)
    assert suggested_error(known.campaign, 1, 0.5) == (pytest.approx(1.5 * eps), residual)
    assert np.isinf(suggested_error(known.campaign.rows(np.arange(7)), 1)[0])


def test_what_is_asked_by_default_is_measured_or_needs_no_readings_beyond_and_u_holds_for_it(known, result):
    assert measured_poses(known.campaign).names == known.campaign.pose
    assert not distance_from_measured(known.campaign, known.campaign.length).any()
    space, said = proposed_workspace(known.campaign, known.controller, ())
    assert "% of the measured positions' range" in said
    poses = rotated(np.random.default_rng(1).uniform(space.lo, space.hi, (50, 6)))
    length = inverse_kinematics(known.controller, poses)
    assert (known.campaign.length.min(axis=0) <= length).all()
    assert (length <= known.campaign.length.max(axis=0)).all()
    away = distance_from_measured(known.campaign, np.array([[-100.0] * 6, [0.0] * 6]))
    low, high = known.campaign.length.min(axis=0), known.campaign.length.max(axis=0)
    assert away == pytest.approx((low - [[-100.0], [0.0]]) / (high - low))
    # U of the fit holds for poses that nobody measured; another controller is off by what it differs by
    for robot, least in ((known.controller, 0.0), (known.campaign.robot, 0.5)):
        u = expanded_uncertainty(known.campaign, robot, poses)
        position, _ = distances(reached_poses(known.campaign, robot, poses), poses)
        assert np.mean(position <= u) >= 0.9
        assert least < u.max() < 3.0 * position.max()


def test_u_holds_at_poses_that_nobody_measured_where_the_model_is_imperfect():
    campaign = cpcal.simulate(seed=5, extremal=False, random_poses=64, noise=0.01, joint_error=0.3)
    robot = Robot.from_parameters("fit", np.stack([fit_model(campaign, leg) for leg in range(1, 7)]))
    readings = np.random.default_rng(6).uniform(0.0, 140.0, (100, 6))
    poses = forward_kinematics(robot, readings, central_pose(robot, np.full(6, 70.0)))
    u = expanded_uncertainty(campaign, robot, poses)
    position, _ = distances(reached_poses(campaign, robot, poses), poses)
    assert np.mean(position <= u) >= 0.9
    assert u.max() <= 2.2 * position.max()


def ended(error, ends):
    """A campaign of extremal legs, whose readings lack an error that vanishes at both ends of the stroke."""
    good = cpcal.simulate(seed=4, noise=0.1, truncate=3.0, deviation=0.5, random_poses=0 if ends else 40)
    bump = error * np.sin(np.pi * good.length / 140.0)
    return replace(good, length=good.length + bump, provenance={})


def test_lengths_that_nobody_measured_are_named_and_what_is_assumed_rises():
    campaign = ended(0.3, ends=True)
    away = distance_from_measured(campaign, np.array([np.full(6, 70.0), np.full(6, 10.0)]))
    assert (away[0] > FAR).all()
    assert (away[1] < FAR).all()
    # the ends of the stroke show none of it; the middle does
    ends, middle = (ended(0.3, ends=ends) for ends in (True, False))
    assert suggested_error(middle, 1)[0] > 0.15 > suggested_error(ends, 1, away[0, 0])[0] > suggested_error(ends, 1)[0]


def run_of(campaign, **changes):
    """A run that the solver has not made: nothing is proved, the recommended parameters are those of least squares."""
    box, nominal = cpcal.Box(PARAMETERS, np.zeros(7), np.ones(7)), campaign.robot.parameters.tolist()
    legs = []
    for leg in changes.pop("legs", range(1, campaign.legs + 1)):
        point = tuple(fit_model(campaign, leg).tolist())
        told = Recommended(point, "least squares", np.inf)
        lo = changes.get("lo", 0.0) if leg == 1 else 0.0
        legs.append(made_leg(leg, lo, lo, point, tuple(nominal[leg - 1]), box, lo, (), 1, 1, 0.1, recommended=told))
    options = {"tolerance": changes["tolerance"]} if "tolerance" in changes else {}
    return made_result(campaign, *legs, delta=changes.get("delta", 100.0), **options)


@pytest.fixture(scope="module")
def robots():
    out = {}
    for name in ("planar-3rpr", "cogiro", "deltalab"):
        robot = ROBOTS[name]
        where = {"stroke": robot.stroke} if robot.workspace is None else {"workspace": robot.workspace}
        many = {"extremal": False, "random_poses": 12, "truncate": 2.9, "noise": 0.1, "deviation": 0.2}
        out[name] = cpcal.simulate(robot.robot, seed=2, **many, **where)
    return out


def solved(robot, readings, start, free):
    """The pose near another at which a robot has these readings, by Newton's method in the `free` coordinates."""
    pose = start
    for _ in range(30):
        step = np.zeros((len(readings), 6))
        gap = readings - inverse_kinematics(robot, pose)
        step[:, free] = np.einsum("kij,kj->ki", np.linalg.pinv(pose_jacobian(robot, pose)[..., free]), gap)
        pose = pose.moved(step)
    return pose


@pytest.mark.parametrize(("name", "free"), [("planar-3rpr", [0, 1, 5]), ("cogiro", [0, 1, 2, 3, 4, 5])])
def test_the_truth_of_a_robot_with_three_or_eight_legs_is_in_its_box(robots, name, free, tmp_path):
    campaign = robots[name]
    rows = [2, 5]
    commanded = Pose(campaign.position[rows], campaign.quaternion[rows])
    asked = NamedPoses(("a", "b"), commanded)
    result = run_of(campaign, delta=20.0)
    found = certify_accuracy(campaign, result, poses=asked, assume=0.01, certificates=tmp_path)
    assert [k for k in range(6) if k not in found.held] == free
    # of eight legs the readings of the controller cannot all be reached: least squares, so little is the error
    true = solved(true_robot(campaign), inverse_kinematics(Robot.from_parameters("c", found.parameters), commanded),
                  commanded, free)  # fmt: skip
    position, angle = distances(true, commanded)
    for k, one in enumerate(found.poses):
        assert one.proved
        assert position[k] <= one.position_bound <= 1.5 * one.attained
        assert angle[k] <= one.rotation_bound
        assert 0.0 < one.attained <= 1.01 * one.position_bound
        assert 0.0 < one.u_position < np.inf
    save_accuracy(found, tmp_path)
    save_campaign_json(campaign, tmp_path)
    *_, (good, said) = check_accuracy(tmp_path)
    assert good
    assert ("its z, rx, ry as commanded" in said) == (name == "planar-3rpr")
    assert ("The mechanism holds z, rx, ry." in assumption(found)) == (name == "planar-3rpr")
    save_accuracy(replace(found, held=(2, 3) if name == "planar-3rpr" else (2,)), tmp_path)
    with pytest.raises(Refused, match=r"another bounds|do not determine"):
        check_accuracy(tmp_path)


def test_a_workspace_of_a_planar_robot_is_bounded_where_it_is_turned(robots):
    campaign = robots["planar-3rpr"]
    low, high = campaign.position.min(axis=0), campaign.position.max(axis=0)
    middle, half = 0.5 * (low + high), 0.05 * (high - low)
    turned = Workspace((*(middle - half), 0.0, 0.0, 0.27), (*(middle + half), 0.0, 0.0, 0.27))
    result = run_of(campaign, delta=20.0)
    found = certify_accuracy(campaign, result, assume=0.01, workspace=turned, next_poses=0)
    space = found.workspace
    assert not space.left_out
    sample = rotated(np.random.default_rng(1).uniform(space.lo, space.hi, (100, 6)))
    controller = Robot.from_parameters("controller", found.parameters)
    true = solved(true_robot(campaign), inverse_kinematics(controller, sample), sample, [0, 1, 5])
    position, angle = distances(true, sample)
    assert 0.0 < position.max() <= space.position_bound
    assert space.complete
    assert space.worst_pose_bound <= space.position_bound <= 1.2 * space.worst_pose_bound  # the gap that is asked for
    assert 0.0 < angle.max() <= max(cell.rotation_bound for cell in space.cells if cell.proved)
    # where it is not turned its triangles are similar, and nothing can be bounded
    unturned = Workspace((*space.lo[:5], 0.0), (*space.hi[:5], 0.0))
    singular = certify_accuracy(
        campaign, run_of(campaign, delta=20.0), assume=0.01, workspace=unturned, cells=20, next_poses=0
    )
    assert len(singular.workspace.left_out) == len(singular.workspace.cells)


def test_measurements_that_a_robust_run_left_out_are_left_out_of_what_is_assumed(known, tmp_path):
    wrong = known.campaign.length.copy()
    wrong[4, 2] += 2.0
    campaign = replace(known.campaign, length=wrong)
    bad = campaign.measurement_ids[4]
    result = run_of(known.campaign, delta=8.0)
    legs = tuple(
        replace(leg, bracket=replace(leg.bracket, left_out=(bad,) if leg.leg == 3 else ())) for leg in result.legs
    )
    result = replace(result, legs=legs, campaign=replace(result.campaign, sha256=campaign_sha256(campaign)))
    poses = NamedPoses(("here",), Pose(campaign.position[:1], campaign.quaternion[:1]))
    found = certify_accuracy(campaign, result, poses=poses, assume=ERROR, certificates=tmp_path, next_poses=0)
    assert found.legs[2].left_out == (bad,)
    assert f"but {bad}" in assumption(found)
    assert inside(campaign, found)
    save_accuracy(found, tmp_path)
    save_campaign_json(campaign, tmp_path)
    assert all(good for good, _ in check_accuracy(tmp_path))
    for leg, out in ((2, ()), (0, (bad,)), (2, (bad, "nobody/1"))):
        other = tuple(replace(one, left_out=out) if k == leg else one for k, one in enumerate(found.legs))
        save_accuracy(replace(found, legs=other), tmp_path)
        with pytest.raises(Refused, match="another measurements"):
            check_accuracy(tmp_path)


REFUSED: dict[str, tuple[str, dict[str, Any], str, str]] = {
    "legs that do not determine the pose": ("deltalab", {"few": 5}, "robot", "has 5 legs, and its measured poses vary"),
    "some legs": ("deltalab", {"legs": (2, 5)}, "run", "holds these legs only: 2, 5"),
    "another model": ("deltalab", {"model": "gain"}, "run", "has the leg model 'gain'"),
    "a failed leg": ("deltalab", {"tolerance": 0.1, "lo": 0.2}, "run", "fails its tolerance: leg 1"),
    # legs are taken to be longer than the error; parameters with shorter legs would be left out of the sets
    "an error longer than a leg": ("deltalab", {"assume": (1.0, 1.0, 5e3, 1.0, 1.0, 1.0)}, "assume", "5000 mm is no"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_it_cannot_be_asked_of_is_refused_before_any_work(robots, case):
    name, given, where, what = REFUSED[case]
    changes = dict(given)
    campaign, model, assume = robots[name], changes.pop("model", None), changes.pop("assume", None)
    if few := changes.pop("few", None):
        robot = Robot.from_parameters("few", campaign.robot.parameters[:few])
        campaign = cpcal.Campaign.of(
            robot, campaign.position, campaign.quaternion, campaign.length[:, :few], exact=True
        )
    result = run_of(campaign, **changes)
    if model is not None:
        result = replace(result, model=replace(result.model, name=model))
    with pytest.raises(InputError) as caught:
        certify_accuracy(campaign, result, assume=assume)
    (problem,) = caught.value.problems
    assert problem.where == where
    assert problem.what.startswith(what)
    if case == "a failed leg":
        assert "--assume MM" in problem.remedy
