"""What is proved of a study at one tolerance, from its pixels: a box of frames that is contracted, or found empty."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.values import Floats, Indices
from cpcal.files.codec import checked
from cpcal.handeye.classical_answer import image_poses
from cpcal.handeye.contraction import ConstraintRows, FramePrograms, FramesProof, Tell, contracted
from cpcal.handeye.rows import (
    EQUATIONS,
    FRAMES,
    R_F,
    R_X,
    T_F,
    T_X,
    ExactRows,
    HandEyeStatement,
    Layout,
    ListedRows,
    Monomial,
    PlacedFrames,
    Quadratics,
    exact_poses,
    pixel_rows,
    rotation_equations,
    rotation_rows,
)
from cpcal.handeye.study import HandEyeStudy
from cpcal.robot import rotation_matrix
from cpcal.solver.certificate.exact_network import Given, Stated
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense, LinearStatus

_NEGLIGIBLE = 0.01


def prove(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    *,
    about: str,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> FramesProof:
    """Contract a box of frames until it is empty or gets no smaller, at a tolerance of `eps` px; poses are exact."""
    statement = HandEyeStatement(ExactRows(study, eps), about)
    rows, places = frame_rows(study, eps)
    start, count = 2 * len(EQUATIONS), len(study.image)

    def negligible(box: Box) -> bool:
        """Whether products change a pixel by next to nothing beside the tolerance."""
        centred = rows.centred(box.mid, box.rad)
        constant = centred.constant[start:].reshape(2, 2, -1)
        room = -constant.sum(axis=1)  # 2 (eps + half-width) x_3 of each point and axis
        beside = np.abs(centred.products[start:]).sum(axis=1).reshape(2, 2, count).max(axis=1)
        return bool((beside <= _NEGLIGIBLE * room).all())

    asked = ConstraintRows(statement, rows, places, (*R_X, *R_F), negligible)
    return contracted(asked, eps, domain, time_limit=time_limit, tell=tell)


def frame_rows(study: HandEyeStudy, eps: float) -> tuple[Quadratics, Indices]:
    """ConstraintRows of the rotations and of all pixels, and constraint and part of each."""
    equations, pixels = len(EQUATIONS), 4 * len(study.image)
    both, own = np.tile(np.arange(equations), 2), equations + np.arange(pixels)
    part = np.repeat([0, 1, 0], [equations, equations, pixels])
    rows = Quadratics.joined([rotation_rows(), pixel_rows(study, eps)])
    return rows, np.stack([np.concatenate([both, own]), part], axis=1)


# ------------------------------------------------------------------------------------------------------------------
# The target's pose in the camera frame, from the pixels of one image alone: a certified box of all that explain them.
#
# In image i the points are x = A (S (p - c) + u) + b, with a nominal pose (A, b) of the points' middle c. Unknown are
# the turn S (9 entries, near I) and the shift u (3), mm, both along the target's axes. The rows of the pixels are
# linear in them; S S' = I, S' S = I and S = cof S hold to within what float64 makes of the robot's rotations. No frames
# and no robot pose enter, so what is proved holds whatever errors the robot has.

TURN, SHIFT = range(9), range(9, 12)
POSE = Layout(
    (*(f"S{a + 1}{b + 1}" for a in range(3) for b in range(3)), *(f"u{a}" for a in "xyz")),
    np.array([(i, j) for i in TURN for j in range(i, 9)], dtype=np.intp),
)
LOOSE = 1e-11  # what products of float64 rotation matrices are off from rotations, at most, and what comes of it
_EQUATIONS = rotation_equations(TURN)
_UP = 1.0 + 1e-9
_STATED = "the constraints that the certificates state, of these images"  # how these are checked
_FILE = "a file of the run, named once, which is accepted and begins where the one before ended"


@dataclass(frozen=True)
class NominalPose:
    """Of the target in the camera frame in one image: A (9, row by row), and b, where the points' middle c is, mm."""

    turn: tuple[float, ...] = field(metadata=checked(_STATED))
    place: tuple[float, ...] = field(metadata=checked(_STATED))


