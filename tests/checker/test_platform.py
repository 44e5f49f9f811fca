"""The pose of a platform whose legs are uncertain: the checker proves it again from the claims about the legs."""

import itertools
import json
import math
import shutil
from dataclasses import replace
from fractions import Fraction as F
from operator import mul

import numpy as np
import pytest

import cpcal
from cpcal.checker import Refused
from cpcal.checker.platform import AboutCenter, Commanded, Leg, LegEquation, check_accuracy, pose_bounds
from cpcal.files.folders import save_campaign_json
from cpcal.models.platform import Cells, cell_bounds, centered
from cpcal.questions.accuracy import NamedPoses, certify_accuracy, load_accuracy, save_accuracy
from cpcal.robot import (
    Pose,
    Robot,
    central_pose,
    distances,
    forward_kinematics,
    inverse_kinematics,
    pose_jacobian,
    quaternion_conjugate,
    quaternion_product,
)
from cpcal.solver.certificate.exact_network import free
from tests.models.known_robot import ERROR, known, reached_poses
from tests.remembered import verify_once

__all__ = ["known"]


@pytest.fixture(scope="module")
def run(known, tmp_path_factory):
    folder = tmp_path_factory.mktemp("accuracy")
    readings = np.random.default_rng(8).uniform(5.0, 135.0, (3, 6))
    poses = forward_kinematics(known.controller, readings, central_pose(known.controller, np.full(6, 70.0)))
    result = cpcal.certify(known.campaign, delta=8.0, support="none", gap=1e-2)
    named = NamedPoses(("p1", "p2", "p3"), poses)
    found = certify_accuracy(known.campaign, result, poses=named, assume=ERROR, certificates=folder, next_poses=0)
    save_accuracy(found, folder)
    save_campaign_json(known.campaign, folder)
    return folder, poses, found


@pytest.fixture(scope="module", autouse=True)
def legs_checked_once():
    with pytest.MonkeyPatch.context() as patch:
        verify_once(patch)
        yield


def test_the_truth_is_in_the_box_which_is_hardly_wider_than_without_certificates(run, known):
    _, poses, found = run
    alone = cell_bounds(Cells.of_poses(poses), known.sets)[1]
    true = reached_poses(known.campaign, known.controller, poses)
    position, angle = distances(true, poses)
    turn = quaternion_product(true.quaternion, quaternion_conjugate(poses.quaternion))
    inside = np.concatenate([true.position - poses.position, 2.0 * turn[:, 1:] / turn[:, :1]], axis=1)
    for k, one in enumerate(found.poses):
        assert one.proved
        assert (np.array(one.lo) <= inside[k]).all()
        assert (inside[k] <= np.array(one.hi)).all()
        assert position[k] <= one.position_bound <= 1.005 * alone.position[k]
        assert angle[k] <= one.rotation_bound <= 1.005 * alone.rotation[k]
        assert one.position_bound <= 1.1 * one.attained  # what is of second order counts for little


def forged(run, tmp_path, change):
    """Why the checker refuses the run whose accuracy.json was changed."""
    folder = tmp_path / "forged"
    shutil.copytree(run[0], folder)
    stated = json.loads((folder / "accuracy.json").read_text())
    change(stated, folder)
    (folder / "accuracy.json").write_text(json.dumps(stated))
    with pytest.raises(Refused) as caught:
        check_accuracy(folder)
    return str(caught.value)


def test_the_run_is_accepted_and_says_what_is_proved(run):
    *legs, poses = check_accuracy(run[0])
    assert [sentence for good, sentence in legs if good] == [
        f"parameters of leg {leg}, model error up to 0.02 mm: PROVED, they lie in the box" for leg in range(1, 7)
    ]
    assert poses[1].startswith("3 of 3 poses: PROVED, every pose within +-20.0 mm and +-0.1 rad that the legs allow is")


def changed(stated, key, by):
    value = stated["poses"][1][key]
    if isinstance(value, list):
        value[2] += by
    else:
        stated["poses"][1][key] = value + by


def about(stated):
    """What the bounds of a pose are computed with."""
    return stated["poses"][1]["information"]


