"""The camera: a pinhole and a lens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem, shown
from cpcal.common.values import Value, frozen_array
from cpcal.vision.lens_kernel import all_bent, unbent
from cpcal.vision.lens_models import LENSES, Lens

BROWN = "brown"  # the model that cameras are calibrated with; only it has a covariance
CAMERA_NUMBERS = ("fx", "fy", "cx", "cy", *LENSES[BROWN].names)


@dataclass(frozen=True, eq=False)
class Camera(Value):
    """What makes pixels of directions.

    width, height  of the image, pixels
    focal          (2,) fx, fy in pixels
    center         (2,) cx, cy in pixels; (0, 0) is the centre of the top-left pixel
    distortion     the lens's numbers; (5,) k1, k2, p1, p2, k3 of the model "brown"
    model          of the lens: "brown", "rational" or "fisheye" (`cpcal.vision.lens_models`)

    With (x, y) = (X / Z, Y / Z) the image of a point is center + focal * d(x, y), and d is the lens.

    Raises InputError when the numbers make no camera.
    """

    width: int
    height: int
    focal: Floats
    center: Floats
    distortion: Floats
    model: str = BROWN

    def __post_init__(self) -> None:
        if self.model not in LENSES:
            raise InputError([Problem("camera model", f"is {shown(self.model)}", f"give one of {', '.join(LENSES)}")])
        for name, size in (("focal", 2), ("center", 2), ("distortion", len(self.lens.names))):
            array = frozen_array(getattr(self, name))
            if array.shape != (size,) or not np.isfinite(array).all():
                raise InputError([Problem(f"camera {name}", f"is not {size} finite numbers", "give pixels, see docs")])
            object.__setattr__(self, name, array)
        if min(self.width, self.height) < 1 or not (self.focal > 0.0).all():
            raise InputError([Problem("camera", "has no positive size or focal length", "give them in pixels")])

    @property
    def lens(self) -> Lens:
        return LENSES[self.model]

    @property
    def numbers(self) -> Floats:
        """fx, fy, cx, cy and the lens's numbers; (9,) in the order of CAMERA_NUMBERS for the model "brown"."""
        return np.concatenate([self.focal, self.center, self.distortion])

    @cached_property
    def packed(self) -> Floats:
        """(13,) as compiled code takes them: fx, fy, cx, cy and the lens (`cpcal.vision.lens_kernel`)."""
        return np.concatenate([self.focal, self.center, self.lens.packed(self.distortion)])

    def with_numbers(self, numbers: Floats) -> Camera:
        """The same image size and model, other numbers. Raises InputError when they make no camera."""
        return Camera(self.width, self.height, numbers[:2], numbers[2:4], numbers[4:], self.model)

    def project(self, points: npt.ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 3) mm in the camera frame, Z > 0."""
        p = np.asarray(points, dtype=np.float64)
        return self.pixels(p[..., :2] / p[..., 2:])

    def pixels(self, normalised: npt.ArrayLike) -> Floats:
        """Pixels (..., 2) of the directions (x, y, 1), given as (..., 2)."""
        return np.asarray(self.center + self.focal * self.distorted(normalised))

    def distorted(self, normalised: npt.ArrayLike) -> Floats:
        """d(x, y), (..., 2) -> (..., 2)."""
        return self._bent(normalised)[..., :2]

    def distortion_jacobian(self, normalised: npt.ArrayLike) -> Floats:
        """The derivatives of d by (x, y), (..., 2) -> (..., 2, 2)."""
        return self._bent(normalised)[..., [[2, 3], [3, 4]]]

    def _bent(self, normalised: npt.ArrayLike) -> Floats:
        """d (2) and the three parts of its symmetric derivative, (..., 5)."""
        points = np.array(normalised, dtype=np.float64, order="C")
        out = np.empty((*points.shape[:-1], 5))
        all_bent(self.packed[4:], points.reshape(-1, 2), out.reshape(-1, 5))
        return out

    def normalised(self, pixels: npt.ArrayLike) -> Floats:
        """The directions (..., 2) that pixels (..., 2) show, by Newton's method; nan where there is none nearby."""
        wanted = np.ascontiguousarray((np.asarray(pixels, dtype=np.float64) - self.center) / self.focal)
        found = np.empty(wanted.shape)
        unbent(self.packed[4:], wanted.reshape(-1, 2), found.reshape(-1, 2))
        return found


# 1024 x 768 pixels of 4.65 micrometres behind an objective of 4.2 mm; an ordinary lens, a little off its centre
DELTALAB_CAMERA = Camera(
    1024,
    768,
    focal=np.array([903.2, 903.2]),
    center=np.array([515.3, 380.6]),
    distortion=np.array([-0.18, 0.07, 4e-4, -3e-4, 0.0]),
)
