"""Rows that tie the frames to the certified poses of single images, through the robot's pose and its readings.

With G = (A S, A (u - S c) + b) the target's pose in the camera frame, X G = H' F for a reading H' of the robot's pose.
Written with L, K, P of `_sides` (H stated, V what a reading turns by, less I, and d what it shifts by):

    L R_X A - K R_F = -L R_X A (S - I) + V' L R_X A S
    L (R_X b + t_X) - K (t_F + R_F c) + P = -L R_X A u + V z +- d        z: from the hand to the target's middle c

The left sides are linear in the 24 unknowns. The right sides are bounded over a box of frames: S and u by the image's
certificate, readings by half-widths; V is a skew matrix w x . with |w_j| <= r_j, plus at most |r|^2 / 2. Both equations
are stated along the target's axes, as they lie for a nominal R_X (the rows times U0' = (L R_X0 A)'), and the second
along the base's axes too: the errors of images are least known along the first, those of robots along the second.

All equations of an image share its errors. A combination of them (`Cut`) is bounded by what the errors do to it as a
whole, which is less than the sum of what they do to each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from typing import Any

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.box_contraction import FramesProof, Tell, contracted
from cpcal.handeye.exact_rows import exact_poses
from cpcal.handeye.frame_equations import EQUATIONS, FRAMES, R_F, R_X, T_F, T_X
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.image_pose_sets import LOOSE, ImagePoseSet, middle_of, stated_rows
from cpcal.handeye.quadratic_rows import Monomial
from cpcal.robot import rotation_matrix
from cpcal.solver.certificate.statement import Stated
from cpcal.solver.interval import Box

_UP = 1.0 + 1e-9  # more than the float64 operations on numbers that are not negative round away
_DIGITS = 20  # bits of a bound, so that it is the same however a machine sums


Exact = np.ndarray[Any, Any]  # of fractions
Body = dict[Monomial, F]


@dataclass(frozen=True)
class Cut:
    """A combination y (6) of an image's turns and shifts along the target's axes, to be bounded as one row."""

    image: str
    weights: tuple[float, ...]

    @property
    def name(self) -> str:
        """Of its row; weights have few digits, see `link_cuts`."""
        return f"{self.image} cut {' '.join(f'{weight:g}' for weight in self.weights)}"


@dataclass(frozen=True, eq=False)
class Bounds:
    """Of one image, over a box of frames: L, K, U0 (3, 3), and bounds of the right sides.

    turned, along, base  (3, 3), (3,), (3,) what they can be at most: of the first equation, of the second along the
                         target's axes and along the base's
    spans                (6, 12) what the errors of image and robot, each at its end, do to first order: to the skew
                         part of the first equation and to the second along the target's axes
    rest                 (6,) what is left beyond first order
    """

    left: Floats
    right: Floats
    u0: Floats
    turned: Floats
    along: Floats
    base: Floats
    spans: Floats
    rest: Floats


class Links:
    """The rows of a study's images over a box of frames; `nominal`: R_X0, any nine numbers."""

    def __init__(self, study: HandEyeStudy, sets: Sequence[ImagePoseSet], nominal: tuple[float, ...], box: Box) -> None:
        self.study, self.box = study, box
        near = np.array(nominal).reshape(3, 3)
        self.sets = {one.image: one for one in sets}
        self.bounds = {one.image: bounds_of(study, one, study.images.index(one.image), near, box) for one in sets}
        self._poses = exact_poses(study)
        self._parts: dict[str, list[tuple[Body, F]]] = {}

    def statements(self, cuts: Sequence[Cut]) -> tuple[Stated, ...]:
        """The equations of both rotations, 15 rows of each image, then the cuts."""
        found = []
        for k, terms in enumerate(EQUATIONS):
            value = (((), -F(terms.get((), 0.0))),)
            found.append(Stated(f"rotation {k}", False, tuple((m, F(c)) for m, c in terms.items() if m), value, value))
        for image, bounds in self.bounds.items():
            for i in range(3):
                for j in range(3):
                    found.append(_within(f"{image} turn {i + 1}{j + 1}", *self._turn(image, i, j), bounds.turned[i, j]))
            for words, axes, limits in (("along", bounds.u0, bounds.along), ("base", np.eye(3), bounds.base)):
                for i in range(3):
                    found.append(_within(f"{image} {words} {i + 1}", *self._shift(image, axes, i), limits[i]))
        return (*found, *map(self._cut, cuts))

    def _sides(self, image: str) -> tuple[Exact, Exact, Exact]:
        """L, K and P as exact numbers."""
        turn, position = (np.array(v, dtype=object) for v in self._poses[self.study.images.index(image)])
        if self.study.setup == "eye-in-hand":
            return turn, _fractions(np.eye(3)), position
        return _fractions(np.eye(3)), turn, -position

    def _turn(self, image: str, i: int, j: int) -> tuple[Body, F]:
        left, right, _ = self._sides(image)
        axis = _fractions(self.bounds[image].u0[:, i])
        a = _fractions(np.array(self.sets[image].nominal.turn)).reshape(3, 3)
        row, other = axis @ left, axis @ right
        body: Body = {(R_X[3 * k + m],): row[k] * a[m, j] for k in range(3) for m in range(3)}
        body |= {(R_F[3 * k + j],): -other[k] for k in range(3)}
        return body, F(0)

    def _shift(self, image: str, axes: Floats, i: int) -> tuple[Body, F]:
        left, right, place = self._sides(image)
        axis, b = _fractions(axes[:, i]), _fractions(np.array(self.sets[image].nominal.place))
        c = _fractions(middle_of(self.study, self.study.images.index(image)))
        row, other = axis @ left, axis @ right
        body: Body = {(R_X[3 * k + m],): row[k] * b[m] for k in range(3) for m in range(3)}
        body |= {(T_X[k],): row[k] for k in range(3)} | {(T_F[k],): -other[k] for k in range(3)}
        body |= {(R_F[3 * k + m],): -other[k] * c[m] for k in range(3) for m in range(3)}
        return body, sum((p * q for p, q in zip(axis, place, strict=True)), F(0))

    def parts(self, image: str) -> list[tuple[Body, F]]:
        """The six that cuts combine: the skew part of the first equation, and the second along the target's axes.

        An image has some dozens of cuts: its parts are made once.
        """
        if image not in self._parts:
            self._parts[image] = self._made(image)
        return self._parts[image]

    def _made(self, image: str) -> list[tuple[Body, F]]:
        found = []
        for i, j in ((2, 1), (0, 2), (1, 0)):
            one, other = self._turn(image, i, j)[0], self._turn(image, j, i)[0]
            found.append(({m: (one.get(m, F(0)) - other.get(m, F(0))) / 2 for m in {**one, **other}}, F(0)))
        return found + [self._shift(image, self.bounds[image].u0, i) for i in range(3)]

    def _cut(self, cut: Cut) -> Stated:
        bounds, y = self.bounds[cut.image], np.array(cut.weights)
        whole: Body = {}
        constant = F(0)
        for weight, (body, number) in zip(map(F, cut.weights), self.parts(cut.image), strict=True):
            constant += weight * number
            for monomial, value in body.items():
                whole[monomial] = whole.get(monomial, F(0)) + weight * value
        limit = np.abs(y @ bounds.spans).sum() + np.abs(y) @ bounds.rest
        return _within(cut.name, whole, constant, float(_rounded(np.array([limit]))[0]))