FORGED = {
    "another center": (lambda s, _: about(s)["center"].__setitem__(0, 1.0), "another bounds of pose 1"),
    "a center of long numbers": (lambda s, _: about(s)["center"].__setitem__(0, 1e300), "a smaller number is needed"),
    "an inverse of nothing": (lambda s, _: about(s).update(inverse=[[0] * 6] * 6), "pose 1 that are not proved"),
    "an inverse without a line": (lambda s, _: about(s)["inverse"].pop(), "a list of 6 is needed"),
    "a wider end, which nobody proves so": (lambda s, _: changed(s, "lo", -1e-9), "another bounds of pose 1"),
    "an angle": (lambda s, _: changed(s, "rotation_bound", -1e-12), "another bounds of pose 1"),
    "another pose": (lambda s, _: changed(s, "position", 1.0), "another forms of poses"),
    "another controller": (lambda s, _: s["parameters"][3].__setitem__(6, 1.0), "another forms of poses"),
    "a wider box of poses": (lambda s, _: s.__setitem__("within", [500.0, 1.0]), "of pose 0"),
    "no box of poses": (lambda s, _: s.__setitem__("within", [20.0, 2.0]), "of no poses within its box"),
    "another delta": (lambda s, _: s.__setitem__("delta", 4.0), "another delta"),
    "the certificate of another leg": (
        lambda s, _: s["legs"][0].__setitem__("certificate", "set-leg2.cert.jsonl"), "another leg"
    ),
    "a certificate that is not there": (
        lambda s, _: s["legs"][0].__setitem__("certificate", "none.cert.jsonl"), "names no certificate"
    ),
    "a certificate that is not named": (
        lambda _, folder: shutil.copy(folder / "set-leg1.cert.jsonl", folder / "more.cert.jsonl"), "does not name"
    ),
    "a leg that is refuted": (lambda s, _: s["legs"][1].update(lo=[], hi=[]), "another box"),
    "bounds that are called unproved": (lambda s, _: s["poses"][0].__setitem__("proved", False), "another bounds of"),
    "another direction": (lambda s, _: s["legs"][3]["directions"][6].__setitem__(0, 0.5), "another forms of poses"),
    "a direction that is no short number": (
        lambda s, _: s["legs"][3]["directions"][6].__setitem__(0, 1e-300), "a direction that is no vector"
    ),
    "too few directions": (lambda s, _: s["legs"][3]["directions"].pop(), "a list of 7 is needed"),
    "another campaign": (lambda s, _: s["campaign"].__setitem__("sha256", "0" * 64), "another campaign SHA-256"),
}  # fmt: skip


@pytest.mark.parametrize("what", FORGED)
def test_a_forged_accuracy_is_refused(run, tmp_path, what):
    change, reason = FORGED[what]
    assert reason in forged(run, tmp_path, change)


def test_a_point_of_a_set_is_refused_for_it_may_need_a_larger_error(run, tmp_path):
    def change(_, folder):
        path = folder / "set-leg2.cert.jsonl"
        header, claims, *rest = path.read_text().splitlines(keepends=True)
        stated = json.loads(claims)
        at = [*stated["enclosure"]["lo"][:7], "0x1p-2", *stated["enclosure"]["lo"][8:]]
        stated["point"] = {"at": at, "holds": [], "readings": None, "factor": None, "fails": []}
        path.write_text(header + json.dumps(stated) + "\n" + "".join(rest))

    assert "another claim" in forged(run, tmp_path, change)


def test_a_campaign_that_refutes_the_error_leaves_no_poses(run, known, tmp_path):
    wrong = known.campaign.length.copy()
    wrong[3, 0] += 5.0
    campaign = replace(known.campaign, length=wrong)
    result = cpcal.certify(campaign, delta=8.0, support="none", gap=1e-1)
    poses = NamedPoses(("p1",), Pose(run[1].position[:1], run[1].quaternion[:1]))
    found = certify_accuracy(campaign, result, poses=poses, assume=ERROR, certificates=tmp_path, next_poses=0)
    assert found.refuted == (1,)
    assert not found.poses
    save_accuracy(found, tmp_path)
    save_campaign_json(campaign, tmp_path)
    first, *others = [sentence for _, sentence in check_accuracy(tmp_path)]
    assert first.endswith("PROVED, there are none")
    assert len(others) == 5
    assert load_accuracy(tmp_path) == found
    there = replace(found.legs[0], lo=(0.0,) * 7, hi=(1.0,) * 7, directions=found.legs[1].directions)
    save_accuracy(replace(found, legs=(there, *found.legs[1:])), tmp_path)
    with pytest.raises(Refused, match="another number of measurements"):
        check_accuracy(tmp_path)


def exact(values):
    return tuple(F(float(v)) for v in values)


UNIT = tuple(tuple(F(i == j) for j in range(7)) for i in range(7))


