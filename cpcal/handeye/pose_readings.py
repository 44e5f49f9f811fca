"""Residuals in pixels of frames and of readings of the robot's poses, and their derivatives.

A reading of pose i is (position + d, R(1, w / 2) R), with d in mm and w in rad within its half-widths, in the base
frame. All points of an image have the same reading, so six unknowns an image say all that a robot error does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.common.values import Value, frozen_array
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy
from cpcal.handeye.pixel_model import PARAMETERS, PixelModel, cross, moved
from cpcal.robot import Pose, quaternion_product

READING = 6  # unknowns of a reading: d and w


@dataclass(frozen=True, eq=False)
class ReadFrames(Value):
    """Frames, and a reading (d, w) of each image's pose: (n, 6) mm and rad."""

    frames: HandEyeFrames
    readings: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "readings", frozen_array(self.readings))

    @staticmethod
    def stated(frames: HandEyeFrames, study: HandEyeStudy) -> ReadFrames:
        """At the stated poses."""
        return ReadFrames(frames, np.zeros((len(study.images), READING)))


def read_study(study: HandEyeStudy, readings: Floats) -> HandEyeStudy:
    """The study with each pose at its reading, taken as exact."""
    turn = np.concatenate([np.ones((len(readings), 1)), 0.5 * readings[:, 3:]], axis=1)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    poses = Pose(study.poses.position + readings[:, :3], quaternion_product(turn, study.poses.quaternion))
    return replace(study, poses=poses, pose_half_width=np.zeros_like(readings))


class ReadingModel:
    """The residuals (2 N,) of frames with readings, first all along u and then all along v."""

    def __init__(self, study: HandEyeStudy) -> None:
        self.study = study
        self.size = PARAMETERS + READING * len(study.images)

    def __call__(self, at: ReadFrames) -> Floats:
        """(2 N,) px; infinite where a point is not in front of the camera."""
        return PixelModel(read_study(self.study, at.readings))(at.frames)

    def blocks(self, at: ReadFrames) -> tuple[Floats, Floats]:
        """Derivatives (2 N, 12) by the motions of the frames, and (2 N, 6) by those of each point's own reading."""
        there = read_study(self.study, at.readings)
        model, frames = PixelModel(there), at.frames
        on = there.points @ frames.f_rotation.T + frames.f_translation
        turn, _ = there.motions
        own = frames.e_rotation @ turn[there.image]  # (N, 3, 3) of what is on the target's side of the pose
        place = there.poses.position[there.image]
        if there.setup == "eye-to-hand":
            lever = np.einsum("nij,nj->ni", turn[there.image], on)
            by = np.concatenate([np.broadcast_to(frames.e_rotation, own.shape), -frames.e_rotation @ cross(lever)], 2)
        else:
            by = np.concatenate([-own, own @ cross(on - place)], axis=2)
        # R(1, w / 2) turns by (I + [w / 2]x) dw / (1 + |w / 2|^2) when w changes by dw
        half = 0.5 * at.readings[:, 3:]
        turned = (np.eye(3) + cross(half)) / (1.0 + np.sum(half**2, axis=1))[:, None, None]
        by[:, :, 3:] = by[:, :, 3:] @ turned[there.image]
        return model.jacobian(frames), model.of_points(frames, by)

    def jacobian(self, at: ReadFrames) -> Floats:
        """(2 N, size): frames first, then the readings image by image."""
        frames, own = self.blocks(at)
        whole = np.zeros((len(own), self.size))
        whole[:, :PARAMETERS] = frames
        place = PARAMETERS + READING * np.tile(self.study.image, 2)
        for k in range(READING):
            whole[np.arange(len(own)), place + k] = own[:, k]
        return whole

    def moved(self, at: ReadFrames, step: Floats) -> ReadFrames:
        """By a step (size,), readings kept within their half-widths."""
        width = self.study.pose_half_width
        readings = np.clip(at.readings + step[PARAMETERS:].reshape(-1, READING), -width, width)
        return ReadFrames(moved(at.frames, step[:PARAMETERS]), readings)

    def reach(self, at: ReadFrames) -> Floats:
        """What counts as a step of one: a turn of 1 rad, and the way that it moves a point."""
        frames = PixelModel(self.study).reach(at.frames)
        own = np.tile(np.repeat([frames[3], 1.0], 3), len(self.study.images))
        return np.concatenate([frames, own])

    def room(self, at: ReadFrames) -> tuple[Floats, Floats]:
        """Least and greatest step (size,) that the half-widths leave."""
        width, free = self.study.pose_half_width, np.full(PARAMETERS, np.inf)
        low, high = (-width - at.readings).ravel(), (width - at.readings).ravel()
        return np.concatenate([-free, low]), np.concatenate([free, high])


def by_images(study: HandEyeStudy) -> list[Indices]:
    """The places, among 2 N residuals, of each image's."""
    both = np.tile(study.image, 2)
    return [np.flatnonzero(both == k) for k in range(len(study.images))]
