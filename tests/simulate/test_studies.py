"""Simulated studies: the frames, the truth, the noise of tables 2 and 3, backlash in two modes, determinism."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.common.errors import InputError
from cpcal.files import save_study
from cpcal.files.folders import study_bytes, table_bytes
from cpcal.robot import inverse_kinematics, quaternion_conjugate, quaternion_product
from cpcal.simulate import simulate_study
from cpcal.simulate.campaigns import EULER_SIGMA, LENGTH_SIGMA, POSITION_SIGMA, mechanisms_of
from tests.changed import mobile_in_base

SMALL = {"runs": 2, "validation_runs": 2, "random_poses": 5}


def files(study):
    return study_bytes(study), table_bytes(study.calibration), table_bytes(study.validation)


@pytest.mark.parametrize("seed", range(2))
def test_a_perfect_study_satisfies_the_seven_parameter_equations_once_the_frames_are_undone(seed):
    study = simulate_study(seed=seed, noise=0.0, **SMALL)
    for table in (study.calibration, study.validation):
        poses = mobile_in_base(study.truth, table)
        assert_allclose(inverse_kinematics(study.truth.robot, poses), table.length, atol=1e-9)
    assert mechanisms_of(json.loads(study.provenance["options"])).perfect


@pytest.mark.parametrize(("images", "share"), [(3, 1.0), (0, 1 / np.sqrt(10))])
def test_the_noise_is_that_of_tables_2_and_3(images, share):
    """Single images scatter as Table 3 says, a run's mean of ten images by the root of ten less."""
    size = {"seed": 2, "runs": 80, "validation_runs": 1, "random_poses": 1, "images": images}
    noisy, clean = (simulate_study(**size, noise=noise).calibration for noise in (1.0, 0.0))
    assert_allclose((noisy.position - clean.position).std(axis=0), share * np.array(POSITION_SIGMA), rtol=0.04)
    turn = quaternion_product(noisy.quaternion, quaternion_conjugate(clean.quaternion))
    scatter = (2 * turn[:, 1:] / turn[:, :1]).std(axis=0)
    assert_allclose(scatter, share * np.radians(EULER_SIGMA), rtol=0.04)
    length = noisy.length - clean.length
    assert_allclose(length[:: max(images, 1)].std(axis=0), LENGTH_SIGMA, rtol=0.04)
    assert np.array_equal(length, np.repeat(length[:: max(images, 1)], max(images, 1), axis=0))  # once a run


def test_all_senseless_options_are_named_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        simulate_study(seed=-1, runs=0, images=-1, sag=-1.0, gain=float("nan"), truncate=0, stroke=(1.0, 1.0))
    named = [problem.where for problem in caught.value.problems]
    stated = ("seed", "images", "runs", "sag", "gain", "truncate", "stroke")
    assert sorted(named) == sorted(f"option {name}" for name in stated)
    with pytest.raises(InputError, match="within 10,000,000"):
        simulate_study(seed=0, runs=1_000_000)
    with pytest.raises(InputError, match="option gain"):
        simulate_study(seed=0, gain=1.0)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save_study(simulate_study(seed=0, **SMALL), tmp_path / "file")