def known_leg(controller, lo, hi, eps, form, directions=UNIT):
    """With the ranges along directions that the box leaves."""
    along = []
    for direction in directions:
        ends = [sorted((d * a, d * b)) for d, a, b in zip(direction, lo, hi, strict=True)]
        along.append((sum(a for a, _ in ends), sum(b for _, b in ends)))
    return Leg(controller, lo, hi, directions, along, eps, form)


def bounded(robot, poses, k, reach, turn, eps=0.0):
    pose = Commanded(exact(poses.position[k]), exact(poses.quaternion[k]))
    rows = map(exact, robot.parameters)
    sure = [known_leg(row, row, row, F(eps), (F(0), F(0))) for row in rows]
    return bounds_of(pose, sure, reach, turn)


def bounds_of(pose, legs, reach=20, turn=0.05):
    center, inverse = centered(pose, legs)
    return pose_bounds(pose, legs, F(reach), F(turn), exact(center), list(map(exact, inverse)), free)


@pytest.mark.parametrize(("joints", "seed"), [("base", 9), ("mobile", 3), ("mobile", 4)])
def test_other_parameters_with_known_deviations_lead_into_the_box(run, known, joints, seed):
    """All of its width is what deviations do not say: terms that hold parameters and the pose together."""
    poses, controller, off = run[1], known.controller.parameters, np.zeros((6, 7))
    off[:, slice(0, 3) if joints == "base" else slice(3, 6)] = 2.0
    other = Robot.from_parameters(
        "other", controller + off * np.sign(np.random.default_rng(seed).uniform(-1, 1, (6, 7)))
    )
    true = forward_kinematics(other, inverse_kinematics(known.controller, poses), poses)
    turn = quaternion_product(true.quaternion, quaternion_conjugate(poses.quaternion))
    for k in range(len(poses.position)):
        pose, legs = Commanded(exact(poses.position[k]), exact(poses.quaternion[k])), []
        for row, there, far in zip(controller, other.parameters, off, strict=True):
            form, x = dict(pose.form(exact(row))), exact(there)
            value = sum((c * math.prod((x[i] for i in m), start=F(1)) for m, c in form.items()), F(0))
            legs.append(known_leg(exact(row), exact(row - far), exact(row + far), F(0), (value, value)))
        found = bounds_of(pose, legs)
        inside = [*(true.position[k] - poses.position[k]), *(turn[k, 1:] / turn[k, 0])]
        assert all(lo - 1e-7 <= v <= hi + 1e-7 for lo, v, hi in zip(found.lo, inside, found.hi, strict=True))
        assert np.linalg.norm(inside[:3]) <= found.position + 1e-7
        assert max(map(float, np.subtract(found.hi, found.lo)[:3])) < 2.0


def off_along_one_direction(run, known, rng, noise):
    """A pose, its legs, whose parameters lie at the ends of their ranges along random directions, and where it is."""
    controller = known.controller.parameters
    basis = np.linalg.qr(rng.normal(size=(7, 7)))[0] + noise * rng.uniform(-1, 1, (7, 7))
    directions = tuple(map(exact, np.rint(basis * 2.0**20) / 2.0**20))
    other = Robot.from_parameters("other", controller + rng.uniform(-3, 3, (6, 1)) * basis[0])
    true = forward_kinematics(other, inverse_kinematics(known.controller, run[1]), run[1])
    pose, legs = Commanded(exact(run[1].position[0]), exact(run[1].quaternion[0])), []
    for row, there in zip(controller, other.parameters, strict=True):
        form, x = dict(pose.form(exact(row))), exact(there)
        value = sum((c * math.prod((x[i] for i in m), start=F(1)) for m, c in form.items()), F(0))
        at = [sum(map(mul, direction, x)) for direction in directions]
        along = [(v - width, v) for v, width in zip(at, (F(1, 10), *[F(1, 1000)] * 6), strict=True)]
        lo, hi = exact(there - 0.01), exact(there + 0.01)
        legs.append(Leg(exact(row), lo, hi, directions, along, F(0), (value, value)))
    return pose, legs, true.position[0] - run[1].position[0]


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seed", range(4))
def test_any_directions_are_sound_with_ranges_that_are_true_of_them(run, known, seed, noise):
    pose, legs, inside = off_along_one_direction(run, known, np.random.default_rng(seed), noise)
    found = bounds_of(pose, legs)
    assert all(lo - 1e-7 <= v <= hi + 1e-7 for lo, v, hi in zip(found.lo, inside, found.hi, strict=False))


