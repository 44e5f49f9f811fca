"""Where the platform can be when its controller says P, R: boxes proved to hold the true pose, leg by leg.

The true pose is written P + p, R(1, s) R. With the true parameters x of each leg in its certified set S, and a model
error e of at most eps, its n equations are, divided by 2 `scale` so that they are in mm,

    F_i(p, s) = (||P + p + R(1, s) R b - a||^2 - (L + l + e)^2) / (2 scale_i) = 0,     L the controller's reading

F(0) lies in the ranges of `deviations`, widened by eps. With z = (p, s), J the linear part of F at a cell's centre and
C a left inverse of it, z = C y, where y_i says by how much leg i is longer. Times 1 + s.s equations are polynomials,

    y_i = -F_i(0) - (what is linear in z besides, with poses of the cell and x of S) - (terms of degree two and more)

Where the image of a box Y about 0, bounded by sizes, lies inside of Y, no pose on its boundary solves them, whichever
part t F(0) of F(0), 0 <= t <= 1, is taken. At t = 0 the pose commanded does. So the platform with parameters x that
stands there, its legs then moved to the lengths that they have, stays in the image: that is the branch of assembly that
the controller means. A box of (p, s) would be far larger than that of y, for a platform can move where its legs hardly
change; what the measurements leave open of x mostly makes a leg longer as a whole, and adds a share of y_i. Coordinates
that the mechanism holds, `held`, are 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from typing import NamedTuple

import numpy as np

from cpcal.checker.platform import COORDINATES, AboutCenter, Commanded, Leg, LegEquation
from cpcal.common.errors import unusable
from cpcal.common.values import ArrayPair, Bools, Floats, crossed, norms
from cpcal.models.leg import cross, rotations
from cpcal.models.leg_set import CertifiedSet
from cpcal.robot import Pose, Robot, leg_vectors, normalised, pose_jacobian, small_rotation
from cpcal.solver.certificate.exact_network import free
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.interval.numbers import Intervals as Numbers
from cpcal.solver.interval.numbers import joined
from cpcal.solver.search.search import Decision, EventKind, Node, Piece, Search

# ------------------------------------------------------------------------------------------------------------------
# Interval vectors and matrices, many at a time: the last axes count components, those before broadcast.


def applied(matrix: IntervalArray, x: Numbers) -> IntervalArray:
    """M x, for matrices (..., m, n) and vectors (..., n)."""
    return (matrix * IntervalArray.of(x)[..., None, :]).sum(-1)


def transposed(matrix: IntervalArray) -> IntervalArray:
    """Of matrices (..., m, n)."""
    return IntervalArray(np.swapaxes(matrix.lo, -1, -2), np.swapaxes(matrix.hi, -1, -2))


def norm(x: IntervalArray) -> IntervalArray:
    """Of vectors (..., m)."""
    return x.sqr().sum(-1).sqrt()


def crossing(v: IntervalArray) -> IntervalArray:
    """The matrices (..., 3, 3) of s -> s x v."""
    nothing = IntervalArray.of(np.zeros(v.shape[:-1]))
    x, y, z = (v[..., k] for k in range(3))
    rows = ((nothing, z, -y), (-z, nothing, x), (y, -x, nothing))
    return joined([joined([one[..., None] for one in row])[..., None, :] for row in rows], -2)


# ------------------------------------------------------------------------------------------------------------------
# Cells of the workspace: all poses P + p, R(1, s) R(q) with (p, s) in a box around 0. A pose is a cell of no size.


class Cells(NamedTuple):
    """K cells: `center` holds K poses, exact numbers (R(q) divides by |q|^2); `reach` (K, 6) the boxes of (p, s)."""

    center: Pose
    reach: IntervalArray

    @classmethod
    def of_boxes(cls, boxes: IntervalArray) -> Cells:
        """Boxes (K, 6) of (P, S): the poses P, R(1, S), P in mm and 2 S the rotation vector to second order."""
        middle = boxes.mid
        away, c = IntervalArray.of(boxes) - middle, IntervalArray.of(middle[:, 3:])
        d = away[:, 3:]
        # (1, c + d) (1, -c), divided by its scalar part: R(1, c + d) = R(1, s) R(1, c)
        scalar = 1.0 + c.sqr().sum(-1) + (c * d).sum(-1)
        s = (d - cross(d, c)) / scalar[:, None]
        return cls(
            Pose(middle[:, :3], np.column_stack([np.ones(len(middle)), middle[:, 3:]])), joined([away[:, :3], s])
        )

    @classmethod
    def of_poses(cls, poses: Pose) -> Cells:
        """Poses alone."""
        return cls(poses, IntervalArray.of(np.zeros((len(poses.position), 6))))


# ------------------------------------------------------------------------------------------------------------------
# The equations of the legs over cells. Sizes are floats that nothing negative enters: sums of them are off by a few
# hundred roundings at most, which `_ROUNDED` makes up for.

_TRIES = 20  # inflations of Y
_REFINED = 30  # images after the proof
_INFLATE = 1.1
_CENTERINGS = 2
_ROUNDED, _LOST = 1.0 + 1e-12, 1e-13


class PoseBounds(NamedTuple):
    """For K cells; where `proved` is False nothing is, and bounds are infinite.

    position  (K,) mm: ||p|| is at most this; rotation (K,) rad: the angle of R(1, s) is at most this
    """

    proved: Bools
    position: Floats
    rotation: Floats


def cell_bounds(cells: Cells, sets: Sequence[CertifiedSet], held: Sequence[int] = ()) -> tuple[PoseBounds, PoseBounds]:
    """Proved bounds for all poses of each cell, and for the centers alone, for the certified sets of a robot's legs."""
    over, centers = Equations(cells, sets, held), Equations(Cells.of_poses(cells.center), sets, held)
    at_center = centers.deviations()
    return over.bounds(at_center + over.across(centers)), centers.bounds(at_center)


