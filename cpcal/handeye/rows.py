"""Rows of degree two in some unknowns, as arrays: what the linear programs are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any, Protocol

import numpy as np

from cpcal.checker import FORMAT
from cpcal.checker.problem import Constraint, Problem, Unknowns
from cpcal.common.values import Bools, Floats, Indices
from cpcal.handeye.study import HandEyeFrames, HandEyeStudy
from cpcal.robot import normalised, quaternion_from_matrix, rotation_matrix
from cpcal.robot.kinematics import rotation_numerators
from cpcal.solver.certificate.exact_network import Given, Stated, limits, number
from cpcal.solver.interval import Box

Monomial = tuple[int, ...]
Terms = Mapping[Monomial, float]


@dataclass(frozen=True, eq=False)
class Layout:
    """Names of the unknowns, and the pairs (P, 2) of them whose products occur."""

    names: tuple[str, ...]
    pairs: Indices

    @property
    def size(self) -> int:
        return len(self.names)

    @cached_property
    def place(self) -> dict[Monomial, int]:
        """The number of a pair."""
        return {(int(i), int(j)): k for k, (i, j) in enumerate(self.pairs)}

    @cached_property
    def square(self) -> Bools:
        """(P,) which products are squares."""
        return np.asarray(self.pairs[:, 0] == self.pairs[:, 1])


@dataclass(frozen=True, eq=False)
class Quadratics:
    """Rows `constant + linear x + products x_i x_j <= 0`: (M,), (M, n) and (M, P), in float64."""

    layout: Layout
    constant: Floats
    linear: Floats
    products: Floats

    def __len__(self) -> int:
        return len(self.constant)

    @staticmethod
    def of(layout: Layout, polynomials: Sequence[Terms]) -> Quadratics:
        count = len(polynomials)
        found = Quadratics(
            layout, np.zeros(count), np.zeros((count, layout.size)), np.zeros((count, len(layout.pairs)))
        )
        for k, terms in enumerate(polynomials):
            for monomial, value in terms.items():
                if not monomial:
                    found.constant[k] = value
                elif len(monomial) == 1:
                    found.linear[k, monomial[0]] = value
                else:
                    found.products[k, layout.place[monomial]] = value
        return found

    def centred(self, center: Floats, radius: Floats) -> Quadratics:
        """In u, where x = center + radius u."""
        pairs, size = self.layout.pairs, self.layout.size
        i, j = pairs.T
        constant = self.constant + self.linear @ center + self.products @ (center[i] * center[j])
        spread = np.zeros((len(pairs), size))  # what a product adds to the linear terms
        np.add.at(spread, (np.arange(len(pairs)), i), center[j])
        np.add.at(spread, (np.arange(len(pairs)), j), center[i])
        linear = (self.linear + self.products @ spread) * radius
        return Quadratics(self.layout, constant, linear, self.products * (radius[i] * radius[j]))

    @staticmethod
    def joined(parts: Sequence[Quadratics]) -> Quadratics:
        return Quadratics(
            parts[0].layout,
            np.concatenate([p.constant for p in parts]),
            np.concatenate([p.linear for p in parts]),
            np.concatenate([p.products for p in parts]),
        )


# ------------------------------------------------------------------------------------------------------------------
# The polynomials that the frames satisfy, in 24 unknowns: the entries of both rotations and translations.
#
# The unknowns are X = E^-1, the camera in the hand (or base) frame, and F, the target in the base (or hand) frame, as
# users want them. A point is x = R_X^T (H_i F p - t_X). A pixel u seen to within eps gives four rows, at most zero,
#
#     +-(f_a x_a - (u_a - c_a) x_3) - (eps + half-width) x_3 <= 0          a = 1, 2
#
# for x_3 > 0; x is bilinear in R_X and (t_X, R_F, t_F). The rotations satisfy R R' = I, R' R = I and R = cof R, all of
# which are stated although they follow from each other: together they bound the linear relaxation.

R_X, T_X, R_F, T_F = range(9), range(9, 12), range(12, 21), range(21, 24)
UNKNOWNS = (
    *(f"X.R{a + 1}{b + 1}" for a in range(3) for b in range(3)),
    *(f"X.t{a}" for a in "xyz"),
    *(f"F.R{a + 1}{b + 1}" for a in range(3) for b in range(3)),
    *(f"F.t{a}" for a in "xyz"),
)
SIZE = len(UNKNOWNS)


def _pairs() -> Indices:
    """Unknowns (P, 2) whose products occur: R_X with all others, and each rotation with itself."""
    between = [(i, j) for i in R_X for j in (*T_X, *R_F, *T_F)]
    within = [pair for part in (R_X, R_F) for pair in combinations_with_replacement(part, 2)]
    return np.array(between + within, dtype=np.intp)


FRAMES = Layout(UNKNOWNS, _pairs())
PAIRS = FRAMES.pairs
PLACE = FRAMES.place


def unknowns_of(frames: HandEyeFrames) -> Floats:
    """(SIZE,) of frames E and F."""
    x = frames.e_rotation.T
    parts = (x.ravel(), -x @ frames.e_translation, frames.f_rotation.ravel(), frames.f_translation)
    return np.concatenate(parts)


def pixel_rows(study: HandEyeStudy, eps: float) -> Quadratics:
    """The rows (4 N) in the order of `row_number`, for the robot's poses as stated."""
    turn, shift = study.motions
    turn, shift = turn[study.image], shift[study.image]
    count = len(turn)
    linear, products = np.zeros((3, count, SIZE)), np.zeros((3, count, len(PAIRS)))
    for a in range(3):
        for b in range(3):
            x = R_X[3 * b + a]
            linear[a, :, x] = shift[:, b]
            products[a, :, PLACE[x, T_X[b]]] = -1.0
            for c in range(3):
                products[a, :, PLACE[x, T_F[c]]] = turn[:, b, c]
                for d in range(3):
                    products[a, :, PLACE[x, R_F[3 * c + d]]] = turn[:, b, c] * study.points[:, d]
    off, width = study.rays - study.camera.center, eps + study.half_width
    lin, pro = [], []
    for a in (0, 1):
        for sign in (1.0, -1.0):
            focal, third = sign * study.camera.focal[a], (-sign * off[:, a] - width)[:, None]
            lin.append(focal * linear[a] + third * linear[2])
            pro.append(focal * products[a] + third * products[2])
    return Quadratics(FRAMES, np.zeros(4 * count), np.concatenate(lin), np.concatenate(pro))


