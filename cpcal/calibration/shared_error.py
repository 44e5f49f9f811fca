"""Errors of poses that all images share: what the camera's covariance and the target's deviations make of them.

Repeats do not show them and no mean is free of them. If every pose is off by the same (dp, dr), a fit puts that into
the frames: camera in base is off by dr and by dp + dr x d, d the way from the target to the camera; or target in mobile
by dr and dp. The shared errors of different poses are not the same, so that each frame is off by less than this: what
is added to the frames' deviations is an upper estimate, the same in all directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.numbers import about


@dataclass(frozen=True)
class SharedError:
    """Standard deviations, mm and rad.

    pose      (6,) of a pose's position and rotation vector in the camera frame, root mean squares over a study's runs
    distance  mm, root mean square, from the camera to the target
    """

    pose: tuple[float, ...]
    distance: float

    def __post_init__(self) -> None:
        """Raises ValueError for what is not six deviations and a distance."""
        if len(self.pose) != 6 or not min(*self.pose, self.distance) >= 0.0:
            raise ValueError("a shared error is not six deviations and a distance")

    @classmethod
    def of(cls, shared: Floats, position: Floats) -> SharedError:
        """Of runs (N, 6), of targets at (N, 3) mm in the camera frame."""
        sigma = np.sqrt(np.mean(shared**2, axis=0))
        return cls(tuple(sigma.tolist()), float(np.sqrt(np.mean(np.sum(position**2, axis=1)))))

    @property
    def camera_in_base(self) -> Floats:
        """(6,) that the frame of the camera may take of it."""
        return self._frame(self.distance)

    @property
    def target_in_mobile(self) -> Floats:
        """(6,) that the frame of the target may take of it."""
        return self._frame(0.0)

    def _frame(self, arm: float) -> Floats:
        moved, turned = max(self.pose[:3]), max(self.pose[3:])
        return np.repeat([np.hypot(moved, arm * turned), turned], 3)

    @property
    def sentence(self) -> str:
        """What they are, and where they are counted."""
        moved, turned = about(max(self.pose[:3]), 2), about(float(np.degrees(max(self.pose[3:]))), 2)
        return (
            f"Errors of camera and target that all images share: up to {moved} mm and {turned} degrees (standard "
            "deviations) of a pose. No repeat shows them and no mean makes them smaller: reading sets and the frames' "
            "U hold them in full; the table of repeats, standard errors of the fits and what validation expects do not."
        )
