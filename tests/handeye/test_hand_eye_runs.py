"""Runs of `cpcal handeye certify`, also with --wrong: what they state holds of the truth; what is false is refused.

Each forgery changes one thing, one end at a time, and is refused in the sentence and for the reason that is its own.
"""

import json
import re
import shutil
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cpcal.checker import check
from cpcal.checker.files import Budget
from cpcal.common.errors import InputError
from cpcal.handeye import wrong_images
from cpcal.handeye.certify import (
    AskedBox,
    Within,
    certify_hand_eye,
    load_hand_eye_result,
    parameter_ranges,
    save_hand_eye_result,
)
from cpcal.handeye.chain import _linked as prove_linked
from cpcal.handeye.chain import prove
from cpcal.handeye.files import hand_eye_files
from cpcal.handeye.rows import UNKNOWNS, PlacedFrames, exact_errors, largest, unknowns_of
from cpcal.handeye.sources import read_pose_pairs, study_of_pairs
from cpcal.handeye.study import HandEyeFrames, HandEyeStudy, simulate_hand_eye
from cpcal.handeye.verify import verify_hand_eye, verify_wrong_images
from cpcal.handeye.wrong_images import find_wrong_images, save_wrong_images
from cpcal.robot import Pose, normalised, quaternion_from_rotation_vector, quaternion_product, rotation_matrix
from cpcal.solver.interval import Box
from tests.every_key import accepted_changes, unlisted_keys

NEAR = Within(50.0, 1.5)
WIDTH, BEYOND = 0.1, 0.1  # px: half-width of a pixel, and how far beyond it every pixel is off
MM, DEGREES, PIXEL = 0.1, 0.05, 0.1  # what readings are off, and pixels of the run with uncertain poses
TURN = float(np.radians(DEGREES))
SETUPS = ["eye-in-hand", "eye-to-hand"]
RIG_PAIRS = Path(__file__).resolve().parents[3] / "shared" / "data" / "rig_pairs" / "tag_20_cam_6.yaml"


@dataclass
class Run:
    folder: Path
    study: HandEyeStudy
    truth: HandEyeFrames
    result: Any = None  # of either kind


def written(run):
    """The run, with its study in its folder."""
    run.folder.mkdir(exist_ok=True)
    for name, content in hand_eye_files(run.study).items():
        (run.folder / name).write_bytes(content)
    return run


def certified(run, **options):
    run.result = certify_hand_eye(run.study, certificates=written(run).folder, **options)
    save_hand_eye_result(run.result, run.folder)
    return run


def exact_run(folder):
    """Exact poses; every pixel is off by as much as the tolerance allows, on either axis."""
    simulated = simulate_hand_eye(images=6, corners=(3, 3), pitch=80.0, pixel_error=0.0, seed=5)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], simulated.study.pixels.shape)
    pixels = simulated.study.pixels + (WIDTH + BEYOND) * signs
    study = replace(simulated.study, pixels=pixels, half_width=np.full(len(pixels), WIDTH))
    return certified(Run(folder, study, simulated.truth), within=NEAR, tolerance=BEYOND * (1.0 + 1e-9))


def uncertain_run(folder, setup):
    """True poses are readings at the corners of the sets, and every pixel is off by the tolerance."""
    simulated = simulate_hand_eye(setup=setup, images=5, corners=(3, 3), pitch=80.0, pixel_error=0.0, seed=4)
    random = np.random.default_rng(4)
    signs = random.choice([-1.0, 1.0], (5, 6))
    back = normalised(np.concatenate([np.ones((5, 1)), -0.5 * TURN * signs[:, 3:]], axis=1))
    true = simulated.study.poses
    study = replace(
        simulated.study,
        poses=Pose(true.position - MM * signs[:, :3], quaternion_product(back, true.quaternion)),
        pose_half_width=np.tile([MM] * 3 + [TURN] * 3, (5, 1)),
        pixels=simulated.study.pixels + PIXEL * random.choice([-1.0, 1.0], simulated.study.pixels.shape),
    )
    return certified(Run(folder, study, simulated.truth), tolerance=PIXEL * (1.0 + 1e-9))


def wrong_run(folder):
    """The fifth of twelve images has a pose that is off by a centimetre."""
    simulated = simulate_hand_eye(images=12, corners=(3, 3), pitch=60.0, seed=11)
    moved = np.array(simulated.study.poses.position)
    moved[4] += [8.0, -5.0, 4.0]
    study = replace(simulated.study, poses=Pose(moved, simulated.study.poses.quaternion))
    run = written(Run(folder, study, simulated.truth))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wrong_images, "_TRIALS", 8)  # one image of twelve is wrong: most of them begin without it
        run.result = find_wrong_images(study, 1, folder, within=Within(20.0, 0.8))
    save_wrong_images(run.result, folder)
    return run


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    return exact_run(tmp_path_factory.mktemp("exact"))


@pytest.fixture(scope="module", params=SETUPS)
def uncertain(request, tmp_path_factory):
    return uncertain_run(tmp_path_factory.mktemp("uncertain"), request.param)


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    return wrong_run(tmp_path_factory.mktemp("wrong"))


# what is stated holds of the truth ---------------------------------------------------------------------------------


def true_poses(study, signs=None):
    """The readings at corners of the poses' sets; those that made the study, if no others are given."""
    if not study.pose_half_width.any():
        return study.poses
    if signs is None:  # they were drawn first
        signs = np.random.default_rng(4).choice([-1.0, 1.0], (5, 6))
    on = normalised(np.concatenate([np.ones((5, 1)), 0.5 * TURN * signs[:, 3:]], axis=1))
    return Pose(study.poses.position + MM * signs[:, :3], quaternion_product(on, study.poses.quaternion))