def pose_inverse(jacobian: Floats, held: Sequence[int] = ()) -> Floats:
    """(..., 6, n): how the pose follows the legs, by the pseudo-inverse of (..., n, 6); 0 for coordinates `held`."""
    free, out = np.setdiff1d(np.arange(6), held), np.zeros(np.swapaxes(jacobian, -1, -2).shape)
    out[..., free, :] = np.linalg.pinv(jacobian[..., free])
    return out


def centered(pose: Commanded, legs: Sequence[Leg], held: Sequence[int] = ()) -> ArrayPair:
    """What the checker's `pose_bounds` takes: a center (6,) of (p, s), nearly the middle of what the legs allow, and a
    left inverse (6, n) of their equations' slopes there over |q|^2."""
    equations, center = [LegEquation(pose, leg, free) for leg in legs], np.zeros(6)
    for left in range(_CENTERINGS, -1, -1):
        about = [AboutCenter(one, [F(v) for v in center.tolist()]) for one in equations]
        inverse = pose_inverse(np.array([[float(v / pose.norm) for v in one.slopes] for one in about]), held)
        middle = [float(sum(one.value, F(0)) / (2 * pose.norm)) for one in about]
        center = center + inverse @ middle if left else center
    return center, inverse


class Equations:
    """F of n legs over K cells, for all x of the sets, with left inverses C (K, 6, n) of its linear part.

    For the legs that the controller believes in: `rotation` (K, 1, 3, 3): R. `arm` (K, n, 3): R b^. `vector` (K, n, 3):
    v = P + R b^ - a^, mm. `length` (K, n): ||v||.
    """

    def __init__(self, cells: Cells, sets: Sequence[CertifiedSet], held: Sequence[int] = ()) -> None:
        self.cells, self.sets = cells, sets
        self.controller, self.basis = np.stack([one.controller for one in sets]), np.stack([one.basis for one in sets])
        self.box, self.along = (joined([getattr(one, name)[None] for one in sets], 0) for name in ("box", "along"))
        robot = Robot.from_parameters("controller", self.controller)
        # the middle of the sets: any parameters serve
        self.middle = self.controller + (self.basis @ self.along.mid[..., None])[..., 0]
        # mm: lengths of the legs at the centers, in floating point, make deviations mm
        self.scale = norms(leg_vectors(robot, cells.center))
        among = Robot.from_parameters("middle", self.middle)
        length = norms(leg_vectors(among, cells.center))
        self.jacobian = pose_jacobian(among, cells.center) * (length / self.scale)[..., None]
        self.jacobian[..., 3:] *= 2.0
        self.jacobian[..., list(held)] = 0.0
        with np.errstate(all="ignore"):
            self.regular = np.linalg.cond(np.delete(self.jacobian, held, axis=-1)) < 1e12
            self.inverse = pose_inverse(np.where(self.regular[:, None, None], self.jacobian, 1.0), held)
        turn = joined([IntervalArray.of(np.ones((len(cells.reach.lo), 1))), cells.reach[:, 3:]])
        turned, before = rotations(turn), rotations(IntervalArray.of(cells.center.quaternion))
        self.rotation = (turned[..., :, :, None] * before[..., None, :, :]).sum(-2)[:, None]
        self.arm = applied(self.rotation, self.controller[None, :, 3:6])
        position = cells.center.position + cells.reach[:, :3]
        self.vector = position[:, None] + self.arm - self.controller[None, :, :3]
        self.length = norm(self.vector)
        self._directions = np.swapaxes(self.basis, 1, 2)[None]  # (1, n, 7 directions, 7 components)
        self._turned = applied(self.rotation[:, :, None], self._directions[..., 3:6])  # (K, n, 7, 3)

    def deviations(self) -> IntervalArray:
        """(K, n) mm at centers: (||P + R b - a||^2 - (||v|| - l^ + l)^2) / (2 scale) over S."""
        exact = self._form() / self.scale[..., None]
        asked = exact.mid
        at_center = joined([one.ranges(asked[:, k])[:, None] for k, one in enumerate(self.sets)])
        return at_center + ((exact - asked) * self.box[None]).sum(-1)

    def _form(self) -> IntervalArray:
        """(K, n, 17): the linear form in z of each leg."""
        count, n = self.length.shape
        of_products = -IntervalArray.of(self.rotation.reshape((count, 1, 9)).broadcast_to((count, n, 9)))
        of_beta, of_w = applied(transposed(self.rotation), self.vector), IntervalArray.of(np.full((count, n, 1), 0.5))
        return joined([-self.vector, of_beta, -self.length[..., None], of_w, of_products])

    def across(self, centers: Equations) -> IntervalArray:
        """(K, n) mm: what the linear form adds between the centers and the other poses of the cells, for all z of S.

        Of its first seven coefficients as a mean-value form in (p, s) for each direction of the sets' basis: a
        direction that the measurements leave open changes the length much the same at all poses. Of the products by
        their boxes.
        """
        linear = ((self._slopes() * self.cells.reach[:, None, None, :]).sum(-1) * self.along[None]).sum(-1)
        # z[:7] = basis @ (basis.T @ z) + (I - basis @ basis.T) z[:7]: rounding alone
        squared = (IntervalArray.of(self.basis[:, :, None, :]) * self.basis[:, None, :, :]).sum(-1)
        lost = applied(np.eye(7)[None] - squared, self.box[:, :7])
        change = self._form() - centers._form()
        added = linear + (change[..., :7] * lost[None]).sum(-1)
        return (added + (change[..., 8:] * self.box[None, :, 8:]).sum(-1)) / self.scale

    def _slopes(self) -> IntervalArray:
        """(K, n, 7, 6): gradient in (p, s) of v.(R tau_b - tau_a) - ||v|| tau_l for each direction tau of the basis."""
        tau = self._directions
        unit = (self.vector / self.length[..., None])[:, :, None]
        of_position = self._turned - tau[..., :3] - unit * tau[..., 6:]
        of_turn = cross(self._turned, self.vector[:, :, None]) + cross(self.arm[:, :, None], of_position)
        # R(1, s + ds) turns R(1, s) by omega = 2 (ds + s x ds) / (1 + s.s), which changes it by of_turn.omega
        s = self.cells.reach[:, None, None, 3:]
        of_s = (2.0 / (1.0 + s.sqr().sum(-1)))[..., None] * (of_turn - cross(s, of_turn))
        return joined([of_position, of_s])

    def bounds(self, deviation: IntervalArray) -> PoseBounds:
        """From F(0) without errors e."""
        value = self.with_error(deviation)
        good = self.regular & np.isfinite(value.lo).all(axis=1)
        with np.errstate(all="ignore"):
            image = self.image(value)
            size, proved = proved_sizes(image, value.mag, good)
            size, more = (np.where(proved[:, None], of, 0.0) for of in (size, image(size)))
        y = (IntervalArray(-more, more) - value).intersect(IntervalArray(-size, size))
        return PoseBounds(proved, *(np.where(proved, most, np.inf) for most in sizes(self.inverse, y)))

    def with_error(self, deviation: IntervalArray) -> IntervalArray:
        """With all errors e: the deviation less e (2 (L + l) + e) / (2 scale). Infinite for legs below eps."""
        eps = np.array([one.eps for one in self.sets])[None]
        length = self.length + self.box[None, :, 6]  # L + l
        most = eps * ((length + 0.5 * IntervalArray.of(eps)) / self.scale)
        reach = np.where(length.lo <= eps, np.inf, most.hi)
        return deviation + IntervalArray(-reach, reach)

    def image(self, value: IntervalArray) -> Callable[[Floats], Floats]:
        """How large y + F(0) can be, (K, n), for sizes of y (K, n) and F(0) in `value`: a function of the sizes of y.

        With r the mobile joint's place R b, w = P - a, v = w + r, d = p + 2 s x r, and x off the middle by t tau along
        its directions, F (1 + s.s) 2 scale has, beside its value at 0 and J z, these terms: linear in z the change of J
        over the cell, and t (2 Delta.p + 4 s.(r x Delta + R tau_b x v)), Delta = R tau_b - tau_a; of degree two
        ||d||^2 - 4 (s x v).(s x r) and F(0) s.s; and the rest, which is small.

        y is J (C J)^-1 z. With E = I - C J and |E| r <= r / 2 for sizes r of z, it is J z but for at most 2 |J| |E| r.
        """
        scale = 2.0 * self.scale
        ends = IntervalArray.of(self.middle)[None]
        arm = applied(self.rotation, ends[..., 3:6])
        place = self.cells.center.position + self.cells.reach[:, :3]
        place = IntervalArray.of(place[:, None] - ends[..., :3])
        leg = place + arm
        delta = self._turned - self._directions[..., :3]
        moment = cross(arm[:, :, None], delta) + cross(self._turned, leg[:, :, None])
        shares = self._sizes(joined([2.0 * delta, 4.0 * moment])) / scale[..., None, None]
        slopes = joined([2.0 * leg, 4.0 * cross(arm, leg)]) / scale[..., None]
        size_of, steep = np.abs(self.inverse), np.abs(self.jacobian)
        lost = np.abs(np.eye(6) - self.inverse @ self.jacobian) + _LOST * (size_of @ steep)
        linear = self._sizes(slopes - self.jacobian) + 2.0 * (steep @ lost @ size_of)
        off = self.box[:, :7] - (self.middle - self.controller)
        # the basis is orthonormal up to rounding: so much more covers what that leaves
        stray = 1e-12 * off.mag.sum(axis=1, keepdims=True)
        far = (
            self.along - applied(transposed(IntervalArray.of(self.basis)), self.middle - self.controller)
        ).mag + stray
        linear = linear + (far[None, :, :, None] * shares).sum(axis=2)
        identity, nothing = np.broadcast_to(np.eye(3), (*leg.shape, 3)), np.zeros((*leg.shape, 3))
        forms = (
            joined([IntervalArray.of(one), way])
            for one, way in ((identity, 2.0 * crossing(arm)), (nothing, crossing(leg)), (nothing, crossing(arm)))
        )
        # ||d||^2 - 4 (s x v).(s x r) in y: about the middles of these three, and what they are off
        (d, d_off), (of_v, v_off), (of_r, r_off) = map(self._in_legs, forms)
        half = np.swapaxes(of_v, -1, -2) @ of_r
        middle = np.abs(np.swapaxes(d, -1, -2) @ d - 2.0 * (half + np.swapaxes(half, -1, -2)))
        far_d, far_v, far_r = (np.abs(one) for one in (d, of_v, of_r))
        base, swing = off[:, :3].mag[None], applied(IntervalArray.of(self.rotation), off[None, :, 3:6]).mag
        at, arm_, leg_, value_ = place.mag, arm.mag, leg.mag, value.mag

        def image(y: Floats) -> Floats:
            z = (size_of @ y[..., None])[..., 0]
            near = np.asarray((2.0 * (lost @ z[..., None])[..., 0] <= z).all(axis=1))
            p, s = z[:, None, :3], z[:, None, 3:]
            square = (s * s).sum(axis=-1)
            column = y[:, None, :, None]
            (a, da), (b, db), (c, dc) = (
                ((one @ column)[..., 0], (by @ column)[..., 0])
                for one, by in ((far_d, d_off), (far_v, v_off), (far_r, r_off))
            )
            beside = (2.0 * a + da) * da + _LOST * a * a + 4.0 * ((b + db) * dc + db * c + _LOST * b * c)
            curved = (
                (y[:, None] * (middle @ column)[..., 0]).sum(axis=-1) + beside.sum(axis=-1) + value_ * scale * square
            )
            turned = crossed(s, swing)
            more = square * ((p * p).sum(axis=-1) + 2.0 * (p * (leg_ + base + swing)).sum(axis=-1))
            more += 4.0 * (p * crossed(s, crossed(s, arm_))).sum(axis=-1)
            more += 4.0 * ((p + base) * turned + base * crossed(s, crossed(s, arm_))).sum(axis=-1)
            more += 4.0 * ((at + p + base) * crossed(s, turned)).sum(axis=-1)
            found = ((linear @ y[..., None])[..., 0] + (curved + more) / scale) * _ROUNDED
            return np.where(near[:, None], found, np.inf)

        return image

    def _in_legs(self, gradients: IntervalArray) -> ArrayPair:
        """(K, n, ..., n): coefficients of y in what has these gradients (K, n, ..., 6) in z = C y, and how far off."""
        inverse = self.inverse.reshape((len(self.inverse), *[1] * (len(gradients.shape) - 3), *self.inverse.shape[1:]))
        middle = gradients.mid
        off = np.maximum(gradients.hi - middle, middle - gradients.lo) + _LOST * gradients.mag
        return middle @ inverse, (off @ np.abs(inverse)) * _ROUNDED

    def _sizes(self, gradients: IntervalArray) -> Floats:
        """At most so large are these coefficients."""
        middle, off = self._in_legs(gradients)
        return np.asarray(np.abs(middle) + off)