@pytest.mark.parametrize(("noise", "proves"), [(1e-9, True), (1e-3, True), (3.0, False)])
def test_any_center_and_inverse_are_sound(run, known, noise, proves):
    rng = np.random.default_rng(5)
    for _ in range(4):
        pose, legs, inside = off_along_one_direction(run, known, rng, 0.0)
        center, inverse = (one * (1.0 + noise * rng.uniform(-1, 1, one.shape)) for one in centered(pose, legs))
        found = pose_bounds(pose, legs, F(20), F(1, 20), exact(center), list(map(exact, inverse)), free)
        assert (found is not None) is proves
        ends = zip(found.lo, inside, found.hi, strict=False) if proves else ()
        assert all(lo - 1e-7 <= v <= hi + 1e-7 for lo, v, hi in ends)


def test_known_parameters_leave_the_pose_itself(run, known):
    found = bounded(known.controller, run[1], 0, 20, 0.05)
    assert 0 < found.position < 1e-9
    assert 0 < found.half_turn < 1e-11


def test_an_error_moves_a_leg_by_its_square_as_well(run, known):
    # (L + l + e)^2 - (L + l)^2 = e (2 (L + l) + e)
    pose, row, e = (
        Commanded(exact(run[1].position[0]), exact(run[1].quaternion[0])),
        exact(known.controller.parameters[0]),
        F(4),
    )
    found = LegEquation(pose, known_leg(row, row, row, e, (F(0), F(0))), free)
    least = pose.norm * e * (2 * pose.length(row) + e)
    assert all(least <= size <= least * (1 + F(1, 10**9)) for size in (-found.value[0], found.value[1]))


def test_legs_that_are_off_as_far_as_they_may_lead_into_the_box_and_nearly_to_its_ends(run, known):
    poses, robot, eps = Pose(run[1].position[:1], run[1].quaternion[:1]), known.controller, 4.0
    found, lengths = bounded(robot, run[1], 0, 20, 0.05, eps), inverse_kinematics(robot, poses)
    moves = np.linalg.inv(pose_jacobian(robot, poses)[0])
    for i, way in itertools.product(range(6), (-1, 1)):
        true = forward_kinematics(robot, lengths + eps * way * np.sign(moves[i]), poses)
        turn = quaternion_product(true.quaternion, quaternion_conjugate(poses.quaternion))[0]
        inside = [*(true.position[0] - poses.position[0]), *(turn[1:] / turn[0])]
        assert all(lo <= v <= hi for lo, v, hi in zip(found.lo, inside, found.hi, strict=True))
        assert inside[i] * way > 0.8 * max(-found.lo[i], found.hi[i])


def test_nothing_is_said_of_a_pose_that_may_leave_the_box(run, known):
    assert bounded(known.controller, run[1], 0, 2, 0.05, 3.0) is None
    assert bounded(known.controller, run[1], 0, 40, 0.1, 3.0) is not None


def test_a_singular_platform_is_bounded_by_nothing(known):
    middle = central_pose(known.controller, np.full(6, 70.0)).position
    turn = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    assert bounded(known.controller, Pose(middle[None], turn[None]), 0, 20, 0.05, 0.1) is None


@pytest.mark.parametrize("seed", range(6))
def test_the_linear_part_of_a_legs_equation_is_where_it_says(run, known, seed):
    """At a pose off by w each leg has a model error of its own; there its bound is attained, but for its square."""
    rng, controller = np.random.default_rng(seed), known.controller
    pose = Commanded(exact(run[1].position[0]), exact(run[1].quaternion[0]))
    commanded = Pose(run[1].position[:1], run[1].quaternion[:1])
    w = np.array([12.0] * 3 + [0.02] * 3) * rng.uniform(-1, 1, 6)
    moved = Pose(commanded.position + w[:3], quaternion_product(np.array([[1.0, *w[3:]]]), commanded.quaternion))
    errors = np.abs(inverse_kinematics(controller, moved) - inverse_kinematics(controller, commanded))[0]
    rows = []
    for row, error in zip(map(exact, controller.parameters), errors, strict=True):
        rows.append(LegEquation(pose, known_leg(row, row, row, F(float(error) + 1e-9), (F(0), F(0))), free))
    forms = [AboutCenter(row, [F(0)] * 6) for row in rows]
    inverse = list(map(exact, np.linalg.inv(np.array([form.slopes for form in forms], np.float64))))
    linear = [sum(map(mul, form.slopes, exact(w))) for form in forms]
    y = [abs(float(v)) for v in linear]
    for form, value in zip(forms, linear, strict=True):
        form.by_legs(inverse, [F(0)] * 6)
        below, above = form.spread(np.abs(w).tolist(), np.abs(w).tolist(), y)
        assert form.value[0] - above <= value <= form.value[1] + below
