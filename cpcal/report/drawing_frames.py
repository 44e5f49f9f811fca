"""Parameters in the frames of the robot's drawing, where a study found how camera and target stand in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.results import Result
from cpcal.robot import rotation_matrix

if TYPE_CHECKING:
    from cpcal.calibration import CalibrationRecord

FRAME = (
    "a: base joint centre, in the base frame of the robot's drawing; b: mobile joint centre, in its mobile frame; "
    "l: length offset. These frames are estimates of the study: certified values were moved by them, ranges are the "
    "hulls of the moved boxes."
)
_ROUNDING = 1e-9  # mm, more than moving a box in float64 can lose


@dataclass(frozen=True, eq=False)
class DrawingFrames:
    """Camera in the base frame and target in the mobile frame: rotations (3, 3) and positions (3,), mm."""

    camera: tuple[Floats, Floats]
    target: tuple[Floats, Floats]

    @classmethod
    def of(cls, record: CalibrationRecord) -> DrawingFrames:
        camera, target = (
            (rotation_matrix(np.array([frame.quaternion]))[0], np.array(frame.position))
            for frame in (record.frames.camera_in_base, record.frames.target_in_mobile)
        )
        return cls(camera, target)

    def point(self, x: Floats) -> Floats:
        """Parameters (n,); those of the model, after l, stay."""
        return self._moved(x, lambda rotation, at, part: rotation @ part + at)

    def box(self, lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
        """A box that holds all parameters of the box `lo`, `hi` (n,)."""
        radius = self._moved(0.5 * (hi - lo), lambda rotation, _, part: np.abs(rotation) @ part)
        middle = self.point(0.5 * (lo + hi))
        return middle - radius - _ROUNDING, middle + radius + _ROUNDING

    def _moved(self, x: Floats, move: object) -> Floats:
        assert callable(move)
        parts = [move(*self.camera, x[:3]), move(*self.target, x[3:6]), x[6:]]
        return np.concatenate(parts)


def frames_of_run(result: Result, record: CalibrationRecord, where: str) -> DrawingFrames:
    """The frames of the study that the run's campaign comes from. Raises InputError where the record is of another."""
    if record.campaign_sha256 != result.campaign_sha256:
        what = "holds the frames of another study: the SHA-256 of its campaign differs"
        raise InputError([Problem(where, what, "name the folder that cpcal calibrate wrote with the run's campaign")])
    return DrawingFrames.of(record)


def check_movable(result: Result) -> None:
    """InputError for a model whose own parameters depend on the frames."""
    if result.model.name not in ("plain", "gain", "lateral"):
        what = f"has the model {result.model.name!r}, whose own parameters depend on the frames"
        raise InputError([Problem("run", what, "export it in the campaign's frames")])
