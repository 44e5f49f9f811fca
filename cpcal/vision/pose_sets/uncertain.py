"""What is known of camera and target beforehand, as sets: the camera's numbers, the places of the target's dots.

The camera's nine numbers are `center + spread @ t`, the same t in every image, with |t_j| <= 1 (intervals, or a box in
any directions) or |t| <= 1 (an ellipsoid, such as a calibration's). Each dot is at its place plus an error of its own,
in a box. No distribution is assumed; that the true numbers are in these sets is stated, not proved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.solver.interval import IntervalArray
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, Camera
from cpcal.vision.pose_sets.enclosed import ENGINE, exact
from cpcal.vision.target import Target

LARGEST_SCALE = 0.1  # of a plate's error, as a share
_COUNT = len(CAMERA_NUMBERS)


@dataclass(frozen=True, eq=False)
class CameraSet(Value):
    """Cameras whose numbers fx, fy, cx, cy, k1, k2, p1, p2, k3 are those of `camera` plus `spread @ t`.

    spread  (9, k), in each number's unit; k = 0: this camera alone
    ball    whether t is in the unit ball; else in the unit cube

    Raises InputError for another lens model, or a spread that is none.
    """

    camera: Camera
    spread: Floats = field(default_factory=lambda: np.zeros((_COUNT, 0)))
    ball: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "spread", frozen_array(self.spread))
        problems = []
        if self.camera.model != BROWN:
            what = f"has a lens of the model {self.camera.model}"
            problems.append(Problem("camera", what, f"pose sets are proved for the model {BROWN}: calibrate with it"))
        if self.spread.ndim != 2 or len(self.spread) != _COUNT or not np.isfinite(self.spread).all():
            what = f"has the shape {self.spread.shape}, or a number that is not finite"
            problems.append(Problem("camera spread", what, f"give (9, k), of {', '.join(CAMERA_NUMBERS)}"))
        if problems:
            raise InputError(problems)
        if not (self.camera.focal > self.reach[:2]).all():
            raise InputError([Problem("camera spread", "allows a focal length of zero", "give a narrower set")])

    @classmethod
    def of(cls, camera: Camera | CameraSet) -> CameraSet:
        """An exact camera, or the set that is given."""
        return camera if isinstance(camera, CameraSet) else cls(camera)

    @classmethod
    def intervals(cls, camera: Camera, half_widths: npt.ArrayLike) -> CameraSet:
        """Each number by itself within (9,) half-widths >= 0. Raises InputError."""
        widths = np.asarray(half_widths, dtype=np.float64)
        if widths.shape != (_COUNT,) or not (np.isfinite(widths) & (widths >= 0.0)).all():
            remedy = f"give nine numbers >= 0, of {', '.join(CAMERA_NUMBERS)}"
            raise InputError([Problem("camera half-widths", f"are {widths.tolist()}", remedy)])
        return cls(camera, np.diag(widths)[:, widths > 0.0])

    @classmethod
    def ellipsoid(cls, camera: Camera, covariance: Floats, factor: float) -> CameraSet:
        """All numbers whose Mahalanobis distance from the camera's is at most `factor`: (9, 9) covariance.

        A factor of 5 holds the truth of a calibration with honest covariance in 99.7 % of all cases (chi-square, nine
        degrees of freedom: 5.0 is the root of 25.3). Raises InputError.
        """
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.shape != (_COUNT, _COUNT) or not np.isfinite(matrix).all() or not 0.0 < factor < np.inf:
            remedy = "give (9, 9), as `cpcal detect --calibrate` writes it, and a factor > 0"
            raise InputError([Problem("camera covariance", f"has the shape {matrix.shape}, factor {factor}", remedy)])
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        safe = np.where(scale > 0.0, scale, 1.0)
        values, vectors = np.linalg.eigh(matrix / np.outer(safe, safe))
        held = values > 1e-12 * values[-1]
        return cls(camera, factor * safe[:, None] * vectors[:, held] * np.sqrt(values[held]), ball=True)

    @property
    def size(self) -> int:
        """How many unknowns t there are."""
        return int(self.spread.shape[1])

    def most(self, rows: IntervalArray) -> IntervalArray:
        """The largest value of `rows @ t` over all t, enclosed: rows (..., k)."""
        size = exact(rows.mag)
        return ENGINE.sqrt(ENGINE.sum(ENGINE.sqr(size), -1)) if self.ball else ENGINE.sum(size, -1)

    @property
    def reach(self) -> Floats:
        """(9,) how far each number may be off, at most."""
        return np.asarray(self.most(exact(self.spread)).hi)

    @property
    def numbers(self) -> IntervalArray:
        """(9,) bounds of the numbers."""
        return IntervalArray.around(self.camera.numbers, self.reach)


@dataclass(frozen=True, eq=False)
class TargetSet(Value):
    """Targets whose dot i is within `half_widths[i]` of its place: (n, 3) mm along x, y and z of the target.

    scale  the plate as a whole, dots' radius included, is 1 + tau times such a one, |tau| <= scale: as a print shrinks

    Raises InputError for half-widths or a scale that are none.
    """

    target: Target
    half_widths: Floats
    scale: float = 0.0

    def __post_init__(self) -> None:
        widths, shape = frozen_array(self.half_widths), (len(self.target.dots), 3)
        if widths.shape != shape:
            what = f"have the shape {widths.shape}"
            raise InputError([Problem("target half-widths", what, f"give one number, (3,) or {shape}, mm")])
        if not (np.isfinite(widths) & (widths >= 0.0)).all():
            raise InputError([Problem("target half-widths", "are negative or not finite", "give mm >= 0")])
        if not 0.0 <= self.scale <= LARGEST_SCALE:
            what = f"is {self.scale}"
            raise InputError([Problem("target scale", what, f"give a share from 0 to {LARGEST_SCALE:g}")])
        object.__setattr__(self, "half_widths", widths)

    @classmethod
    def of(cls, target: Target | TargetSet) -> TargetSet:
        """An exact target, or the set that is given."""
        return target if isinstance(target, TargetSet) else cls.within(target, 0.0)

    @classmethod
    def within(cls, target: Target, half_widths: npt.ArrayLike, scale: float = 0.0) -> TargetSet:
        """One half-width, or one for each coordinate (3,), for all dots; or (n, 3). Raises InputError."""
        widths = np.asarray(half_widths, dtype=np.float64)
        alike = widths.ndim == 0 or widths.shape == (3,)
        each = np.tile(widths * np.ones(3), (len(target.dots), 1)) if alike else widths
        return cls(target, each, float(scale))