@dataclass(frozen=True)
class ImagePoseSet:
    """PROVED: in this image S and u lie in [lo, hi] (12), for all frames of the asked box that explain it to eps.

    Without bounds: no pose does. `certificate`: the name of its file.
    """

    image: str = field(metadata=checked(_STATED))
    nominal: NominalPose
    lo: tuple[float, ...] = field(metadata=checked("the claim of the certificate beside it"))
    hi: tuple[float, ...] = field(metadata=checked("the claim of the certificate beside it"))
    certificate: str = field(metadata=checked(_FILE))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The largest |S - I| (3, 3) and |u| (3,)."""
        lo, hi = np.array(self.lo), np.array(self.hi)
        turn = np.maximum(np.abs(lo[:9].reshape(3, 3) - np.eye(3)), np.abs(hi[:9].reshape(3, 3) - np.eye(3)))
        return turn, np.maximum(np.abs(lo[9:]), np.abs(hi[9:]))


def middle_of(study: HandEyeStudy, image: int) -> Floats:
    """(3,) c: the middle of the least box of the image's points, mm; exact in float64 where they are round numbers."""
    mine = study.points[study.image == image]
    return np.asarray(0.5 * (mine.min(axis=0) + mine.max(axis=0)))


def nominal_poses(study: HandEyeStudy) -> dict[int, NominalPose]:
    """From least squares on each image's pixels, of images that determine one."""
    kept, seen = image_poses(study)
    found = {}
    for k, position, quaternion in zip(kept, seen.position, seen.quaternion, strict=True):
        turn = rotation_matrix(quaternion)
        place = position + turn @ middle_of(study, k)
        found[k] = NominalPose(tuple(turn.ravel().tolist()), tuple(place.tolist()))
    return found


def pose_domain(study: HandEyeStudy, image: int, nominal: NominalPose, frames: Box) -> Box:
    """All turns, and as far as a target can be from its nominal place for frames in a box and readings of the pose."""
    far = _norm(np.maximum(np.abs(frames.lo), np.abs(frames.hi))[list(T_X)])
    far += _norm(np.maximum(np.abs(frames.lo), np.abs(frames.hi))[list(T_F)])
    far += _norm(study.poses.position[image]) + _norm(study.pose_half_width[image, :3])
    far += _norm(middle_of(study, image)) + _norm(np.array(nominal.place))
    reach = float(np.ceil(far * 1.001 + 1.0))
    lo = np.append(np.full(9, -1.0 - 2.0**-30), np.full(3, -reach))
    return Box(POSE.names, lo, -lo)


def _norm(vector: Floats) -> float:
    return float(np.sqrt(np.sum(vector**2)))


def pose_statements(study: HandEyeStudy, image: int, nominal: NominalPose, eps: float) -> tuple[Stated, ...]:
    """21 equations of the turn, then four rows of each point."""
    loose = F(LOOSE)
    found = []
    for k, terms in enumerate(_EQUATIONS):
        value = -F(terms.get((), 0.0))
        body: Given = tuple((m, F(c)) for m, c in terms.items() if m)
        found.append(Stated(f"turn {k}", False, body, (((), value - loose),), (((), value + loose),)))
    return (*found, *_pixel_statements(study, image, nominal, eps))


def _pixel_statements(study: HandEyeStudy, image: int, nominal: NominalPose, eps: float) -> Iterator[Stated]:
    camera, rays = study.camera, study.rays
    turn = [[F(v) for v in nominal.turn[3 * a : 3 * a + 3]] for a in range(3)]
    place = [F(v) for v in nominal.place]
    middle = [F(float(v)) for v in middle_of(study, image)]
    for n in np.flatnonzero(study.image == image).tolist():
        q = [F(float(v)) - c for v, c in zip(study.points[n], middle, strict=True)]
        width = F(eps) + F(float(study.half_width[n]))
        for axis in (0, 1):
            off = F(float(rays[n, axis])) - F(float(camera.center[axis]))
            focal = F(float(camera.focal[axis]))
            for below in (False, True):
                sign = -1 if below else 1
                first, third = sign * focal, -sign * off - width
                along = [first * turn[axis][b] + third * turn[2][b] for b in range(3)]
                body = [((9 + b,), along[b]) for b in range(3)]
                body += [((3 * b + d,), along[b] * q[d]) for b in range(3) for d in range(3) if q[d]]
                limit = -(first * place[axis] + third * place[2])
                name = f"{study.names[n]} {'uv'[axis]} {'below' if below else 'above'}"
                yield Stated(name, False, tuple(sorted(body)), None, (((), limit),))