def proved_sizes(image: Callable[[Floats], Floats], value: Floats, good: Bools) -> tuple[Floats, Bools]:
    """Sizes of Y (K, n) of which it is proved that |value| + image(Y) lies inside, and where."""
    size, proved = value, np.zeros(len(good), bool)
    for _ in range(_TRIES):
        grown = np.where(proved[:, None], size, _INFLATE * (value + image(size)) + 1e-9)
        size = np.where(np.isfinite(grown), grown, size)
        proved = good & (value + image(size) < size).all(axis=1)
        if proved[good].all():
            break
    for _ in range(_REFINED):
        size = np.where(proved[:, None], np.minimum(size, (value + image(size)) * _ROUNDED), size)
    return size, proved


def sizes(inverse: Floats, y: IntervalArray) -> ArrayPair:
    """Bounds (K,) of ||p|| in mm and of the angle in rad, for (p, s) = C y: a norm is largest at a corner of the box.

    The angle of R(1, s) is 2 atan ||s|| <= 2 ||s||.
    """
    legs = inverse.shape[-1]
    corners = (np.arange(1 << legs)[:, None] >> np.arange(legs) & 1).astype(bool)
    values = np.where(corners[None], y.hi[:, None], y.lo[:, None])  # (K, 2^n, n)
    moves = applied(IntervalArray.of(inverse)[:, None], values)  # (K, 2^n, 6)
    position, turn = (norm(moves[..., part]).hi.max(axis=1) for part in (slice(3), slice(3, 6)))
    return position, 2.0 * turn


