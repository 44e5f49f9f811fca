"""Campaigns whose reading sets come from pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.common.errors import InputError
from cpcal.files import load_campaign, save_campaign
from cpcal.models.sight import Frames, PixelBoxes, PoseSet, campaign_of, enclose_pose
from cpcal.robot import Pose, compose, inverse_kinematics, transformed
from cpcal.simulate import simulate_study
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET

ALL = np.arange(len(DELTALAB_TARGET.dots))
STUDY = simulate_study(seed=2, runs=1, validation_runs=1, random_poses=1, noise=0.0)
TRUTH = STUDY.truth
assert TRUTH is not None
POSES = TRUTH.mobile_in_base(STUDY.calibration)
TRUE = [Pose(POSES.position[k], POSES.quaternion[k]) for k in range(0, 64, 6)]
ROWS = len(TRUE)


def pose_set(pose: Pose, seed: int, frames: Frames, spoiled: float = 0.0) -> PoseSet:
    assert TRUTH is not None
    seen = compose(compose(TRUTH.camera, pose), TRUTH.target)
    pixels = DELTALAB_CAMERA.project(transformed(seen, DELTALAB_TARGET.points))
    inside = np.flatnonzero(((pixels > 1.0) & (pixels < [1022.0, 766.0])).all(axis=1))
    pixels = pixels[inside] + np.random.default_rng(seed).uniform(-0.05, 0.05, (len(inside), 2))
    pixels[3] += spoiled
    return enclose_pose(PixelBoxes.around(inside, pixels, 0.05), DELTALAB_TARGET, DELTALAB_CAMERA, frames=frames)


def test_a_campaign_of_pose_sets_holds_the_truth(tmp_path: Path) -> None:
    """From pixels to a certificate: all parameters with which the model holds are enclosed, the true ones too."""
    assert TRUTH is not None
    frames = Frames(TRUTH.camera, TRUTH.target)
    sets = [pose_set(pose, k, frames) for k, pose in enumerate(TRUE)]
    lengths = np.array([inverse_kinematics(TRUTH.robot, pose) for pose in TRUE])
    campaign = campaign_of(sets, lengths, STUDY.robot, length_radius=0.03, run=["a"] * ROWS)
    save_campaign(campaign, tmp_path / "campaign")
    again = load_campaign(tmp_path / "campaign")
    assert again == campaign
    for k, pose in enumerate(TRUE):
        row = PoseSet(
            sets[k].verdict,
            Pose(again.position[k], again.quaternion[k]),
            again.position_radius[k],
            again.rotation_radius[k],
            frames,
        )
        assert pose in row
    assert campaign.position_radius.min() > 0.0
    assert campaign.position_radius.max() < 0.1
    assert (campaign.length_radius == 0.03).all()
    assert len(np.unique(campaign.rotation_radius)) == 3 * ROWS  # each row has its own
    [leg] = cpcal.certify(campaign, delta=10.0, legs=[2]).legs
    assert leg.bracket.hi == 0.0
    assert TRUTH.robot.parameters[1] in leg.bracket.enclosure
    assert leg.bracket.enclosure.width.max() < 4.0


def test_what_is_not_proved_makes_no_campaign() -> None:
    assert TRUTH is not None
    frames = Frames(TRUTH.camera, TRUTH.target)
    good, bad = pose_set(TRUE[0], 0, frames), pose_set(TRUE[1], 1, frames, spoiled=10.0)
    with pytest.raises(InputError, match="pose set 1"):
        campaign_of([good, bad], np.zeros((2, 6)), STUDY.robot)
    other = pose_set(TRUE[1], 1, Frames())
    with pytest.raises(InputError, match="different frames"):
        campaign_of([good, other], np.zeros((2, 6)), STUDY.robot)