def pose_row_meaning(constraint: int) -> int | None:
    """The point, among those of the image, that a constraint speaks of; None for an equation of the turn."""
    return None if constraint < len(_EQUATIONS) else (constraint - len(_EQUATIONS)) // 4


def stated_rows(items: tuple[Stated, ...], layout: Layout, about: str, rotations: tuple[int, ...]) -> ConstraintRows:
    """Constraints of which only those of rotations have products, as rows."""
    rows: list[dict[tuple[int, ...], float]] = []
    places = []
    for k, item in enumerate(items):
        body = {m: float(c) for m, c in item.body}
        for part, (bound, sign) in enumerate(((item.at_most, 1.0), (item.at_least, -1.0))):
            if bound is not None:
                rows.append({m: sign * c for m, c in body.items()} | {(): -sign * float(dict(bound).get((), F(0)))})
                places.append((k, part))
    statement = HandEyeStatement(ListedRows(items), about, layout.names)
    quadratics = Quadratics.of(layout, rows)

    def negligible(box: Box) -> bool:
        return bool(box.rad[list(rotations)].max() < 0.02)

    return ConstraintRows(statement, quadratics, np.array(places, dtype=np.intp), rotations, negligible)


def prove_pose(
    study: HandEyeStudy, image: int, nominal: NominalPose, eps: float, domain: Box, *, tell: Tell = lambda text: None
) -> FramesProof:
    """Contract the box of poses of one image until it is empty or gets no smaller, at a tolerance of eps px."""
    items = pose_statements(study, image, nominal, eps)
    rows = stated_rows(items, POSE, about_pose(study, image, eps), tuple(TURN))
    return contracted(rows, eps, domain, tell=tell)


def about_pose(study: HandEyeStudy, image: int, eps: float) -> str:
    """What certificates say of themselves."""
    return (
        f"cpcal hand-eye, {study.images[image]} alone: turn S and shift u (mm) of the target from its nominal pose; "
        f"every pixel within eps = {eps.hex()} px"
    )


# ------------------------------------------------------------------------------------------------------------------
# Rows that tie the frames to the certified poses of single images, through the robot's pose and its readings.
#
# With G = (A S, A (u - S c) + b) the target's pose in the camera frame, X G = H' F for a reading H' of the robot's
# pose. Written with L, K, P of `_sides` (H stated, V what a reading turns by, less I, and d what it shifts by):
#
#     L R_X A - K R_F = -L R_X A (S - I) + V' L R_X A S
#     L (R_X b + t_X) - K (t_F + R_F c) + P = -L R_X A u + V z +- d        z: from the hand to the target's middle c
#
# The left sides are linear in the 24 unknowns. The right sides are bounded over a box of frames: S and u by the image's
# certificate, readings by half-widths; V is a skew matrix w x . with |w_j| <= r_j, plus at most |r|^2 / 2. Both
# equations are stated along the target's axes, as they lie for a nominal R_X (the rows times U0' = (L R_X0 A)'), and
# the second along the base's axes too: the errors of images are least known along the first, those of robots along the
# second.
#
# All equations of an image share its errors. A combination of them (`Cut`) is bounded by what the errors do to it as a
# whole, which is less than the sum of what they do to each.

_DIGITS = 20  # bits of a bound, so that it is the same however a machine sums


Exact = np.ndarray[Any, Any]  # of fractions
Body = dict[Monomial, F]


@dataclass(frozen=True)
class Cut:
    """A combination y (6) of an image's turns and shifts along the target's axes, to be bounded as one row."""

    image: str = field(metadata=checked(_STATED))
    weights: tuple[float, ...] = field(metadata=checked(_STATED))

    @property
    def name(self) -> str:
        """Of its row."""
        return f"{self.image} cut {' '.join(map(str, self.weights))}"


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


def _short(matrix: Floats) -> Floats:
    """To 2^-20: a nominal rotation need be no exact one, and short numbers are the same on every machine."""
    return np.round(matrix * 2.0**20) / 2.0**20