# ------------------------------------------------------------------------------------------------------------------
# The workspace, and the worst that the certified sets allow anywhere in it: branch and bound on the worst cell.

AXES = COORDINATES  # of a workspace
_SIDES = 3  # of the first grid, along each axis of position that has a width
_AT_ONCE = 12  # cells divided at a time
_SMALLEST = 1.0 / 64.0  # of the workspace's width: a cell that is not proved at that size is left out
_ARM = 100.0  # mm: a half-turn's component is worth so many mm a radian, when the longest side is chosen


@dataclass(frozen=True)
class Workspace:
    """All poses P, R(1, S) with `lo <= (P, 2 S) <= hi`: mm and rad, 2 S the rotation vector to second order.

    Raises InputError for bounds that cross or are not finite.
    """

    lo: tuple[float, ...]
    hi: tuple[float, ...]

    def __post_init__(self) -> None:
        bad = [n for n, a, b in zip(AXES, self.lo, self.hi, strict=True) if not -np.inf < a <= b < np.inf]
        if bad or len(self.lo) != len(AXES):
            what = f"has bounds that cross or are not finite: {', '.join(bad)}"
            raise unusable("workspace", what, "give LO:HI with LO <= HI for each axis")

    @classmethod
    def parsed(cls, text: str) -> Workspace:
        """Of `x=-50:50,y=-50:50,z=430:480,rx=-2:2`, degrees for rx, ry, rz; one number is both ends. InputError."""
        known = dict.fromkeys(AXES[3:], (0.0, 0.0))
        for part in text.split(","):
            name, _, ends = part.strip().partition("=")
            low, _, high = ends.partition(":")
            try:
                pair = float(low), float(high or low)
            except ValueError:
                name = ""
            if name not in AXES:
                what = f"{part.strip()!r} is no range of an axis"
                raise unusable("workspace", what, "write x=-50:50,y=-50:50,z=430:480, and rx, ry, rz in deg")
            known[name] = pair if name in AXES[:3] else (float(np.radians(pair[0])), float(np.radians(pair[1])))
        missing = [name for name in AXES if name not in known]
        if missing:
            raise unusable("workspace", f"lacks {', '.join(missing)}", "give x, y and z in mm")
        return cls(tuple(known[n][0] for n in AXES), tuple(known[n][1] for n in AXES))

    @property
    def box(self) -> IntervalArray:
        """(6,) of (P, S), outward."""
        lo, hi = np.array(self.lo), np.array(self.hi)
        half = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
        return IntervalArray(lo * half, hi * half)  # halves of floats are exact


