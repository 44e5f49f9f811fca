"""Simulated campaigns and studies: frames, noise, imperfect legs, backlash; what 7 parameters cannot describe."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256, save_study
from cpcal.files.folders import study_bytes, table_bytes
from cpcal.robot import (
    DELTALAB,
    KinematicsError,
    Pose,
    inverse_kinematics,
    leg_vectors,
    quaternion_conjugate,
    quaternion_product,
    rotation_matrix,
)
from cpcal.simulate import simulate, simulate_study, true_robot
from cpcal.simulate.campaigns import (
    EULER_SIGMA,
    LENGTH_SIGMA,
    POSITION_SIGMA,
    STROKE,
    assembled,
    assembled_with,
    clearance_sides,
    configurations,
    leg_gaps,
    mechanisms_of,
    streams,
)
from tests.changed import mobile_in_base


def test_the_same_seed_gives_the_same_campaign_bit_for_bit():
    first, second = (simulate(seed=7, runs=2, random_poses=5, joint_error=1.0) for _ in range(2))
    assert first == second
    assert campaign_sha256(first) == campaign_sha256(second)
    assert campaign_sha256(simulate(seed=8)) != campaign_sha256(simulate(seed=7))


def test_the_64_extremal_configurations_are_distinct_with_every_leg_at_an_end():
    campaign = simulate(seed=0, noise=0.0, deviation=0.0)
    total = campaign.length + DELTALAB.offset
    assert_allclose(np.minimum(abs(total - 345), abs(total - 485)), 0.0, atol=1e-9)
    assert len({tuple(row) for row in np.round(campaign.length).tolist()}) == 64
    both = np.concatenate([campaign.position, 300 * campaign.quaternion], axis=1)
    distance = np.linalg.norm(both[:, None] - both, axis=2) + 1e3 * np.eye(64)
    assert distance.min() > 40  # some pairs differ in rotation alone
    assert campaign.length[0b100101] == pytest.approx([140, 0, 140, 0, 0, 140])
    assert campaign.position[:, 2].min() > 200
    assert rotation_matrix(campaign.quaternion)[:, 2, 2].min() > np.cos(np.radians(40))


@pytest.mark.parametrize("truncate", [3.0, 1.0])
def test_truncated_noise_leaves_the_truth_inside_the_reading_sets(truncate):
    noisy = simulate(seed=5, runs=60, truncate=truncate, factor=truncate)
    clean = simulate(seed=5, runs=60, noise=0.0)
    assert (abs(noisy.position - clean.position) < noisy.position_radius).all()
    assert (abs(noisy.length - clean.length) < noisy.length_radius).all()
    # the true rotation is R(1, s) R(q_k), and |2 s_i| <= r_i
    turn = quaternion_product(clean.quaternion, quaternion_conjugate(noisy.quaternion))
    size = abs(2 * turn[:, 1:] / turn[:, :1])
    assert (size < noisy.rotation_radius).all()
    assert (size.max(axis=0) > 0.9 * noisy.rotation_radius[0]).all()


def test_all_senseless_options_are_named_at_once():
    with pytest.raises(InputError) as caught:
        simulate(seed=-1, runs=0, random_poses=1.5, joint_error=-1.0, factor=float("nan"), noise=-1, truncate=0)
    named = [problem.where for problem in caught.value.problems]
    assert sorted(named) == sorted(
        f"option {name}" for name in ("seed", "runs", "random_poses", "joint_error", "factor", "noise", "truncate")
    )
    with pytest.raises(InputError, match="stroke"):
        simulate(seed=0, stroke=(140.0, 0.0))
    with pytest.raises(InputError, match="random_poses"):
        simulate(seed=0, extremal=False)
    with pytest.raises(InputError, match="within 10,000,000"):
        simulate(seed=0, runs=1_000_000)


def test_a_robot_that_cannot_be_assembled_is_refused():
    with pytest.raises(KinematicsError, match="no pose found for 1 of 2 rows"):
        assembled(DELTALAB, np.array([[70.0] * 6, [0.0, 900.0, 0.0, 0.0, 0.0, 900.0]]), (0.0, 140.0))


def test_provenance_without_a_truth_has_no_true_robot():
    campaign = simulate(seed=0)
    for provenance in ({"true_parameters": "rubbish"}, {"true_parameters": "[" * 15_000}, {}):
        assert true_robot(dataclasses.replace(campaign, provenance=provenance)) is None


LARGE = {  # mm; the gain is relative
    "axis_offset": 20.0, "backlash": 20.0, "sag": 20.0, "gain": 0.2, "joint_error": 20.0,
}  # fmt: skip
READINGS = configurations(np.tile(np.array(STROKE)[:, None], 6), streams(5)[2], random_poses=20, extremal=True)[1]
IDEAL = assembled(DELTALAB, READINGS, STROKE)


def sampled(seed=1, **sizes):
    return mechanisms_of({"seed": seed, "stroke": STROKE, "friction": 0.0} | dict.fromkeys(LARGE, 0.0) | sizes)


@pytest.mark.parametrize("name", LARGE)
def test_poses_satisfy_the_six_leg_equations_to_rounding(name):
    mechanisms = sampled(**{name: LARGE[name]})
    pose = assembled_with(DELTALAB, mechanisms, READINGS, IDEAL)
    gaps = leg_gaps(DELTALAB, mechanisms, READINGS, pose, clearance_sides(DELTALAB, mechanisms, pose))
    assert np.abs(gaps).max() < 1e-10
    assert np.abs(pose.position - IDEAL.position).max() > 1.0


def test_a_lower_axis_offset_moves_the_end_of_the_leg_towards_it():
    """By trigonometry in the plane of the first axis and the leg, and not by the code's vectors."""
    mechanisms = sampled(axis_offset=7.0)
    pose = assembled_with(DELTALAB, mechanisms, READINGS, IDEAL)
    legs = leg_vectors(DELTALAB, pose)
    along = np.einsum("kni,ni->kn", legs, mechanisms.base_axis)
    across = np.sqrt(np.sum(legs**2, axis=-1) - along**2)
    assert_allclose(np.hypot(along, across - mechanisms.base_offset), 345 + READINGS, rtol=1e-12)


def test_legs_that_carry_the_platform_are_compressed_and_their_forces_balance_it():
    upright = Pose(np.array([0.0, 0.0, 359.41]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert (clearance_sides(DELTALAB, sampled(backlash=1.0), upright) == -1).all()
    side = clearance_sides(DELTALAB, sampled(backlash=1.0), IDEAL)
    assert 0.02 < (side > 0).mean() < 0.3  # in extremal poses some legs hold the platform down


def test_mechanisms_that_fit_no_pose_are_refused():
    with pytest.raises(KinematicsError, match="imperfections"):
        assembled_with(DELTALAB, sampled(gain=-0.9), READINGS, IDEAL)


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


def test_all_senseless_options_of_a_study_are_named_at_once(tmp_path):
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
