"""Hand-eye studies: in files and back, mistakes with their lines; the classical answer and the minimax fit."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cpcal.checker.frames import GIVEN
from cpcal.common.errors import InputError
from cpcal.models import hand_eye_fit
from cpcal.models.frames import PlacedFrames
from cpcal.models.hand_eye import SimulatedHandEye, load_hand_eye, save_hand_eye, simulate_hand_eye
from cpcal.models.hand_eye_fit import (
    PixelModel,
    ReadFrames,
    best_frames,
    classical_answer,
    estimated_half_widths,
    excess,
    minimax_fit,
    opencv_answers,
    places,
)
from cpcal.models.hand_eye_sources import with_half_widths
from cpcal.robot import Pose
from tests.models.conftest import cart

SETUPS = ["eye-in-hand", "eye-to-hand"]


@pytest.mark.parametrize("setup", SETUPS)
def test_without_errors_the_truth_is_found(setup):
    simulated = simulate_hand_eye(setup=setup, images=8, pixel_error=0.0, seed=3)
    found = classical_answer(simulated.study)
    assert np.abs(found.residuals).max() < 1e-8
    for name in ("e_rotation", "e_translation", "f_rotation", "f_translation"):
        np.testing.assert_allclose(getattr(found.frames, name), getattr(simulated.truth, name), atol=1e-6)
    cv2 = pytest.importorskip("cv2")
    others, truth = opencv_answers(simulated.study, found.alone), PlacedFrames.of(simulated.truth)
    assert len(others) == (7 if hasattr(cv2, "calibrateHandEye") else 0)
    for method, camera in others.items():
        np.testing.assert_allclose(camera.position, truth.camera_position, atol=1e-3, err_msg=method)
        assert abs(camera.quaternion @ truth.camera_quaternion) == pytest.approx(1.0, abs=1e-9), method


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_of_a_cart_on_a_floor_all_is_found_but_the_height_whose_error_is_said(tilt, seed):
    """It turns about one axis, but for a tilt (rad) that single images see less well: angles about it that the closed
    form leaves open come from the translations."""
    study, truth = cart(seed, tilt=tilt)
    found = classical_answer(study)
    assert found.rms < 0.1
    off = (places(found.frames)[0] - places(truth)[0]).reshape(2, 4)[:, :3]
    assert np.abs(off[:, :2]).max() < 0.5
    assert len(found.remarks) == 2
    for said, name, frame, error in zip(found.remarks, ("camera", "target"), ("hand", "base"), off[:, 2], strict=True):
        assert f"the place of the {name} along (0.00, 0.00, 1.00) of the {frame} frame" in said
        known = re.search(r"frame to ([\d.]+) mm", said)
        assert abs(error) < 4.0 * float(known[1]) if known else "frame not at all" in said


@pytest.mark.parametrize("off", [0.0, 0.3, 20.0])
@pytest.mark.parametrize("uncertain", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_known_positions_and_tilts_are_heeded_by_both_fits_and_nothing_near_is_better(seed, uncertain, off):
    """Two or more, up to all eight, at the truth or `off` mm or degrees beside it; a cart leaves heights to them."""
    random = np.random.default_rng(seed)
    simulated = SimulatedHandEye(*cart(seed, images=6)) if seed else simulate_hand_eye(images=6, seed=seed)
    study, true = simulated.study, places(simulated.truth)[0]
    half = random.uniform(0.01, 0.5, 8)
    middle = true + off * random.choice([-1.0, 0.0, 1.0], 8) + 0.9 * half * random.uniform(-1.0, 1.0, 8)
    chosen = sorted(random.choice(8, random.integers(2, 9), replace=False))
    known = tuple((list(GIVEN)[k], float(middle[k] - half[k]), float(middle[k] + half[k])) for k in chosen)
    study = with_half_widths(replace(study, known=known), "0.1,0.02" if uncertain else "0,0")
    answer, model, (low, high) = classical_answer(study), PixelModel(study), study.given
    fits = [ReadFrames(answer.frames, answer.readings)]
    fits.append(minimax_fit(model, fits[0])[0])
    for at, cost in zip(fits, (lambda at: np.sum(model(at) ** 2), lambda at: excess(model, at)), strict=True):
        place = places(at.frames)[0]
        assert (low - 1e-8 < place).all()
        assert (place < high + 1e-8).all()
        for _ in range(0 if uncertain else 200):
            step = random.normal(size=12) * np.tile([1e-6] * 3 + [1e-3] * 3, 2)
            assert cost(model.moved(at, step)) > cost(at) * (1.0 - 1e-5)
    assert excess(model, fits[1]) <= excess(model, fits[0])
    contradicted = any("contradict the given values" in said for said in answer.remarks)
    assert contradicted == (off == 20.0) or off == 0.3


def test_the_best_frames_are_found_from_a_start_whose_own_fit_ends_in_another_minimum():
    study = simulate_hand_eye(images=6, seed=3).study
    answer, model = classical_answer(study), PixelModel(study)
    near, least = minimax_fit(model, ReadFrames(answer.frames, answer.readings))
    away = np.random.default_rng(6).normal(size=model.size) * model.reach(near)
    far = answer._replace(frames=model.moved(near, away).frames)
    assert excess(model, best_frames(study, far)) > 100.0 * least  # the minimum that this start lies by
    assert excess(model, best_frames(study, far, np.random.default_rng(0))) == pytest.approx(least, rel=1e-9)


def test_the_fit_goes_on_from_the_best_minimum_so_far_where_many_lie_side_by_side():
    """Turns of the robot that are wrong by radians: places around the classical answer alone lead to 58 px or more."""
    errors = {"pixel_error": 8.0, "position_error": 5.0, "rotation_error": 2.0}
    study = simulate_hand_eye(setup="eye-to-hand", images=8, corners=(3, 3), pitch=12.0, seed=4, **errors).study
    found = best_frames(study, classical_answer(study), np.random.default_rng(0))
    assert excess(PixelModel(study), found) < 56.0


def test_a_hand_that_does_not_turn_is_refused():
    study = simulate_hand_eye(images=8, seed=3).study
    still = Pose(study.poses.position, np.tile([1.0, 0.0, 0.0, 0.0], (8, 1)))
    with pytest.raises(InputError, match="do not turn"):
        classical_answer(replace(study, poses=still))


# ------------------------------------------------------------------------------------------------------------------
# Errors of the robot's poses: one reading an image, shared by all its points.

MM, DEGREES = 0.1, 0.05


def uncertain(setup, images=6, seed=4):
    turn = float(np.radians(DEGREES))
    found = simulate_hand_eye(
        setup=setup, images=images, corners=(4, 3), pitch=60.0, position_error=MM, rotation_error=turn, seed=seed
    )
    return replace(found.study, pose_half_width=np.tile([MM] * 3 + [turn] * 3, (images, 1))), found.truth


@pytest.mark.parametrize("setup", SETUPS)
def test_derivatives_by_readings_are_those_of_differences(setup):
    study, truth = uncertain(setup)
    residuals, random = (
        PixelModel(replace(study, pose_half_width=1e3 * study.pose_half_width)),
        np.random.default_rng(1),
    )
    at = ReadFrames(truth, random.uniform(-1.0, 1.0, (6, 6)) * 1e-2)
    slope, step = residuals.jacobian(at), 1e-6
    for k in range(residuals.size):
        one = np.zeros(residuals.size)
        one[k] = step
        differences = (residuals(residuals.moved(at, one)) - residuals(residuals.moved(at, -one))) / (2.0 * step)
        assert np.abs(slope[:, k] - differences).max() <= 1e-5 * (1.0 + np.abs(differences).max())


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (2, 3))])
def test_half_widths_that_are_estimated_hold_what_the_poses_are_off(seed):
    """Of robots that are off in positions, in turns, or in both; of a perfect one next to nothing is left."""
    mm, turn = ((0.3, 1e-3), (0.3, 0.0), (0.0, 1e-3), (0.0, 0.0))[seed]
    made = {"images": 12, "corners": (4, 3), "pitch": 60.0, "pixel_error": 0.05}
    study = simulate_hand_eye(position_error=mm, rotation_error=turn, seed=seed, **made).study
    widths = estimated_half_widths(study)
    for width, true, little in zip(widths, (mm, turn), (0.05, 1e-4), strict=True):
        assert true <= width < 2.0 * true + little
    stated = with_half_widths(study, "estimated")
    assert (stated.pose_half_width == np.repeat(widths, 3)).all()
    assert stated.provenance["half_widths"].startswith("estimated from the data: ")
    assert with_half_widths(stated, "0.1,0.05").provenance["half_widths"] == "stated: 0.1 mm, 0.05 degrees"
    assert classical_answer(stated).rms < 0.06


def test_programs_of_many_readings_give_the_frames_of_those_of_few(monkeypatch):
    study, _ = uncertain("eye-in-hand")
    answer = classical_answer(study)
    start = ReadFrames(answer.frames, answer.readings)
    values = []
    for many in (1000, 0):
        monkeypatch.setattr(hand_eye_fit, "_MANY", many)
        values.append(hand_eye_fit.minimax_fit(PixelModel(study), start)[1])
    assert values[1] == pytest.approx(values[0], rel=1e-3)


@pytest.fixture
def folder(tmp_path):
    save_hand_eye(simulate_hand_eye(images=4, corners=(3, 3), seed=1).study, tmp_path / "study")
    return tmp_path / "study"


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_study_is_read_back_bit_for_bit(tmp_path, setup):
    study = simulate_hand_eye(setup=setup, images=4, corners=(3, 3), seed=1).study
    widths = np.linspace(0.0, 0.1, 24).reshape(4, 6)
    wide = replace(study, half_width=np.linspace(0.1, 0.3, len(study.image)), pose_half_width=widths)
    for one in (study, wide):
        assert load_hand_eye(save_hand_eye(one, tmp_path / "study")) == one


def _replace(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_all_problems_are_told_at_once(folder):
    _replace(folder / "handeye.toml", "eye-in-hand", "eye-on-foot")
    _replace(folder / "poses.csv", "image002,", "image002,x")
    _replace(folder / "poses.csv", "image003,", "image001,")
    _replace(folder / "points.csv", "image001,p2,", "image001,p1,")
    with pytest.raises(InputError) as raised:
        load_hand_eye(folder)
    text = str(raised.value)
    assert "setup is 'eye-on-foot'" in text
    assert "poses.csv:3" in text
    assert "poses.csv:4: image 'image001' was given on line 2 already -> give each image once" in text
    assert "points.csv:3: image 'image001' point 'p1' was given on line 2 already" in text


def test_images_on_one_side_only_are_named(folder):
    lines = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join([*lines[:-1], lines[-1].replace("image004", "image009")]) + "\n")
    with pytest.raises(InputError) as raised:
        load_hand_eye(folder)
    assert "'image004' has no pose" in str(raised.value)
    assert "'image009' has no points" in str(raised.value)