def true_values(run):
    """Of a certificate's unknowns at the truth, by the certificate's name; None for those of the frames."""
    study, truth = run.study, run.truth
    turn, shift = replace(study, poses=true_poses(study)).motions
    found = {None: unknowns_of(truth)}
    for one in run.result.ranges.chain.images + run.result.lower.images:
        k = study.images.index(one.image)
        a, b = np.array(one.nominal.turn).reshape(3, 3), np.array(one.nominal.place)
        true_turn = truth.e_rotation @ turn[k] @ truth.f_rotation
        true_place = truth.e_rotation @ (turn[k] @ truth.f_translation + shift[k]) + truth.e_translation
        found[one.certificate] = np.concatenate([(a.T @ true_turn).ravel(), a.T @ (true_place - b)])
    return found


def number(polynomial, x):
    """The value of a polynomial of a certificate, and the sum of its terms' sizes."""
    terms = [float.fromhex(value) * np.prod(x[list(monomial)]) for monomial, value in polynomial]
    return sum(terms), sum(map(abs, terms))


def stated_holds(run):
    """The constraints and boxes that the ranges' certificates state; fails for one that does not hold at the truth."""
    counted = 0
    values = true_values(run)
    for name in run.result.ranges.chain.certificates:
        x = values.get(name, values[None])
        lines = [json.loads(line) for line in (run.folder / name).read_text().splitlines()]
        for line in lines[1 : 1 + lines[0]["constraints"]]:
            body, size = number(line["body"], x)
            for end, sign in (("at_least", -1.0), ("at_most", 1.0)):
                if line[end] is not None:
                    limit, more = number(line[end], x)
                    assert sign * (body - limit) <= 1e-13 * (size + more), (name, line["name"])
                    counted += 1
        claims = lines[1 + lines[0]["constraints"]]
        assert not claims["infeasible"]
        for end, sign in (("lo", -1.0), ("hi", 1.0)):
            off = sign * (x - [float.fromhex(value) for value in claims["enclosure"][end]])
            assert (off <= 1e-12 * (1.0 + np.abs(x))).all(), (name, end, off.max())
    return counted


def test_what_certificates_of_exact_poses_state_holds_at_the_truth_with_pixels_at_the_edge(exact):
    assert stated_holds(exact) > 500
    worst = largest(exact_errors(exact.study, PlacedFrames.of(exact.truth)))
    assert exact.result.eps_lo <= worst <= exact.result.tolerance
    assert exact.result.passes is True


def test_what_certificates_of_uncertain_poses_state_holds_at_the_truth_with_readings_at_corners(uncertain):
    assert stated_holds(uncertain) > 500
    assert uncertain.result.passes is True


def test_links_hold_at_every_corner_of_readings_and_within_the_box_they_speak_of(uncertain):
    """Each image alone, at each corner of its reading, the camera where that puts it: the rows of its link hold."""
    study, truth = uncertain.study, uncertain.truth
    true = replace(study, poses=true_poses(study), pose_half_width=np.zeros_like(study.pose_half_width))
    seen_turn = truth.e_rotation @ true.motions[0] @ truth.f_rotation
    on_hand = true.motions[0] @ truth.f_translation + true.motions[1]
    seen_place = on_hand @ truth.e_rotation.T + truth.e_translation
    file = uncertain.folder / uncertain.result.ranges.chain.links[1].certificate
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    lo, hi = (np.array([float.fromhex(value) for value in lines[0][end]]) for end in ("lo", "hi"))
    checked, least = 0, np.inf
    for signs in product((-1.0, 1.0), repeat=6):
        read = replace(true, poses=true_poses(study, np.tile(signs, (len(study.images), 1))))
        turn, shift = read.motions
        for k, image in enumerate(study.images):
            x_turn = turn[k] @ truth.f_rotation @ seen_turn[k].T
            x_place = turn[k] @ truth.f_translation + shift[k] - x_turn @ seen_place[k]
            x = np.concatenate([x_turn.ravel(), x_place, truth.f_rotation.ravel(), truth.f_translation])
            if (x < lo).any() or (hi < x).any():
                continue
            for line in lines[1 : 1 + lines[0]["constraints"]]:
                if line["name"].startswith(image + " "):
                    body, size = number(line["body"], x)
                    low, high = (number(line[end], x)[0] for end in ("at_least", "at_most"))
                    assert low - 1e-13 * size <= body <= high + 1e-13 * size, line["name"]
                    checked, least = checked + 1, min(least, (high - body) / (high - low), (body - low) / (high - low))
    assert checked > 1000
    assert least < 0.1  # they are near their ends somewhere, so that a part left out would show


def test_ranges_hold_the_truth(exact, uncertain):
    for run in (exact, uncertain):
        x = unknowns_of(run.truth)
        assert (np.array(run.result.ranges.lo) <= x).all()
        assert (x <= np.array(run.result.ranges.hi)).all()


def test_brackets_close_to_a_millionth(exact, uncertain):
    for result in (exact.result, uncertain.result):
        assert result.complete
        assert 0.0 < result.eps_lo <= result.eps_hi <= result.eps_lo * (1.0 + 1e-6)


def test_runs_are_verified_and_read_back(exact, uncertain, wrong):
    for run in (exact, uncertain):
        assert [accepted for accepted, _ in verify_hand_eye(run.folder)] == [True] * 5
        assert load_hand_eye_result(run.folder) == run.result
    assert [accepted for accepted, _ in verify_wrong_images(wrong.folder)] == [True] * 4


