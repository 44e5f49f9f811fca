"""The same polynomials in exact numbers, as a certificate states them and as the checker reads them.

The study's float64 numbers are taken as exact: focal lengths, undistorted pixels, points, positions, and the rotation
matrix of each pose as float64 has it. Constraints 0 to 41 are the equations of the rotations, then come four rows of
each point (see `row_number`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction as F
from typing import Any, Protocol

from cpcal.checker import FORMAT
from cpcal.checker.problem import Constraint, Problem, Unknowns
from cpcal.handeye.frame_equations import EQUATIONS, R_F, R_X, T_F, T_X, UNKNOWNS
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.quadratic_rows import Monomial
from cpcal.robot import rotation_matrix
from cpcal.solver.certificate.statement import Given, Stated, limits, number
from cpcal.solver.interval import Box

Exact = dict[Monomial, F]


def row_number(point: int, axis: int, below: bool, count: int) -> int:
    """The constraint of one of the four rows of a point, of `count`."""
    return len(EQUATIONS) + (2 * axis + below) * count + point


def row_meaning(constraint: int, count: int) -> tuple[int, int, bool] | None:
    """Point, axis and whether it is the row from below; None for an equation of the rotations."""
    place = constraint - len(EQUATIONS)
    return None if place < 0 else (place % count, place // count // 2, bool(place // count % 2))


class ExactRows:
    """The constraints of a study of exact poses at a tolerance eps (px), formed when they are asked for."""

    def __init__(self, study: HandEyeStudy, eps: float) -> None:
        self._study, self._eps = study, F(eps)
        self._rays = study.rays
        self._motions = exact_motions(study)
        self.count = len(study.image)

    def __len__(self) -> int:
        return len(EQUATIONS) + 4 * self.count

    def stated(self, k: int) -> Stated:
        """Constraint k. Its name says which pixel it speaks of."""
        meaning = row_meaning(k, self.count)
        if meaning is None:
            terms: Given = tuple((m, F(c)) for m, c in EQUATIONS[k].items() if m)
            value = (((), -F(EQUATIONS[k].get((), 0.0))),)
            return Stated(f"rotation {k}", False, terms, value, value)
        point, axis, below = meaning
        study = self._study
        image, name = study.images[study.image[point]], study.names[point]
        label = f"{image}/{name} {'uv'[axis]} {'below' if below else 'above'}"
        return Stated(label, False, tuple(self._pixel(point, axis, below).items()), None, (((), F(0)),))

    def _pixel(self, point: int, axis: int, below: bool) -> Exact:
        study, sign = self._study, F(-1 if below else 1)
        camera = study.camera
        off = F(float(self._rays[point, axis])) - F(float(camera.center[axis]))
        width = self._eps + F(float(study.half_width[point]))
        factors = {axis: sign * F(float(camera.focal[axis])), 2: -sign * off - width}
        turn, shift = self._motions[study.image[point]]
        p = [F(float(v)) for v in study.points[point]]
        out: Exact = {}
        for a, factor in factors.items():
            for b in range(3):
                x = R_X[3 * b + a]
                out[(x,)] = factor * shift[b]
                out[x, T_X[b]] = -factor
                for c in range(3):
                    out[x, T_F[c]] = factor * turn[b][c]
                    for d in range(3):
                        out[x, R_F[3 * c + d]] = factor * turn[b][c] * p[d]
        return {monomial: value for monomial, value in out.items() if value}


def exact_motions(study: HandEyeStudy) -> list[tuple[list[list[F]], list[F]]]:
    """H_i as exact numbers: the stated pose, or its exact inverse."""
    found = []
    for turn, shift in exact_poses(study):
        if study.setup == "eye-in-hand":
            turn = [list(column) for column in zip(*turn, strict=True)]
            shift = [-sum((row[j] * shift[j] for j in range(3)), F(0)) for row in turn]
        found.append((turn, shift))
    return found


def exact_poses(study: HandEyeStudy) -> list[tuple[list[list[F]], list[F]]]:
    """The stated poses as exact numbers: the float64 matrix of each rotation, and the position."""
    found = []
    for position, quaternion in zip(study.poses.position, study.poses.quaternion, strict=True):
        turn = [[F(float(v)) for v in row] for row in rotation_matrix(quaternion)]
        found.append((turn, [F(float(v)) for v in position]))
    return found


class StatedRows(Protocol):
    """Constraints by number, in exact numbers."""

    def __len__(self) -> int: ...
    def stated(self, k: int) -> Stated: ...


@dataclass(frozen=True)
class ListedRows:
    """Constraints that are all there."""

    items: tuple[Stated, ...]

    def __len__(self) -> int:
        return len(self.items)

    def stated(self, k: int) -> Stated:
        return self.items[k]


@dataclass
class HandEyeStatement:
    """What a certificate is about, as its writer needs it; `used` gathers the constraints that some step speaks of."""

    rows: StatedRows
    about: str
    unknowns: tuple[str, ...] = UNKNOWNS
    used: dict[int, Stated] = field(default_factory=dict)

    def __post_init__(self) -> None:
        kept: dict[int, Constraint] = {}

        def constraint(k: int, x: Unknowns, *_: object) -> Constraint:
            if k not in kept:
                self.used[k] = self.rows.stated(k)
                kept[k] = self.used[k].constraint()
            return kept[k].on(x.images)

        count = len(self.rows)
        self.problem = Problem(self.unknowns, None, count, tuple(range(count)), constraint)

    def place(self, constraint: int, part: int, element: int) -> tuple[str, int] | None:
        """Part 0 is the side "upper", 1 "lower" (of an equation)."""
        return ("lower" if part else "upper"), constraint

    def header(self, domain: Box) -> Iterator[dict[str, Any]]:
        """The first lines, of all constraints."""
        return self.lines(domain, range(len(self.rows)))

    def lines(self, domain: Box, chosen: Any) -> Iterator[dict[str, Any]]:
        """The first lines, of the chosen constraints."""
        chosen = list(chosen)
        yield {
            "format": FORMAT,
            "about": self.about,
            "unknowns": list(self.unknowns),
            "objective": None,
            "constraints": len(chosen),
            **limits(domain),
        }
        for k in chosen:
            yield stated_line(self.rows.stated(k))


def stated_line(c: Stated) -> dict[str, Any]:
    """A constraint's line in a certificate."""

    def polynomial(p: Given | None) -> list[Any] | None:
        return None if p is None else [[list(m), number(v)] for m, v in sorted(p) if v]

    return {
        "name": c.name,
        "root": False,
        "body": polynomial(c.body),
        "at_least": polynomial(c.at_least),
        "at_most": polynomial(c.at_most),
    }
