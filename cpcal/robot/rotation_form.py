"""The forms that rotations come in, by name, and their way to unit quaternions, scalar first.

quaternion-wxyz, quaternion-xyzw    scalar first, scalar last
matrix                              R, which maps mobile to base; nine columns r11 r12 ... r33 are its rows
vector-rad, vector-deg              rotation vector: axis times angle
euler-xyz-deg, euler-ZYX-rad, ...   three angles in the order of the letters: small letters turn about the fixed
                                    axes of the base frame, capitals about those of the turned one (as in scipy)
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Bools, Floats, as_floats
from cpcal.common.errors import InputError, Problem, shown
from cpcal.robot.rotation import (
    normalised,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
)
from cpcal.robot.units import ANGLES

ROUNDED = 0.01  # logs round: a quaternion's norm, a matrix's R'R, may be this far from 1
TAIT_BRYAN = tuple("".join(p) for p in itertools.permutations("xyz"))
PROPER = tuple(a + b + a for a, b in itertools.permutations("xyz", 2))
SEQUENCES = tuple(s for name in TAIT_BRYAN + PROPER for s in (name, name.upper()))
_FORMS = (
    "give quaternion-wxyz, quaternion-xyzw, matrix, vector-rad, vector-deg, or Euler angles such as euler-xyz-deg "
    "(fixed axes) or euler-ZYX-rad (turned axes)"
)
_AXES = {"x": 1, "y": 2, "z": 3}


@dataclass(frozen=True)
class RotationForm:
    """How rotations are written. `kind` is quaternion, matrix, vector or euler; `detail` the order of its numbers."""

    kind: str
    detail: str = ""
    unit: str = "rad"

    @classmethod
    def named(cls, name: str) -> RotationForm:
        """The form of that name. Raises InputError, which lists the forms."""
        kind, *rest = str(name).split("-")
        if kind == "quaternion" and rest in (["wxyz"], ["xyzw"]):
            return cls(kind, rest[0])
        if name == "matrix":
            return cls(kind)
        if kind == "vector" and len(rest) == 1 and rest[0] in ANGLES:
            return cls(kind, unit=rest[0])
        if kind == "euler" and len(rest) == 2 and rest[0] in SEQUENCES and rest[1] in ANGLES:
            return cls(kind, *rest)
        raise InputError([Problem("rotation", f"{shown(name)} is no form of rotations", _FORMS)])

    @property
    def name(self) -> str:
        """Its name, as `named` reads it."""
        unit = self.unit if self.kind in ("vector", "euler") else ""
        return "-".join(part for part in (self.kind, self.detail, unit) if part)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of a table that hold its numbers, in the order in which `quaternions` takes them."""
        if self.kind == "quaternion":
            return tuple(f"q{letter}" for letter in self.detail)
        if self.kind == "matrix":
            return tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
        return ("rx", "ry", "rz") if self.kind == "vector" else ("r1", "r2", "r3")

    def quaternions(self, rotations: npt.ArrayLike | Any) -> Floats:
        """(N, 4) unit quaternions of (N, 4), (N, 3, 3), (N, 9) or (N, 3) numbers, or of a scipy Rotation.

        Raises InputError for what is no rotation, with its row (from 0).
        """
        if hasattr(rotations, "as_quat"):
            return normalised(np.roll(np.atleast_2d(rotations.as_quat()), 1, axis=1))
        try:
            values = as_floats(rotations)
        except (TypeError, ValueError) as error:
            raise InputError([Problem("rotations", str(error)[:200], "give an array of numbers")]) from None
        width = len(self.columns)
        if self.kind == "matrix" and values.ndim == 3 and values.shape[1:] == (3, 3):
            values = values.reshape(-1, 9)
        if values.ndim != 2 or values.shape[1] != width:
            what = f"have the shape {values.shape} for the form {self.name}"
            raise InputError([Problem("rotations", what, f"give one row of {width} numbers for each measurement")])
        self._check(values)
        return self._converted(values)

    def _check(self, values: Floats) -> None:
        """InputError, with the rows that are no rotations."""
        with np.errstate(over="ignore", invalid="ignore"):
            good: Bools = np.asarray(np.isfinite(values).all(axis=1))
            if self.kind == "quaternion":
                off = np.abs(np.linalg.norm(values, axis=1) - 1.0)
                what, remedy = "is a quaternion whose norm is not 1", "check the columns, or divide it by its norm"
            elif self.kind == "matrix":
                matrix = values.reshape(-1, 3, 3)
                square = np.einsum("kji,kjl->kil", matrix, matrix)
                off = np.abs(square - np.eye(3)).max(axis=(1, 2), initial=0.0)
                off = np.where(np.linalg.det(np.where(np.isfinite(matrix), matrix, 0.0)) > 0.0, off, np.inf)
                what = "is no rotation matrix: its columns are not at right angles, not of length 1, or left-handed"
                remedy = "check the columns and the frames"
            else:
                off, what, remedy = np.zeros(len(values)), "", ""
        bad = np.flatnonzero(~(good & (off <= ROUNDED)))
        problems = [
            Problem(f"rotation of row {row}", what if good[row] else "holds a number that is not finite", remedy)
            for row in bad.tolist()
        ]
        if problems:
            raise InputError(problems[:50], omitted=max(0, len(problems) - 50))

    def _converted(self, values: Floats) -> Floats:
        if self.kind == "quaternion":
            ordered = values if self.detail == "wxyz" else np.roll(values, 1, axis=1)
            return _unit(ordered)
        if self.kind == "matrix":
            return quaternion_from_matrix(values.reshape(-1, 3, 3))
        angles = values * ANGLES[self.unit]
        if self.kind == "vector":
            return quaternion_from_rotation_vector(angles)
        return quaternion_from_euler(self.detail, angles)


def quaternion_from_euler(sequence: str, angles: Floats) -> Floats:
    """(N, 4) of three angles (N, 3) in rad, in the order of the letters: see the module."""
    result: Floats | None = None
    for letter, angle in zip(sequence, angles.T, strict=True):
        turn = np.zeros((len(angles), 4))
        turn[:, 0], turn[:, _AXES[letter.lower()]] = np.cos(0.5 * angle), np.sin(0.5 * angle)
        if result is None:
            result = turn
        else:
            result = quaternion_product(result, turn) if letter.isupper() else quaternion_product(turn, result)
    assert result is not None
    return normalised(result)


def _unit(quaternion: Floats) -> Floats:
    """Divided by their norms, but left as they are, bit for bit, where these are 1 already."""
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(np.abs(norm - 1.0) <= 1e-12, quaternion, quaternion / norm)