def rotated(rows: Floats) -> Pose:
    """Poses P, R(1, S) of rows (P, 2 S)."""
    return Pose(rows[:, :3], normalised(small_rotation(rows[:, 3:])))


class Covered(NamedTuple):
    """What the branch and bound leaves.

    `cells`: boxes of (P, S) that cover the workspace, each with the `CellBound` that is proved. `at` (6,): the pose
    whose own bound is the worst that was met, `at_position` mm. `complete`: the search ended by its gap.
    """

    cells: Sequence[Piece]
    at: Floats
    at_position: float
    complete: bool


def cover(
    workspace: Workspace,
    sets: Sequence[CertifiedSet],
    *,
    held: Sequence[int] = (),
    gap: float = 0.2,
    most: int = 600,
    tell: Callable[[float, float], None] | None = None,
) -> Covered:
    """Cells are divided where the bound is worst, until it is within `gap` of what a pose attains, or `most` cells.

    Cells of which nothing can be proved are divided first; at a 64th of the workspace's width they are left out.
    `tell` is called with the bracket of the worst bound, mm.
    """
    dividing = _Dividing(sets, workspace.box, gap, held)
    first = dividing.pieces(first_grid(workspace.box))
    search = Search(first, dividing, lambda node: -node.state.worth, abreast=_AT_ONCE)
    while True:
        if tell is not None:
            waits = 0.0 if search.lowest is None else max(-search.lowest, 0.0)
            tell(dividing.attained, max(waits, dividing.highest_kept))
        if not search.waiting or search.waiting + len(search.kept) >= most:
            break
        next(search)
    cells = [*search.kept, *(Piece(node.box, node.state) for node in search.pending)]
    return Covered(cells, dividing.at, dividing.attained, not search.waiting)