def rotation_equations(part: Sequence[int]) -> list[Terms]:
    """21 polynomials that are zero for the entries of a rotation, whose numbers row by row are in `part`."""
    found: list[Terms] = []
    r = [[part[3 * a + b] for b in range(3)] for a in range(3)]
    for lines in (r, [list(column) for column in zip(*r, strict=True)]):
        for a in range(3):
            for b in range(a, 3):
                terms: dict[Monomial, float] = {
                    (min(i, j), max(i, j)): 1.0 for i, j in zip(lines[a], lines[b], strict=True)
                }
                found.append(terms | ({(): -1.0} if a == b else {}))
    for a in range(3):
        for b in range(3):
            p, q, s, t = (a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3
            first, second = (r[p][s], r[q][t]), (r[p][t], r[q][s])
            found.append({(r[a][b],): 1.0, (min(first), max(first)): -1.0, (min(second), max(second)): 1.0})
    return found


EQUATIONS = [*rotation_equations(R_X), *rotation_equations(R_F)]


def rotation_rows() -> Quadratics:
    """The equations, then their negatives, as rows (84)."""
    return Quadratics.of(FRAMES, [*EQUATIONS, *({m: -c for m, c in terms.items()} for terms in EQUATIONS)])


# ------------------------------------------------------------------------------------------------------------------
# The same polynomials in exact numbers, as a certificate states them and as the checker reads them.
#
# The study's float64 numbers are taken as exact: focal lengths, undistorted pixels, points, positions, and the rotation
# matrix of each pose as float64 has it. Constraints 0 to 41 are the equations of the rotations, then come four rows of
# each point (see `row_number`).

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


# ------------------------------------------------------------------------------------------------------------------
# Given frames in exact rational arithmetic: what their largest error is, in every image, and where points stand.
#
# This is the upper end of the bracket. Frames are given by quaternions and positions in float64, taken as exact; R(q)
# is divided by |q|^2.

Vector = list[F]
Matrix = list[Vector]
Reading = tuple[float, ...]  # of a pose: d in mm and w in rad, see `cpcal.handeye.study`


@dataclass(frozen=True)
class PlacedFrames:
    """The camera in the hand (eye in hand) or base frame, and the target in the base (eye in hand) or hand frame.

    Positions in mm, quaternions scalar first; float64 numbers that are taken as exact. Raises ValueError for frames
    that are none.
    """

    camera_position: tuple[float, float, float]
    camera_quaternion: tuple[float, float, float, float]
    target_position: tuple[float, float, float]
    target_quaternion: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        for quaternion in (self.camera_quaternion, self.target_quaternion):
            if not 0.1 < math.hypot(*quaternion) < 10.0:  # nor NaN
                raise ValueError("a quaternion is of no rotation")

    @property
    def frames(self) -> HandEyeFrames:
        """E and F, in float64."""
        turn = rotation_matrix(normalised(self.camera_quaternion)).T
        target = rotation_matrix(normalised(self.target_quaternion))
        return HandEyeFrames(turn, -turn @ np.array(self.camera_position), target, np.array(self.target_position))

    @property
    def unknowns(self) -> Vector:
        """The 24 of `cpcal.handeye.rows`, in rational numbers."""
        found: Vector = []
        for quaternion, position in (
            (self.camera_quaternion, self.camera_position),
            (self.target_quaternion, self.target_position),
        ):
            found += [value for row in exact_rotation(quaternion) for value in row]
            found += [F(value) for value in position]
        return found

    @staticmethod
    def of(frames: HandEyeFrames) -> PlacedFrames:
        turn = frames.e_rotation.T
        return PlacedFrames(
            tuple((-turn @ frames.e_translation).tolist()),
            tuple(quaternion_from_matrix(turn).tolist()),
            tuple(frames.f_translation.tolist()),
            tuple(quaternion_from_matrix(frames.f_rotation).tolist()),
        )


def exact_rotation(quaternion: tuple[float, ...]) -> Matrix:
    """R(q) in rational numbers."""
    rows, norm = rotation_numerators([F(v) for v in quaternion])
    return [[value / norm for value in row] for row in rows]


def read_motions(study: HandEyeStudy, readings: Sequence[Reading]) -> list[tuple[Matrix, Vector]]:
    """H_i at the readings (at the stated poses where there are none)."""
    found = []
    for k, (turn, shift) in enumerate(exact_poses(study)):
        if readings:
            d, w = ([F(v) for v in readings[k][part]] for part in (slice(0, 3), slice(3, 6)))
            rows, norm = rotation_numerators([F(1), *(v / 2 for v in w)])
            more = [[value / norm for value in row] for row in rows]
            turn = [
                [sum((a * row[j] for a, row in zip(line, turn, strict=True)), F(0)) for j in range(3)] for line in more
            ]
            shift = [a + b for a, b in zip(shift, d, strict=True)]
        if study.setup == "eye-in-hand":
            turn = [list(column) for column in zip(*turn, strict=True)]
            shift = [-value for value in _times(turn, shift)]
        found.append((turn, shift))
    return found


def exact_errors(study: HandEyeStudy, placed: PlacedFrames, readings: Sequence[Reading] = ()) -> list[F | None]:
    """For each point the larger excess `|residual| - half-width` of its two axes, px; None where x_3 > 0 fails."""
    turn_x, turn_f = exact_rotation(placed.camera_quaternion), exact_rotation(placed.target_quaternion)
    t_x, t_f = ([F(v) for v in t] for t in (placed.camera_position, placed.target_position))
    camera = study.camera
    focal, center = ([F(float(v)) for v in values] for values in (camera.focal, camera.center))
    maps = [_map(turn_x, t_x, turn, shift, turn_f, t_f) for turn, shift in read_motions(study, readings)]
    found: list[F | None] = []
    rows = zip(study.image.tolist(), study.rays.tolist(), study.points.tolist(), study.half_width.tolist(), strict=True)
    for image, ray, point, width in rows:
        turn, shift = maps[image]
        p = [F(v) for v in point]
        x = [sum((row[d] * p[d] for d in range(3) if p[d]), t) for row, t in zip(turn, shift, strict=True)]
        if x[2] <= 0:
            found.append(None)
            continue
        off = (abs(focal[a] * x[a] / x[2] - (F(ray[a]) - center[a])) for a in (0, 1))
        found.append(max(off) - F(width))
    return found


def _map(r_x: Matrix, t_x: Vector, turn: Matrix, shift: Vector, r_f: Matrix, t_f: Vector) -> tuple[Matrix, Vector]:
    """x = R_X^T (H F p - t_X) as one rotation and translation."""
    back = [list(column) for column in zip(*r_x, strict=True)]
    moved = [value + s - t for value, s, t in zip(_times(turn, t_f), shift, t_x, strict=True)]
    columns = [_times(back, _times(turn, list(column))) for column in zip(*r_f, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)], _times(back, moved)


def _times(matrix: Matrix, vector: Vector) -> Vector:
    return [sum((a * v for a, v in zip(row, vector, strict=True)), F(0)) for row in matrix]


def largest(errors: list[F | None]) -> F | None:
    """The largest of them, from 0; None where some point is not in front of the camera."""
    known = [error for error in errors if error is not None]
    return max([F(0), *known]) if len(known) == len(errors) else None


def above(value: F) -> float:
    """The least float64 that is not below a number that is not negative; 0 for what is below 0."""
    value = max(value, F(0))
    near = float(value)
    return near if F(near) >= value else math.nextafter(near, math.inf)
