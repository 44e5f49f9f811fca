"""Points of one of cpcal's own targets in photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cpcal.handeye.board_photos import NOTHING, Found, study_of_found
from cpcal.handeye.hand_eye_study import HandEyeStudy, Setup
from cpcal.robot import transformed
from cpcal.vision.camera import Camera
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import Target

TARGET = "target:"  # how --board names a target.toml


def study_of_target_photos(
    folder: Path, target: Target, *, camera: Camera, poses: dict[str, tuple[float, ...]], setup: Setup
) -> tuple[HandEyeStudy, list[str]]:
    """As `cpcal.handeye.board_photos.study_of_photos`, of photographs of a target.

    An outline's centre is not the image of the dot's centre; the difference at the pose that the image shows is taken
    off. Raises as that function does.
    """

    def find(image: Any) -> Found:
        try:
            seen = measure_pose(image, target, camera)
        except NotMeasured:
            return NOTHING
        numbers = seen.numbers
        bias = predicted_centers(target, camera, seen.pose) - camera.project(transformed(seen.pose, target.points))
        return [f"d{n}" for n in numbers.tolist()], seen.centers - bias[numbers], target.points[numbers]

    return study_of_found(folder, find, camera=camera, poses=poses, setup=setup)