def prove_links(
    links: Links, cuts: Sequence[Cut], eps: float, *, about: str, tell: Tell = lambda text: None
) -> FramesProof:
    """Contract a box of frames by what single images prove at eps."""
    rows = stated_rows(links.statements(cuts), FRAMES, about, (*R_X, *R_F))
    return contracted(rows, eps, links.box, tell=tell)


def _fractions(values: Floats) -> np.ndarray:
    return np.array([F(float(v)) for v in np.ravel(values)], dtype=object).reshape(np.shape(values))


def _within(name: str, body: Body, constant: F, limit: float) -> Stated:
    """|body + constant| <= limit."""
    bound = F(limit)
    terms = tuple(sorted((m, v) for m, v in body.items() if v))
    return Stated(name, False, terms, (((), -bound - constant),), (((), bound - constant),))


def bounds_of(study: HandEyeStudy, one: ImagePoseSet, image: int, nominal: Floats, box: Box) -> Bounds:
    """All sums of numbers that are not negative, rounded up in the end."""
    in_hand = study.setup == "eye-in-hand"
    turn = rotation_matrix(study.poses.quaternion[image])
    left, right = (turn, np.eye(3)) if in_hand else (np.eye(3), turn)
    a = np.array(one.nominal.turn).reshape(3, 3)
    u0 = _short(left @ nominal @ a)
    sigma, shift = one.bounds  # of |S - I| and |u|
    half = study.pose_half_width[image]
    moved, turned = half[:3], half[3:]
    angle = _norm(turned)
    # delta: |U0' U - I| of U = L R_X A over the box; far: |U - U0|
    lo, hi = (end[list(R_X)].reshape(3, 3) for end in (box.lo, box.hi))
    nearest = left.T @ u0 @ a.T  # what R_X would be
    off = np.maximum(np.abs(lo - nearest), np.abs(hi - nearest))
    far = np.minimum(np.abs(left) @ off @ np.abs(a), 2.0) + 4e-6
    delta = np.minimum(np.abs(u0.T) @ far, 2.0) + 4e-6
    columns = np.minimum(np.array([_norm(delta[:, j]) + _norm(sigma[:, j]) for j in range(3)]), 2.0)
    skew = np.array([[turned @ np.abs(np.cross(u0[:, j], u0[:, i])) for j in range(3)] for i in range(3)])
    second = delta @ sigma + angle**2 / 2.0 + angle * (columns + 1e-5) + 10.0 * LOOSE
    # z: in the base frame, from the hand to the middle of the target
    c = middle_of(study, image)
    r_f = (box.lo[list(R_F)].reshape(3, 3), box.hi[list(R_F)].reshape(3, 3))
    t_f = box.lo[list(T_F)], box.hi[list(T_F)]
    mid = 0.5 * (t_f[0] + t_f[1]) + 0.5 * (r_f[0] + r_f[1]) @ c
    rad = 0.5 * (t_f[1] - t_f[0]) + 0.5 * (r_f[1] - r_f[0]) @ np.abs(c)
    z, z_rad = right @ mid - (study.poses.position[image] if in_hand else 0.0), np.abs(right) @ rad
    z_rad = z_rad + (moved if in_hand else 0.0) + 1e-9 * (np.abs(mid).sum() + rad.sum())
    long = angle**2 / 2.0 * (_norm(z) + _norm(z_rad))
    spread = _cross_rows(z_rad)
    turns = np.abs(u0.T @ _cross_matrix(z))
    base = np.abs(u0) @ shift + far @ shift + np.abs(_cross_matrix(z)) @ turned + spread @ turned + moved + long
    beyond = delta @ shift + np.abs(u0.T) @ spread @ turned + long
    loose = 10.0 * LOOSE * (1.0 + np.abs(mid).sum() + rad.sum() + np.abs(study.poses.position[image]).sum())
    loose += 10.0 * LOOSE * np.abs(np.array(one.nominal.place)).sum()
    along = shift + turns @ turned + np.abs(u0.T) @ moved + beyond
    pairs = ((2, 1), (0, 2), (1, 0))
    skewed = np.array([(sigma[i, j] + sigma[j, i]) / 2.0 for i, j in pairs])
    spans = np.zeros((6, 12))
    spans[:3, :3], spans[3:, 3:6] = np.diag(skewed), np.diag(shift)
    spans[:3, 6:9], spans[3:, 6:9] = u0.T * turned, (u0.T @ _cross_matrix(z)) * turned
    spans[3:, 9:] = u0.T * moved
    spans[:, :6] *= -1.0
    rest = np.append([(second[i, j] + second[j, i]) / 2.0 for i, j in pairs], beyond + loose)
    return Bounds(
        left, right, u0, _rounded(sigma + skew + second), _rounded(along + loose), _rounded(base + loose), spans, rest
    )


def _cross_matrix(z: Floats) -> Floats:
    """w -> w x z."""
    x, y, w = z
    return np.array([[0.0, w, -y], [-w, 0.0, x], [y, -x, 0.0]])


def _cross_rows(r: Floats) -> Floats:
    return np.abs(_cross_matrix(r))


def _norm(vector: Floats) -> float:
    return float(np.sqrt(np.sum(vector**2)))


def _short(matrix: Floats) -> Floats:
    """To 2^-20: a nominal rotation need be no exact one, and short numbers are the same on every machine."""
    return np.round(matrix * 2.0**20) / 2.0**20


def _rounded(values: Floats) -> Floats:
    """Up, to so many bits."""
    up = values * _UP
    unit = np.exp2(np.floor(np.log2(up)) - _DIGITS)
    return np.asarray(np.ceil(up / unit) * unit)
