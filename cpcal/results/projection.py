"""Projections of a set of parameters on planes of two of them, as proved half-planes: plain values, and their JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from cpcal.solver.interval import Box

HalfPlane = tuple[float, float, float]


@dataclass(frozen=True)
class Projection:
    """The set lies where `u x + v y <= c` for every (u, v, c) of `half_planes`, (x, y) being two `parameters` in mm."""

    parameters: tuple[str, str]
    half_planes: tuple[HalfPlane, ...]

    def to_json(self) -> dict[str, Any]:
        return {"parameters": list(self.parameters), "half_planes": [list(plane) for plane in self.half_planes]}

    @classmethod
    def from_json(cls, data: dict[str, Any], names: tuple[str, ...]) -> Projection:
        x, y = data["parameters"]
        planes = tuple(_half_plane(plane) for plane in data["half_planes"])
        if x not in names or y not in names or x == y:
            raise ValueError(f"no two parameters: {x!r}, {y!r}")
        return cls((x, y), planes)


@dataclass(frozen=True)
class Projections:
    """What holds all parameters that satisfy a leg's equations to within `eps`, of those it was asked about.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. `box` and each of `pairs` hold for themselves.
    """

    eps: float
    box: Box
    pairs: tuple[Projection, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "eps": self.eps,
            "box": {"lo": self.box.lo.tolist(), "hi": self.box.hi.tolist()},
            "pairs": [pair.to_json() for pair in self.pairs],
        }

    @classmethod
    def from_json(cls, data: dict[str, Any], names: tuple[str, ...]) -> Projections:
        """Raises KeyError, TypeError or ValueError for what is no projection."""
        lo, hi = (_finite(data["box"][side]) for side in ("lo", "hi"))
        return cls(
            _finite([data["eps"]])[0], Box(names, lo, hi), tuple(Projection.from_json(p, names) for p in data["pairs"])
        )


def _half_plane(numbers: list[float]) -> HalfPlane:
    u, v, c = _finite(numbers)
    if u == v == 0.0:
        raise ValueError("a half-plane without a direction")
    return u, v, c


def _finite(numbers: list[float]) -> list[float]:
    found = [float(number) for number in numbers]
    if not all(map(math.isfinite, found)):
        raise ValueError(f"not finite: {found}")
    return found