def _rounded(values: Floats) -> Floats:
    """Up, to so many bits."""
    up = values * _UP
    unit = np.exp2(np.floor(np.log2(up)) - _DIGITS)
    return np.asarray(np.ceil(up / unit) * unit)


# ------------------------------------------------------------------------------------------------------------------
# Which combinations of an image's equations are worth a row: found by linear programs, believed by nobody.
#
# Each end of each unknown is the vertex of a program. What an image's errors can do to its six equations is a zonotope;
# where a vertex lies outside of it, the plane between the two is a cut.

_ROUNDS = 4
_DEPTH = 0.01  # of what a cut's errors can do: how far beyond it a vertex must lie
_BITS = 12  # of a weight: short numbers, for the cut is proved as it stands


@dataclass(frozen=True, eq=False)
class _Image:
    """The six equations of an image as `matrix x + constant`, the zonotope of its errors, and what lies beyond."""

    name: str
    matrix: Floats
    constant: Floats
    spans: Floats
    rest: Floats

    @property
    def size(self) -> Floats:
        """(6,) of the zonotope on each axis."""
        return np.asarray(np.abs(self.spans).sum(axis=1) + self.rest)


def useful_cuts(links: Links) -> tuple[Cut, ...]:
    """Cuts that bound some unknown on the box of the links."""
    images = [_floats(links, name) for name in links.sets]
    base = stated_rows(links.statements(()), FRAMES, "", (*R_X, *R_F))
    cuts: list[Cut] = []
    used: set[int] = set()
    for turn in range(_ROUNDS + 1):
        vertices, used = _vertices(links, base, cuts, {one.name: one for one in images})
        if turn == _ROUNDS:
            break
        new = [cut for x in vertices for one in images if (cut := _between(one, x)) is not None]
        fresh = [cut for cut in dict.fromkeys(new) if cut not in set(cuts)]
        if not fresh:
            break
        cuts = [cuts[k] for k in sorted(used)] + fresh
    return tuple(cuts[k] for k in sorted(used))


def _floats(links: Links, name: str) -> _Image:
    bounds = links.bounds[name]
    matrix, constant = np.zeros((6, FRAMES.size)), np.zeros(6)
    for k, (body, number) in enumerate(links.parts(name)):
        constant[k] = float(number)
        for monomial, value in body.items():
            matrix[k, monomial[0]] = float(value)
    return _Image(name, matrix, constant, bounds.spans, bounds.rest)


def _vertices(
    links: Links, base: ConstraintRows, cuts: Sequence[Cut], images: dict[str, _Image]
) -> tuple[list[Floats], set[int]]:
    """Where programs end, and the cuts that have a multiplier in some of them."""
    rows, places = base.rows, base.places
    if cuts:
        more = np.array([_row(images[cut.image], cut) for cut in cuts])  # (cuts, unknowns + 2)
        both = np.concatenate([more, -more])
        limit = np.tile(np.abs(more[:, -1]), 2)
        extra = Quadratics(FRAMES, both[:, -2] - limit, both[:, :-2], np.zeros((len(both), len(FRAMES.pairs))))
        rows = Quadratics.joined([rows, extra])
        own = len(base.statement.rows) + np.tile(np.arange(len(cuts)), 2)
        places = np.concatenate([places, np.stack([own, np.repeat([0, 1], len(cuts))], axis=1)])
    box = links.box
    programs = FramePrograms(rows, places, box, np.zeros(len(FRAMES.pairs), dtype=np.bool_))
    found, used = [], set()
    for i in range(FRAMES.size):
        for sign in (1.0, -1.0):
            solution = programs.minimize(i, sign)
            if solution.status is not LinearStatus.OPTIMAL:
                continue
            found.append(box.mid + box.rad * solution.point[: FRAMES.size])
            used |= {k for k, *_ in programs.weights(solution).rows}
    start = len(base.statement.rows)
    return found, {k - start for k in used if k >= start}


def _row(one: _Image, cut: Cut) -> Floats:
    """Coefficients, constant and limit of |y (matrix x + constant)| <= limit."""
    y = np.array(cut.weights)
    limit = np.abs(y @ one.spans).sum() + np.abs(y) @ one.rest
    return np.concatenate([y @ one.matrix, [y @ one.constant, limit]])