def test_all_certificates_of_a_run_have_one_budget(exact, monkeypatch):
    """What each costs is less than what is refused here."""
    costs = []
    for path in exact.folder.glob("*.cert.jsonl"):
        budget = Budget(1 << 40)
        check(path, work=budget)
        costs.append(budget.most - budget.left)
    for name, value in (("check", check), ("RUN_WORK", sum(costs) - 1)):
        monkeypatch.setattr(f"{verify_hand_eye.__module__}.{name}", value)
    assert max(costs) < sum(costs) - 1
    refused = [sentence for accepted, sentence in verify_hand_eye(exact.folder) if not accepted]
    assert len(refused) == 1
    assert f"more work than the {sum(costs) - 1}" in refused[0]


def test_the_wrong_image_is_named_and_proved(wrong):
    found = wrong.result
    assert found.left_out == ("image005",)
    assert [image for image, _ in found.blamed] == ["image005"]
    assert 0.0 < found.eps_lo <= found.eps_hi <= 0.2


def test_the_point_explains_the_pixels_at_its_readings_and_not_at_the_stated_poses(uncertain):
    study, result = uncertain.study, uncertain.result
    assert largest(exact_errors(study, result.point, result.readings)) <= result.eps_hi
    assert largest(exact_errors(study, result.point)) > result.eps_hi
    assert (np.abs(np.array(result.readings)) <= study.pose_half_width).all()


@pytest.mark.parametrize(("setup", "seed"), [("eye-in-hand", 2), ("eye-to-hand", 1)])
def test_the_truth_lies_in_the_ranges_of_its_pixel_error(setup, seed):
    simulated = simulate_hand_eye(setup=setup, images=7, corners=(4, 3), pitch=60.0, seed=seed)
    result = certify_hand_eye(simulated.study, within=NEAR, tolerance=0.2)
    x = unknowns_of(simulated.truth)
    assert result.passes is True
    assert (np.array(result.ranges.lo) <= x).all()
    assert (x <= np.array(result.ranges.hi)).all()
    worst = largest(exact_errors(simulated.study, PlacedFrames.of(simulated.truth)))
    assert result.eps_lo <= worst <= 0.2 + 1e-9


def test_a_tolerance_below_the_bracket_is_refuted(exact):
    result = certify_hand_eye(exact.study, within=NEAR, tolerance=0.8 * exact.result.eps_lo)
    assert result.passes is False
    assert result.ranges.empty


def test_too_many_wrong_images_for_the_study_are_refused(tmp_path):
    study = simulate_hand_eye(images=9, corners=(3, 3), seed=1).study
    with pytest.raises(InputError, match="outliers: is 2 of 9 images"):
        find_wrong_images(study, 2, tmp_path)


# forged numbers ----------------------------------------------------------------------------------------------------


def put(*place, to):
    """A change of data: what stands at a place becomes `to`, or what `to` makes of it."""

    def change(data):
        for key in place[:-1]:
            data = data[key]
        data[place[-1]] = to(data[place[-1]]) if callable(to) else to

    return change


def plus(amount):
    return lambda value: value + amount


def without_one(*place):
    return put(*place, to=lambda values: values[:-1])