class CellBound(NamedTuple):
    """Whether anything is proved of a cell: none of its poses is off by more than `position` mm and `rotation` rad;
    `worth`: the bound that a division may lower, 0 where it is left out."""

    proved: bool
    position: float
    rotation: float
    worth: float


class _Dividing:
    """The process of the search. `at` (6,) is the pose met whose own bound is the worst, `attained` mm."""

    def __init__(self, sets: Sequence[CertifiedSet], whole: IntervalArray, gap: float, held: Sequence[int]) -> None:
        self._sets, self._gap, self._held = sets, gap, held
        self._width = np.where(whole.hi > whole.lo, whole.hi - whole.lo, np.inf)
        self.at, self.attained, self.highest_kept = whole.mid, 0.0, 0.0

    def pieces(self, boxes: IntervalArray) -> list[Piece]:
        """Cells (K, 6) with their bounds."""
        over, centers = cell_bounds(Cells.of_boxes(boxes), self._sets, self._held)
        met = np.where(centers.proved, centers.position, 0.0)
        if met.max() > self.attained:
            self.at, self.attained = boxes.mid[met.argmax()], float(met.max())
        small = ((boxes.hi - boxes.lo) / self._width).max(axis=1) <= _SMALLEST
        worth = np.where(~over.proved & small, 0.0, over.position)
        cells = map(CellBound, *(of.tolist() for of in (over.proved, over.position, over.rotation, worth)))
        return list(map(Piece, Box.rows(AXES, boxes.lo, boxes.hi), cells))

    def __call__(self, node: Node) -> Decision:
        return self.all([node])[0]

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """Each is cut in two along its longest side, where that may lower the worst bound."""
        boxes = Box.stacked(node.box for node in nodes)
        worth = np.array([node.state.worth for node in nodes])
        cut = np.flatnonzero((worth > (1.0 + self._gap) * self.attained) & (boxes.hi > boxes.lo).any(axis=1))
        halves = []
        if cut.size:
            divided, rows = boxes[cut], np.arange(cut.size)
            size = (divided.hi - divided.lo) * np.array([1.0, 1.0, 1.0, _ARM, _ARM, _ARM])
            axis = np.argmax(size, axis=1)
            first_hi, second_lo = divided.hi.copy(), divided.lo.copy()
            first_hi[rows, axis] = second_lo[rows, axis] = divided.mid[rows, axis]
            both = np.concatenate([divided.lo, second_lo]), np.concatenate([first_hi, divided.hi])
            halves = self.pieces(IntervalArray(*both))
        self.highest_kept = max(self.highest_kept, float(np.delete(worth, cut).max(initial=0.0)))
        found = {int(k): (EventKind.SPLIT, (halves[i], halves[len(cut) + i])) for i, k in enumerate(cut)}
        return [
            Decision(kind, Contraction(node.box), pieces)
            for k, node in enumerate(nodes)
            for kind, pieces in [found.get(k, (EventKind.KEPT, (Piece(node.box, node.state),)))]
        ]


def first_grid(whole: IntervalArray) -> IntervalArray:
    """The workspace in equal parts along the axes of position that have a width."""
    lo, hi = whole.lo[None], whole.hi[None]
    for axis in np.flatnonzero(whole.hi[:3] > whole.lo[:3]):
        cuts = np.linspace(whole.lo[axis], whole.hi[axis], _SIDES + 1)
        lo, hi = np.repeat(lo, _SIDES, axis=0), np.repeat(hi, _SIDES, axis=0)
        lo[:, axis], hi[:, axis] = np.tile(cuts[:-1], len(lo) // _SIDES), np.tile(cuts[1:], len(hi) // _SIDES)
    return IntervalArray(lo, hi)