def _between(one: _Image, x: Floats) -> Cut | None:
    """The plane between a vertex and what the image's errors can do; None where the vertex is not beyond them."""
    size = one.size
    at = (one.matrix @ x + one.constant) / size
    spans = one.spans / size[:, None]
    count = spans.shape[1]
    engine = Dense()
    matrix = np.concatenate([spans, -spans])
    engine.load(
        np.concatenate([matrix, -np.ones((12, 1))], axis=1),
        np.concatenate([at, -at]),
        np.append(-np.ones(count), 0.0),
        np.append(np.ones(count), np.abs(at).max() + 1.0),
    )
    solution = engine.minimize(np.append(np.zeros(count), 1.0))
    if solution.status is not LinearStatus.OPTIMAL or not solution.point[-1] > 0.0:
        return None
    y = np.zeros(6)
    for row, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
        y[row % 6] += weight if row < 6 else -weight
    y /= size
    if not y.any():
        return None
    y = np.round(y / np.abs(y).max() * 2.0**_BITS) / 2.0**_BITS
    row = _row(one, Cut(one.name, tuple(y.tolist())))
    beyond = abs(row[:-2] @ x + row[-2]) > row[-1] * (1.0 + _DEPTH)
    return Cut(one.name, tuple(y.tolist())) if beyond else None


# ------------------------------------------------------------------------------------------------------------------
# A chain of proofs at one tolerance: single images, what ties them together, then all pixels.
#
# 1. Certified poses of the target in single images (`prove_pose`): no frames, no robot pose.
# 2. Rows that tie these together by the robot's motions (`prove_links`): from any frames to a small box, in turns, for
#    what uncertain poses move depends on the box.
# 3. The pixels of all images (`prove`), where the robot's poses are exact.
#
# Each link begins with the box that the one before left. An image without a pose, or an empty box, refutes all.

_SPREAD = 9  # images that narrow the box where the robot's poses are exact: the pixels say the rest
_UNCERTAIN = 24  # images that narrow it where they are not: each takes time, and 40 leave 0.84 of what 24 do
_FEWEST = 3
_TURNS = 8
_WORTH = 0.8  # share of some width that another turn must be expected to leave, or less


@dataclass(frozen=True)
class LinkStep:
    """The name of a certificate that ties images together, and the cuts that it states."""

    certificate: str = field(metadata=checked(_FILE))
    cuts: tuple[Cut, ...]


@dataclass(frozen=True)
class Chain:
    """Certificates, each of which begins where the one before ended; see the module.

    `images`: of single images, which begin with all poses. `pixels`: names of certificates.
    """

    images: tuple[ImagePoseSet, ...]
    links: tuple[LinkStep, ...]
    pixels: tuple[str, ...] = field(metadata=checked(_FILE))

    @property
    def certificates(self) -> tuple[str, ...]:
        """The names of all files."""
        return (*(one.certificate for one in self.images), *(one.certificate for one in self.links), *self.pixels)


@dataclass(frozen=True, eq=False)
class ChainProof:
    """What is proved of a box of frames: `left` holds all that explain every pixel to within eps."""

    eps: float
    domain: Box
    left: Box
    images: tuple[tuple[str, NominalPose, FramesProof], ...]
    links: tuple[tuple[FramesProof, tuple[Cut, ...]], ...]
    pixels: tuple[FramesProof, ...]

    @property
    def refuted(self) -> bool:
        return self.left.is_empty

    @property
    def programs(self) -> int:
        proofs = (*(proof for *_, proof in self.images), *(proof for proof, _ in self.links), *self.pixels)
        return sum(proof.programs for proof in proofs)

    def written(self, name: str, folder: Path | None) -> Chain:
        """The chain as a run states it, its certificates written into the folder; empty without a folder."""
        if folder is None:
            return Chain((), (), ())

        def saved(proof: FramesProof, file: str) -> str:
            proof.write(folder / file)
            return file

        images = tuple(
            pose_set(image, nominal, proof, saved(proof, f"{name}-image-{k + 1}.cert.jsonl"))
            for k, (image, nominal, proof) in enumerate(self.images)
        )
        links = tuple(
            LinkStep(saved(proof, f"{name}-links-{k + 1}.cert.jsonl"), cuts)
            for k, (proof, cuts) in enumerate(self.links)
        )
        pixels = tuple(saved(proof, f"{name}-{k + 1}.cert.jsonl") for k, proof in enumerate(self.pixels))
        return Chain(images, links, pixels)