UP, DOWN = (lambda v: v * (1 + 1e-9)), (lambda v: v * (1 - 1e-9))
EXACT = {
    "a larger lower end": (put("eps_lo", to=UP), "lower end", "a constraint that is not the study's"),
    "a smaller lower end": (put("eps_lo", to=DOWN), "lower end", "a constraint that is not the study's"),
    "no lower end": (put("eps_lo", to=0.0), "lower end", "a constraint that is not the study's"),
    "a smaller upper end": (put("eps_hi", to=DOWN), "upper end", "not the largest error of a pixel at the point"),
    "a larger upper end": (put("eps_hi", to=UP), "upper end", "not the largest error of a pixel at the point"),
    "another point": (put("point", "camera_position", 0, to=plus(1e-3)), "upper end", "not the largest error"),
    "readings of exact poses": (put("readings", to=[[1e-9] * 6] * 6), "upper end", "of poses that are exact"),
    "a smaller tolerance of the ranges": (put("ranges", "eps", to=DOWN), "ranges", "at another tolerance"),
    "a larger tolerance": (put("tolerance", to=UP), "ranges", "at another tolerance"),
    "no tolerance": (put("tolerance", to=None), "ranges", "at another tolerance"),
    "a range with a larger lower end": (put("ranges", "low", 0, to=plus(1e-3)), "ranges", "do not follow"),
    "a range with a smaller upper end": (put("ranges", "high", 0, to=plus(-1e-3)), "ranges", "do not follow"),
    "a turn with a larger lower end": (put("ranges", "low", 11, to=plus(1e-3)), "ranges", "do not follow"),
    "a turn with a smaller upper end": (put("ranges", "high", 11, to=plus(-1e-3)), "ranges", "do not follow"),
    "a larger lower end of an unknown": (put("ranges", "lo", 9, to=plus(1e-3)), "ranges", "is not the one"),
    "a smaller upper end of an unknown": (put("ranges", "hi", 9, to=plus(-1e-3)), "ranges", "is not the one"),
    "a smaller lower end of an unknown": (put("ranges", "lo", 9, to=plus(-1e-3)), "ranges", "is not the one"),
    "a larger upper end of an unknown": (put("ranges", "hi", 9, to=plus(1e-3)), "ranges", "is not the one"),
    "a wider search": (put("asked", "reach", to=200.0), "ranges", "speaks of another box"),
    "a narrower search": (put("asked", "reach", to=49.0), "ranges", "speaks of another box"),
    "any rotation": (put("asked", "angle", to=None), "ranges", "speaks of another box"),
    "a centre elsewhere": (put("asked", "center", "camera_position", 0, to=plus(300.0)), "box", "not the least-sq"),
    "a target elsewhere": (put("asked", "center", "target_position", 2, to=plus(-1.0)), "box", "not the least-sq"),
    "a camera turned": (put("asked", "center", "camera_quaternion", 1, to=plus(1e-3)), "box", "not the least-sq"),
    "a target turned": (put("asked", "center", "target_quaternion", 2, to=plus(1e-3)), "box", "not the least-sq"),
    "an image more": (put("images", to=7), "box", "the study is another one"),
    "a point more": (put("points", to=55), "box", "the study is another one"),
    "another setup": (put("setup", to="eye-to-hand"), "box", "the study is another one"),
    "a lower bound of an image's pose": (
        put("ranges", "chain", "images", 0, "lo", 11, to=plus(1e-3)), "ranges", "proves other bounds of the pose"),
    "an upper bound of an image's pose": (
        put("ranges", "chain", "images", 0, "hi", 11, to=plus(-1e-3)), "ranges", "proves other bounds of the pose"),
    "another nominal pose": (
        put("ranges", "chain", "images", 0, "nominal", "place", 2, to=plus(1e-3)), "ranges", "is not the study's"),
    "a nominal pose without numbers": (
        put("ranges", "chain", "images", 0, "nominal", "turn", to=[]), "ranges", "is of no image of the study"),
    "a nominal pose that overflows": (
        put("ranges", "chain", "images", 0, "nominal", "turn", 0, to=1e308), "ranges", "too large"),
    "an image less": (without_one("ranges", "chain", "images"), "ranges", "is not the study's"),
    "an image twice": (
        put("ranges", "chain", "images", to=lambda one: [*one, one[0]]), "ranges", "or named twice"),
    "a link less": (without_one("ranges", "chain", "links"), "ranges", "speaks of another box"),
    "no certificate of pixels": (put("ranges", "chain", "pixels", to=[]), "ranges", "is not the one that is proved"),
    "a cut of no image": (
        put("ranges", "chain", "links", 0, "cuts", to=[{"image": "x", "weights": [1.0] * 6}]), "ranges", "is of none"),
    "a cut that is not used": (
        put("ranges", "chain", "links", 0, "cuts", to=[{"image": "image001", "weights": [1.0] * 6}]),
        "ranges", "does not use a cut"),
    "a cut of nothing": (
        put("ranges", "chain", "links", 0, "cuts", to=[{"image": "image001", "weights": [0.0] * 6}]),
        "ranges", "weights that are too large, or none"),
    "a certificate elsewhere": (
        put("lower", "pixels", 0, to="../exact/lower-1.cert.jsonl"), "lower end", "is no name of a certificate"),
    "a certificate with a NUL": (put("lower", "pixels", 0, to="a\0b"), "lower end", "is no name of a certificate"),
    "a certificate that was used": (put("lower", "pixels", 0, to="ranges-1.cert.jsonl"), "lower end", "named twice"),
    "no certificate of the lower end": (
        put("lower", "pixels", to=[]), "lower end", "eps_lo is stated, and no certificate is there"),
    "no frames where there are some": (
        put("ranges", to=lambda one: one | {"lo": [], "hi": [], "low": [], "high": []}),
        "ranges", "does not claim that there are no frames"),
    "a point of the support less": (without_one("support"), "lower end", "the support is not that"),
    "another point of the support": (put("support", 0, 1, to="p0"), "lower end", "the support is not that"),
    "a better image": (put("classical", "images", 0, "largest", to=DOWN), "least squares", "it is other in image001"),
    "a worse image": (put("classical", "images", 0, "largest", to=UP), "least squares", "it is other in image001"),
    "another verdict": (
        put("classical", "images", 0, "ok", to=lambda value: not value), "least squares", "it is other in image001"),
    "an image's name": (put("classical", "images", 0, "image", to="b"), "least squares", "not speak of the study's"),
    "a better classical answer": (put("classical", "largest", to=DOWN), "least squares", "largest error is another"),
}  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_a_forged_number_is_refused(exact, refused, name):
    change, what, reason = EXACT[name]
    refused(exact.folder, "handeye.json", change, verify_hand_eye, what, reason)


