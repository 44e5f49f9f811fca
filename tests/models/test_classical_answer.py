"""The classical answer and the minimax fit of simulated studies."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.hand_eye import HandEyeStudy, simulate_hand_eye
from cpcal.models.hand_eye_fit import PARAMETERS, PixelModel, classical_answer, excess, minimax_fit
from cpcal.robot import Pose

SETUPS = ["eye-in-hand", "eye-to-hand"]


@pytest.mark.parametrize("setup", SETUPS)
def test_without_errors_the_truth_is_found(setup):
    simulated = simulate_hand_eye(setup=setup, images=8, pixel_error=0.0, seed=3)
    found = classical_answer(simulated.study)
    assert found.largest < 1e-8
    for name in ("e_rotation", "e_translation", "f_rotation", "f_translation"):
        np.testing.assert_allclose(getattr(found.frames, name), getattr(simulated.truth, name), atol=1e-6)


@pytest.mark.parametrize("setup", SETUPS)
def test_the_derivatives_are_those_of_the_residuals(setup):
    simulated = simulate_hand_eye(setup=setup, images=4, seed=3)
    model = PixelModel(simulated.study)
    at, step = model.stated(simulated.truth), 1e-5 * np.random.default_rng(0).normal(size=PARAMETERS)
    difference = 0.5 * (model(model.moved(at, step)) - model(model.moved(at, -step)))
    np.testing.assert_allclose(difference, model.jacobian(at) @ step, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_minimax_fit_is_no_worse_than_the_truth_and_the_least_squares(seed):
    simulated = simulate_hand_eye(images=8, corners=(4, 3), seed=seed)
    model = PixelModel(simulated.study)
    start = model.stated(classical_answer(simulated.study).frames)
    _, value = minimax_fit(model, start)
    assert value <= min(excess(model, model.stated(simulated.truth)), excess(model, start))


def test_a_hand_that_turns_about_one_axis_only_is_named():
    study = simulate_hand_eye(images=8, seed=3).study
    angles = np.linspace(0.0, 2.0, 8)
    turned = np.stack([np.cos(angles / 2), 0 * angles, 0 * angles, np.sin(angles / 2)], axis=1)
    fields = {name: getattr(study, name) for name in study.__dataclass_fields__}
    one_axis = HandEyeStudy(**fields | {"poses": Pose(study.poses.position, turned)})
    with pytest.raises(InputError, match="robot_poses"):
        classical_answer(one_axis)