def pose_set(image: str, nominal: NominalPose, proof: FramesProof, certificate: str) -> ImagePoseSet:
    """As a run states it; without bounds where no pose is left."""
    nothing: tuple[float, ...] = ()
    lo, hi = (nothing if proof.refuted else tuple(end.tolist()) for end in (proof.left.lo, proof.left.hi))
    return ImagePoseSet(image, nominal, lo, hi, certificate)


def prove_chain(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    center: PlacedFrames,
    *,
    about: str,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> ChainProof:
    """Contract a box of frames about `center` until it is empty or gets no smaller, at a tolerance of eps px.

    After `time_limit` seconds no image and no turn more is begun, but for the fewest that say anything."""
    end = time.monotonic() + time_limit
    uncertain = bool(study.pose_half_width.any())
    nominal = nominal_poses(study)
    chosen = spread(study, sorted(nominal), _UNCERTAIN if uncertain else _SPREAD)
    images: list[tuple[str, NominalPose, FramesProof]] = []
    sets: list[ImagePoseSet] = []
    for k in chosen:
        if len(sets) >= _FEWEST and time.monotonic() > end:
            break
        proof = prove_pose(study, k, nominal[k], eps, pose_domain(study, k, nominal[k], domain))
        tell(f"{study.images[k]} alone: {'no pose is left' if proof.refuted else 'its pose is bounded'}")
        if proof.refuted:
            return ChainProof(eps, domain, nothing(domain), ((study.images[k], nominal[k], proof),), (), ())
        images.append((study.images[k], nominal[k], proof))
        sets.append(pose_set(study.images[k], nominal[k], proof, ""))
    links = _linked(study, sets, center, eps, domain, about, end, tell)
    left = links[-1][0].left
    if left.is_empty or uncertain:
        return ChainProof(eps, domain, left, tuple(images), links, ())
    rest = max(end - time.monotonic(), 0.0)
    pixels = prove(study, eps, left, about=about, time_limit=rest, tell=tell)
    return ChainProof(eps, domain, pixels.left, tuple(images), links, (pixels,))


def nominal_turn(center: PlacedFrames) -> tuple[float, ...]:
    """R_X0 of the links (9)."""
    return tuple(rotation_matrix(np.array(center.camera_quaternion)).ravel().tolist())


def nothing(domain: Box) -> Box:
    """Nothing."""
    return Box.empty(domain.names)


def _linked(
    study: HandEyeStudy,
    sets: Sequence[ImagePoseSet],
    center: PlacedFrames,
    eps: float,
    domain: Box,
    about: str,
    end: float,
    tell: Tell,
) -> tuple[tuple[FramesProof, tuple[Cut, ...]], ...]:
    found: list[tuple[FramesProof, tuple[Cut, ...]]] = []
    box = domain
    for turn in range(_TURNS):
        links = Links(study, sets, nominal_turn(center), box)
        # while the box is wide, what lies beyond first order is all that matters
        cuts = useful_cuts(links) if turn and study.pose_half_width.any() else ()
        proof = prove_links(links, cuts, eps, about=about, tell=tell)
        first = len(proof.statement.rows) - len(cuts)
        found.append((proof, tuple(cut for k, cut in enumerate(cuts, first) if k in proof.used)))
        left = proof.left
        if left.is_empty or (turn > 0 and not (left.width < _WORTH * box.width).any()) or time.monotonic() > end:
            break
        box = left
    return tuple(found)


def spread(study: HandEyeStudy, images: Sequence[int], count: int) -> list[int]:
    """So many of the images, each in turn the one whose pose is farthest from those chosen before."""
    if len(images) <= count:
        return list(images)
    turn = study.motions[0][list(images)].reshape(len(images), 9)
    place: Floats = study.poses.position[list(images)]
    place = place / max(float(np.ptp(place, axis=0).max()), 1e-9)
    where = np.concatenate([turn, place], axis=1)
    chosen = [0]
    gap = np.linalg.norm(where - where[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(where - where[chosen[-1]], axis=1))
    return sorted(images[k] for k in chosen)