UNCERTAIN = {
    "a larger lower end": (put("eps_lo", to=UP), "lower end", "a constraint that is not the study's"),
    "a reading above its half-width": (put("readings", 0, 0, to=MM * (1 + 1e-9)), "upper end", "beyond its half-width"),
    "a reading below its half-width": (put("readings", 0, 0, to=-MM * (1 + 1e-9)), "upper end", "beyond its half"),
    "a turn above its half-width": (put("readings", 4, 5, to=TURN * (1 + 1e-9)), "upper end", "beyond its half-width"),
    "a turn below its half-width": (put("readings", 4, 5, to=-TURN * (1 + 1e-9)), "upper end", "beyond its half"),
    "no readings": (put("readings", to=[]), "upper end", "are not those of the study's poses"),
    "a reading too few": (without_one("readings"), "upper end", "are not those of the study's poses"),
    "a reading without a number": (without_one("readings", 0), "upper end", "are not those of the study's poses"),
    "another reading": (put("readings", 0, to=lambda one: [0.5 * v for v in one]), "upper end", "not the largest"),
    "a reading of least squares": (
        put("classical", "readings", 0, 1, to=plus(1e-3)), "least squares", "its readings of the poses are others"),
    "one beyond its half-width": (put("classical", "readings", 0, 1, to=0.11), "least squares", "beyond its half"),
    "a narrower range": (put("ranges", "low", 0, to=plus(1e-3)), "ranges", "do not follow"),
    "a better pose of an image": (
        put("ranges", "chain", "images", 2, "hi", 9, to=1e-4), "ranges", "proves other bounds of the pose"),
    "an image that is another": (
        put("ranges", "chain", "images", 2, "image", to="image001"), "ranges", "is not the study's|another box"),
    "a lower end of another image": (
        put("lower", "images", 0, "image", to="image099"), "lower end", "is of no image of the study"),
    "bounds of no pose": (put("lower", "images", 0, "lo", to=[0.0]), "lower end", "leaves no pose, and bounds are"),
    "another weight of a cut": (
        put("ranges", "chain", "links", -1, "cuts", 0, "weights", 3, to=plus(1.0)), "ranges", "the study's|not use"),
    "a cut that is stated twice": (
        put("ranges", "chain", "links", -1, "cuts", to=lambda one: [*one, one[-1]]), "ranges", "a cut is stated twice"),
    "pixels of poses that are not exact": (
        put("ranges", "chain", "pixels", to=["lower-image-1.cert.jsonl"]), "ranges", "as if the robot's poses were"),
    "a wider search": (put("asked", "reach", to=3000.0), "ranges", "speaks of another box"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNCERTAIN)
@pytest.mark.parametrize("uncertain", SETUPS[:1], indirect=True)
def test_a_forged_number_of_uncertain_poses_is_refused(uncertain, refused, name):
    change, what, reason = UNCERTAIN[name]
    refused(uncertain.folder, "handeye.json", change, verify_hand_eye, what, reason)


@pytest.mark.parametrize("name", ["a larger lower end", "a reading above its half-width", "a narrower range"])
@pytest.mark.parametrize("uncertain", SETUPS[1:], indirect=True)
def test_a_forged_number_of_the_other_setup_is_refused(uncertain, refused, name):
    change, what, reason = UNCERTAIN[name]
    refused(uncertain.folder, "handeye.json", change, verify_hand_eye, what, reason)


def blamed(image):
    return put("blamed", 0, 0, to=image)


WRONG = {
    "a larger lower end": (put("eps_lo", to=UP), "lower end", "a group is at another tolerance"),
    "no lower end": (put("eps_lo", to=0.0), "lower end", "a group is at another tolerance"),
    "no groups": (put("groups", to=[]), "lower end", "not enough groups"),
    "a group less": (without_one("groups"), "lower end", "not enough groups"),
    "more wrong images": (put("outliers", to=2), "lower end", "not enough groups"),
    "fewer wrong images": (put("outliers", to=0), "upper end", "other images are left out than may be"),
    "a smaller upper end": (put("eps_hi", to=DOWN), "upper end", "not the largest error of a pixel"),
    "another point": (put("point", "target_position", 0, to=plus(1e-3)), "upper end", "not the largest error"),
    "nothing left out": (put("left_out", to=[]), "upper end", "other images are left out than may be"),
    "another left out": (put("left_out", 0, to="image001"), "upper end", "not the largest error of a pixel"),
    "a stranger left out": (put("left_out", 0, to="image099"), "upper end", "other images are left out than may be"),
    "one group twice": (put("groups", to=lambda one: [one[0], one[0]]), "lower end", "have an image in common"),
    "an image twice in a group": (
        put("groups", 0, "images", to=lambda one: [*one, one[0]]), "lower end", "have an image in common"),
    "a stranger in a group": (put("groups", 0, "images", 0, to="image099"), "lower end", "a group is of other images"),
    "an image less in a group": (without_one("groups", 0, "images"), "lower end", "certificate|study|image"),
    "a group at another tolerance": (put("groups", 0, "eps", to=UP), "lower end", "at another tolerance"),
    "another image blamed": (blamed("image001"), "wrong images", "that is not left out"),
    "one blamed twice": (put("blamed", to=lambda one: [*one, *one]), "wrong images", "that is not left out, or twice"),
    "one reason too few": (without_one("blamed", 0, 1), "wrong images", "not enough groups"),
    "a reason without the image": (
        put("blamed", 0, 1, 0, "images", to=lambda one: [v for v in one if v != "image005"]),
        "wrong images", "a group is of other images"),
    "a reason at a larger tolerance": (put("blamed", 0, 1, 0, "eps", to=UP), "wrong images", "at another tolerance"),
    "a reason at a smaller tolerance": (put("blamed", 0, 1, 0, "eps", to=DOWN), "wrong images", "tolerance|not the st"),
    "a centre elsewhere": (put("asked", "center", "target_position", 0, to=plus(300.0)), "box", "not the least-sq"),
    "a wider search": (put("asked", "reach", to=30.0), "lower end", "speaks of another box"),
    "any rotation": (put("asked", "angle", to=None), "wrong images", "speaks of another box"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_forged_number_of_wrong_images_is_refused(wrong, refused, name):
    change, what, reason = WRONG[name]
    refused(wrong.folder, "handeye-wrong.json", change, verify_wrong_images, what, reason)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (put("asked", "angle", to=720.0), "an angle of 720.0 degrees"),
        (put("asked", "angle", to=-1.0), "an angle of -1.0 degrees"),
        (put("asked", "angle", to="nan"), "an angle of nan degrees"),
        (put("asked", "reach", to=-1.0), "a reach of -1.0 mm"),
        (put("asked", "reach", to="inf"), "a reach of inf mm"),
        (put("asked", "center", "target_quaternion", to=[0.0] * 4), "a quaternion is of no rotation"),
        (put("asked", "center", "target_quaternion", to=["nan"] * 4), "a quaternion is of no rotation"),
        (put("asked", "center", "target_position", to=[0.0]), "no list of 3"),
        (put("point", "camera_position", 0, to="inf"), "point.camera_position is inf"),
        (put("eps_lo", to="nan"), "eps_lo is nan"),
        (put("eps_hi", to="inf"), "eps_hi is inf"),
    ],
)
def test_a_number_that_is_none_is_refused(exact, wrong, tmp_path, change, reason):
    for run, name, verify in (
        (exact, "handeye.json", verify_hand_eye),
        (wrong, "handeye-wrong.json", verify_wrong_images),
    ):
        shutil.copytree(run.folder, tmp_path / name)
        data = json.loads((tmp_path / name / name).read_text())
        change(data)
        (tmp_path / name / name).write_text(json.dumps(data))
        with pytest.raises(InputError, match=f"{name}: lacks or garbles a field: .*{re.escape(reason)}.* -> run cpcal"):
            verify(tmp_path / name)


@pytest.mark.parametrize("place", [("ranges", "lo", 3), ("ranges", "high", 3), ("classical", "largest")])
def test_an_infinity_of_a_hand_eye_run_is_refused(exact, tmp_path, place):
    shutil.copytree(exact.folder, tmp_path / "run")
    data = json.loads((tmp_path / "run" / "handeye.json").read_text())
    put(*place, to="inf")(data)
    (tmp_path / "run" / "handeye.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"{place[0]}.{place[1]} is inf"):
        verify_hand_eye(tmp_path / "run")


# forged studies and certificates -----------------------------------------------------------------------------------


def column(table, name, change, row=1):
    """A table with one number changed."""
    lines = table.splitlines()
    cells = lines[row].split(",")
    place = lines[0].split(",").index(name)
    cells[place] = repr(change(float(cells[place])))
    return "\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]]) + "\n"


@pytest.mark.parametrize("name", ["u", "v", "X", "Y", "du"])
@pytest.mark.parametrize("what", ["ranges", "lower end"])
def test_a_certificate_of_another_point_is_refused(exact, refused, name, what):
    row = 1 + next(
        k
        for k, (image, point) in enumerate(zip(exact.study.image, exact.study.names, strict=True))
        if (exact.study.images[image], point) == exact.result.support[0]
    )
    refused(
        exact.folder,
        "points.csv",
        lambda text: column(text, name, plus(1e-3), row),
        verify_hand_eye,
        what,
        "begins with ranges that are not"
        if what == "lower end"
        else "a constraint that is not the study's|another box",
    )


@pytest.mark.parametrize("axis", ["dx", "dy", "dz", "drx", "dry", "drz"])
@pytest.mark.parametrize("uncertain", SETUPS[:1], indirect=True)
def test_readings_beyond_smaller_half_widths_are_refused(uncertain, refused, axis):
    used = np.abs(np.array(uncertain.result.readings)[:, ["dx", "dy", "dz", "drx", "dry", "drz"].index(axis)])
    row = 1 + int(np.argmax(used))
    refused(
        uncertain.folder,
        "poses.csv",
        lambda text: column(text, axis, lambda _: 0.999 * float(used.max()), row),
        verify_hand_eye,
        "upper end",
        "beyond its half-width",
    )


@pytest.mark.parametrize("end", ["lo", "hi"])
@pytest.mark.parametrize("unknown", [0, 23])
@pytest.mark.parametrize("name", ["ranges-links-1", "ranges-links-2", "ranges-1", "lower-1"])
def test_a_certificate_that_begins_in_a_smaller_box_is_refused(exact, refused, name, unknown, end):
    """One end is nearer by a last bit, which the checker cannot see: its steps prove as much."""

    def nearer(text):
        head, rest = text.split("\n", 1)
        data = json.loads(head)
        towards = np.inf if end == "lo" else -np.inf
        value = np.nextafter(float.fromhex(data[end][unknown]), towards).hex()
        mantissa, power = value.split("p")
        sign, digits = ("-", mantissa[3:]) if value.startswith("-") else ("", mantissa[2:])
        whole, part = digits.split(".")
        data[end][unknown] = f"{sign}{int(whole + part, 16):#x}p{int(power) - 4 * len(part):+d}"
        return json.dumps(data, separators=(",", ":")) + "\n" + rest

    what = "lower end" if name.startswith("lower") else "ranges"
    refused(
        exact.folder, f"{name}.cert.jsonl", nearer, verify_hand_eye, what, f"{name}.cert.jsonl speaks of another box"
    )


def test_frames_that_put_the_target_behind_the_camera_are_refused(exact, tmp_path):
    """A camera that is turned by half a turn about its y axis shows every point at the same u, and v upside down."""
    shutil.copytree(exact.folder, tmp_path / "run")
    flipped = np.array(exact.study.pixels)
    flipped[:, 1] = 2.0 * exact.study.camera.center[1] - flipped[:, 1]
    written(Run(tmp_path / "run", replace(exact.study, pixels=flipped), exact.truth))
    point = exact.result.point
    turned = quaternion_product(np.array(point.camera_quaternion), np.array([0.0, 0.0, 1.0, 0.0]))
    for quaternion in (point.camera_quaternion, tuple(turned.tolist())):
        forged = replace(exact.result, point=replace(point, camera_quaternion=quaternion), eps_hi=0.1)
        save_hand_eye_result(forged, tmp_path / "run")
        sentence = verify_hand_eye(tmp_path / "run")[3][1]
        behind = "the point puts the target behind the camera"
        assert (behind in sentence) == (quaternion != point.camera_quaternion), sentence


def test_a_point_outside_of_the_box_is_refused(exact, refused):
    """It is the point that attains the upper end; the box is asked to be smaller than its distance."""
    refused(
        exact.folder,
        "handeye.json",
        put("asked", to=lambda one: one | {"reach": 1e-3}),
        verify_hand_eye,
        "upper end",
        "the point is not in the box",
    )


def test_a_lower_end_that_begins_with_ranges_of_no_certificate_is_refused(exact, tmp_path):
    """A box without frames anywhere near, chosen by the forger, in which nothing explains a pixel to 100 px."""
    shutil.copytree(exact.folder, tmp_path / "run")
    x = unknowns_of(exact.truth)
    x[21:] += 3000.0
    box = Box(UNKNOWNS, x - 1e-6, x + 1e-6)
    proof = prove(exact.study, 100.0, box, about="forged")
    assert proof.refuted
    proof.write(tmp_path / "run" / "lower-1.cert.jsonl")
    data = json.loads((exact.folder / "handeye.json").read_text())
    steps = [json.loads(line) for line in (tmp_path / "run" / "lower-1.cert.jsonl").read_text().splitlines()]
    names = [steps[1 + place]["name"].split()[0].split("/") for _, place in steps[-1]["rows"]]
    data["support"] = [list(pair) for pair in dict.fromkeys(map(tuple, names)) if len(pair) == 2]
    data["eps_lo"], data["lower"] = 100.0, {"images": [], "links": [], "pixels": ["lower-1.cert.jsonl"]}
    for lo, hi in ((box.lo.tolist(), box.hi.tolist()), ([], [])):
        chain = {"images": [], "links": [], "pixels": []}
        sides = {"low": [0.0] * 12, "high": [0.0] * 12} if lo else {"low": [], "high": []}
        data["ranges"] = {"eps": data["tolerance"], **sides, "lo": lo, "hi": hi, "chain": chain}
        (tmp_path / "run" / "handeye.json").write_text(json.dumps(data))
        found = verify_hand_eye(tmp_path / "run")
        assert found[1] == (False, "ranges: REFUSED, they are stated, and no certificate is there")
        assert not found[2][0]
        reason = "it begins with ranges that are not proved" if lo else "speaks of another box"
        assert reason in found[2][1]


def test_links_that_rest_on_narrower_poses_than_are_proved_are_refused(exact, tmp_path):
    """Made by the writer itself: each certificate is accepted, and follows from the poses that the run states. Only
    where these are compared with what the images' own certificates prove is it seen that they are others."""
    shutil.copytree(exact.folder, tmp_path / "run")
    result = exact.result
    sets = []
    for one in result.ranges.chain.images:
        lo, hi = np.array(one.lo), np.array(one.hi)
        inner = {"lo": tuple((lo + 0.05 * (hi - lo)).tolist()), "hi": tuple((hi - 0.05 * (hi - lo)).tolist())}
        sets.append(replace(one, **inner))
    links = prove_linked(
        exact.study, sets, result.asked.center, result.ranges.eps, result.asked.box, "", np.inf, lambda text: None
    )
    for k, (proof, _) in enumerate(links[: len(result.ranges.chain.links)]):
        proof.write(tmp_path / "run" / f"ranges-links-{k + 1}.cert.jsonl")
    for chosen, reason in (
        (result.ranges.chain.images, "states a constraint that is not the study's"),
        (tuple(sets), "proves other bounds of the pose in image001"),
    ):
        chain = replace(result.ranges.chain, images=chosen)
        save_hand_eye_result(replace(result, ranges=replace(result.ranges, chain=chain)), tmp_path / "run")
        accepted, sentence = verify_hand_eye(tmp_path / "run")[1]
        assert not accepted
        assert reason in sentence


def test_a_certificate_with_a_forged_constraint_is_refused(exact, refused):
    def lowered(text):
        lines = text.splitlines()
        place = next(k for k, line in enumerate(lines) if '"name":"image' in line)
        assert '"at_most":[]' in lines[place]
        lines[place] = lines[place].replace('"at_most":[]', '"at_most":[[[],"-0x1p-60"]]')
        return "\n".join(lines) + "\n"

    refused(exact.folder, "lower-1.cert.jsonl", lowered, verify_hand_eye, "lower end", "not the study's")


# certificates without a step ---------------------------------------------------------------------------------------


def test_a_certificate_that_holds_no_step_is_verified(exact, tmp_path):
    """It claims the box that it begins with. A time limit that is over leaves some."""
    options = {"within": NEAR, "tolerance": exact.result.tolerance, "time_limit": 0.0}
    run = certified(Run(tmp_path / "run", exact.study, exact.truth), **options)
    (name,) = run.result.ranges.chain.pixels
    assert json.loads((run.folder / name).read_text().splitlines()[-1])["infeasible"] is False
    found = verify_hand_eye(run.folder)
    assert [accepted for accepted, _ in found] == [True] * 5
    assert found[2][1] == "lower end: NOT CERTIFIED, eps >= 0"


@pytest.mark.real_data
@pytest.mark.skipif(not RIG_PAIRS.exists(), reason=f"{RIG_PAIRS} is absent")
def test_a_run_of_real_pairs_whose_links_say_nothing_is_verified(tmp_path):
    """Single images fit to some ten px, so the links between them hold no step, and the pixels had no time."""
    hand, seen = read_pose_pairs(RIG_PAIRS, setup="eye-to-hand")
    chosen = np.linspace(0, len(hand.position) - 1, 25).astype(int)
    study = study_of_pairs(hand, seen, setup="eye-to-hand").part(chosen)
    run = certified(Run(tmp_path / "run", study, None), tolerance=9.0, time_limit=0.0)
    chain = run.result.ranges.chain
    for name in (chain.links[-1].certificate, *chain.pixels):
        assert json.loads((run.folder / name).read_text().splitlines()[-1])["infeasible"] is False  # the claims
    assert [accepted for accepted, _ in verify_hand_eye(run.folder)] == [True] * 5


# boxes and the frames in them --------------------------------------------------------------------------------------


def random_turns(random, count, degrees):
    """Rotation vectors (rad) of that angle about random axes, and their matrices."""
    axis = random.normal(size=(count, 3))
    vectors = np.radians(degrees) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return vectors, rotation_matrix(quaternion_from_rotation_vector(vectors))


@pytest.mark.parametrize("degrees", [1e-3, 1.0, 20.0, 45.0, 59.0, 100.0, 179.0])
def test_ranges_of_a_box_hold_the_turns_of_all_rotations_in_it(degrees):
    """Of both frames, whose boxes are as small as float64 allows, so that nothing else makes up for a loss."""
    random = np.random.default_rng(1)
    widths = []
    for _ in range(20):
        vectors, turned = random_turns(random, 2, degrees)
        quaternions = normalised(random.normal(size=(2, 4)))
        about = PlacedFrames(*(part for q in quaternions.tolist() for part in ((1.0, 2.0, 3.0), tuple(q))))
        x = np.zeros(24)
        for k, first in enumerate((0, 12)):
            x[first : first + 9] = (turned[k] @ rotation_matrix(quaternions[k])).ravel()
        low, high = parameter_ranges(x - 1e-15, x + 1e-15, about)
        for k in (0, 1):
            place = slice(6 * k + 3, 6 * k + 6)
            stated = np.degrees(vectors[k])
            assert (np.array(low)[place] <= stated).all()
            assert (stated <= np.array(high)[place]).all()
            widths.append(np.max(np.array(high)[place] - np.array(low)[place]))
    assert degrees > 50.0 or max(widths) <= 0.2 * degrees  # and they say something


@pytest.mark.parametrize("angle", [None, 1e-3, 1.5, 60.0, 179.9, 180.0])
def test_the_box_that_was_asked_for_holds_all_frames_within_its_angle_and_reach(angle):
    random = np.random.default_rng(2)
    frames = [tuple(random.normal(size=3).tolist()), tuple(normalised(random.normal(size=4)).tolist())] * 2
    asked = AskedBox(PlacedFrames(*frames), 50.0, angle)
    x = np.array([float(value) for value in asked.center.unknowns])
    _, turned = random_turns(random, 2000, 180.0 if angle is None else angle)
    ends = []
    for first in (0, 12):
        entries = (turned @ x[first : first + 9].reshape(3, 3)).reshape(-1, 9)
        assert (asked.box.lo[first : first + 9] <= entries + 1e-15).all()
        assert (entries - 1e-15 <= asked.box.hi[first : first + 9]).all()
        ends.append(entries.min(axis=0) - asked.box.lo[first : first + 9])
        ends.append(asked.box.hi[first : first + 9] - entries.max(axis=0))
        for end, sign in ((asked.box.lo, -1.0), (asked.box.hi, 1.0)):
            assert (sign * (end[first + 9 : first + 12] - x[first + 9 : first + 12]) >= 50.0).all()
            assert (sign * (end[first + 9 : first + 12] - x[first + 9 : first + 12]) <= 50.0 + 1e-12).all()
    assert angle != 1.5 or np.max(ends) < 0.03  # and no others that are far away
    for quaternion in random.normal(size=(20, 4)):
        there = replace(asked.center, camera_quaternion=tuple(normalised(quaternion).tolist()))
        assert asked.holds(there) or angle is not None


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("frame", ["camera_position", "target_position"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_frames_beyond_the_reach_are_not_in_the_box(axis, frame, sign):
    center = PlacedFrames((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (4.0, 5.0, 6.0), (0.5, 0.5, 0.5, 0.5))
    for away, inside in ((50.0, True), (50.001, False)):
        place = list(getattr(center, frame))
        place[axis] += sign * away
        assert AskedBox(center, 50.0, None).holds(replace(center, **{frame: tuple(place)})) == inside


# every key ---------------------------------------------------------------------------------------------------------


def test_the_table_has_every_key_of_a_run(exact, uncertain, wrong):
    for run, name in ((exact, "handeye.json"), (uncertain, "handeye.json"), (wrong, "handeye-wrong.json")):
        assert unlisted_keys(run.folder / name) == []


@pytest.mark.nightly
def test_every_change_outside_of_the_information_is_refused(exact, uncertain, wrong, tmp_path):
    for number, (run, name, verify) in enumerate((
        (exact, "handeye.json", verify_hand_eye),
        (uncertain, "handeye.json", verify_hand_eye),
        (wrong, "handeye-wrong.json", verify_wrong_images),
    )):  # fmt: skip
        folder = tmp_path / str(number)
        shutil.copytree(run.folder, folder)

        def verified(folder=folder, verify=verify):
            try:
                return all(accepted for accepted, _ in verify(folder))
            except InputError:
                return False

        assert verified()
        less = re.compile(r"blamed: .* to \[\]")  # who names no image claims nothing of any
        assert [change for change in accepted_changes(folder / name, verified) if not less.fullmatch(change)] == []
