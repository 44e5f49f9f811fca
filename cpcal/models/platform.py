"""Where the platform can be when its controller says P, R: boxes proved by interval Newton to hold the true pose.

The true pose is written P + p, R(1, s) R. With the true parameters x of each leg in its certified set S, and a model
error e of at most eps, its n equations are, divided by 2 `scale` so that they are in mm,

    F_i(p, s) = (||P + p + R(1, s) R b - a||^2 - (L + l + e)^2) / (2 scale_i) = 0,     L the controller's reading

F(0) lies in the ranges of `deviations`, widened by eps. The Krawczyk operator of F, with x over S and e over
[-eps, eps], is taken for all poses of a cell at once; where its image lies in the interior of the box D of (p, s), for
every x and e exactly one (p, s) in D solves the equations, and it lies in the image (see existence.operators). More
than six equations are combined into six by the operator's weights. Coordinates that the mechanism holds, `held`, are 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import unusable
from cpcal.common.values import Bools, Floats
from cpcal.models.leg import rotations
from cpcal.models.leg_set import CertifiedSet
from cpcal.robot import Pose, Robot, leg_vectors, normalised, pose_jacobian, small_rotation
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.search import Decision, EventKind, Node, Piece, Search

# ------------------------------------------------------------------------------------------------------------------
# Interval vectors and matrices, many at a time: the last axes count components, those before broadcast.

ENGINE = get_arithmetic("float64")
_FORTH, _BACK = [1, 2, 0], [2, 0, 1]


class Intervals(IntervalArray):
    """Intervals in float64 with operators, for which arrays are exact numbers."""

    __array_ufunc__ = None  # so that numpy leaves array + intervals to these

    def __add__(self, other: Numbers) -> Intervals:
        return intervals(ENGINE.add(self, intervals(other)))

    def __sub__(self, other: Numbers) -> Intervals:
        return intervals(ENGINE.sub(self, intervals(other)))

    def __rsub__(self, other: Numbers) -> Intervals:
        return intervals(other) - self

    def __mul__(self, other: Numbers) -> Intervals:
        return intervals(ENGINE.mul(self, intervals(other)))

    def __truediv__(self, other: Numbers) -> Intervals:
        return intervals(ENGINE.div(self, intervals(other)))

    def __rtruediv__(self, other: Numbers) -> Intervals:
        return intervals(other) / self

    def __neg__(self) -> Intervals:
        return intervals(ENGINE.neg(self))

    def __getitem__(self, index: Any) -> Intervals:
        return intervals(super().__getitem__(index))

    __radd__, __rmul__ = __add__, __mul__


Numbers = IntervalArray | npt.ArrayLike


def intervals(values: Numbers) -> Intervals:
    """Exact numbers, or intervals, with operators."""
    if isinstance(values, Intervals):
        return values
    found = values if isinstance(values, IntervalArray) else IntervalArray.point(np.asarray(values, np.float64))
    return Intervals(found.lo, found.hi)


def total(x: Intervals, axis: int = -1) -> Intervals:
    """The sum along an axis, which may count from the end."""
    return intervals(ENGINE.sum(x, axis % x.ndim))


def squares(x: Intervals) -> Intervals:
    """Of vectors (..., m)."""
    return total(intervals(ENGINE.sqr(x)))


def cross(x: Intervals, y: Intervals) -> Intervals:
    """Of vectors (..., 3) and (..., 3)."""
    return x[..., _FORTH] * y[..., _BACK] - x[..., _BACK] * y[..., _FORTH]


def applied(matrix: Intervals, x: Numbers) -> Intervals:
    """M x, for matrices (..., m, n) and vectors (..., n)."""
    return total(matrix * intervals(x)[..., None, :])


def transposed(matrix: Intervals) -> Intervals:
    """Of matrices (..., m, n)."""
    return Intervals(np.swapaxes(matrix.lo, -1, -2), np.swapaxes(matrix.hi, -1, -2))


def norm(x: Intervals) -> Intervals:
    """Of vectors (..., m)."""
    return intervals(ENGINE.sqrt(squares(x)))


def joined(parts: Sequence[IntervalArray], axis: int = -1) -> Intervals:
    """One after the other along an axis."""
    return Intervals(np.concatenate([p.lo for p in parts], axis), np.concatenate([p.hi for p in parts], axis))


def turned_pose(s: Intervals, center: Pose) -> Intervals:
    """R(1, s) R(q) (K, 1, 3, 3) of s (K, 3)."""
    one = joined([intervals(np.ones((len(s.lo), 1))), s])
    turn, before = (intervals(rotations(q, ENGINE)) for q in (one, intervals(center.quaternion)))
    return total(turn[..., :, :, None] * before[..., None, :, :], -2)[:, None]


def along_turn(s: Intervals, m: Intervals) -> Intervals:
    """The gradient in s, (..., 3), of what changes by m.omega under a small turn omega of R(1, s).

    R(1, s + ds) turns R(1, s) by omega = 2 (ds + s x ds) / (1 + s.s), hence 2 (m - s x m) / (1 + s.s).
    """
    return (2.0 / (1.0 + squares(s)))[..., None] * (m - cross(s, m))


# ------------------------------------------------------------------------------------------------------------------
# Cells of the workspace: all poses P + p, R(1, s) R(q) with (p, s) in a box around 0. A pose is a cell of no size.


@dataclass(frozen=True, eq=False)
class Cells:
    """K cells: `center` holds K poses, exact numbers (R(q) divides by |q|^2); `reach` (K, 6) the boxes of (p, s)."""

    center: Pose
    reach: Intervals

    @classmethod
    def of_boxes(cls, boxes: IntervalArray) -> Cells:
        """Boxes (K, 6) of (P, S): the poses P, R(1, S), P in mm and 2 S the rotation vector to second order."""
        middle = boxes.mid
        away, c = intervals(boxes) - middle, intervals(middle[:, 3:])
        d = away[:, 3:]
        # (1, c + d) (1, -c), divided by its scalar part: R(1, c + d) = R(1, s) R(1, c)
        scalar = 1.0 + squares(c) + total(c * d)
        s = (d - cross(d, c)) / scalar[:, None]
        return cls(
            Pose(middle[:, :3], np.column_stack([np.ones(len(middle)), middle[:, 3:]])), joined([away[:, :3], s])
        )

    @classmethod
    def of_poses(cls, poses: Pose) -> Cells:
        """Poses alone."""
        return cls(poses, intervals(np.zeros((len(poses.position), 6))))


# ------------------------------------------------------------------------------------------------------------------
# The equations of the legs over cells, and Newton's operator.

_TRIES = 8  # inflations of D
_REFINED = 3  # applications of the operator after the proof
_INFLATE = 0.15  # of the image's width, on both sides
_STRAY = 1e-12


@dataclass(frozen=True, eq=False)
class PoseBounds:
    """For K cells; where `proved` is False nothing is, and bounds are infinite.

    box       (K, 6): (p, s) of the true pose, mm and half a rotation vector, for all poses of the cell
    position  (K,) mm: ||p|| is at most this; rotation (K,) rad: the angle of R(1, s) is at most this
    """

    proved: Bools
    box: IntervalArray
    position: Floats
    rotation: Floats


def cell_bounds(cells: Cells, sets: Sequence[CertifiedSet], held: Sequence[int] = ()) -> tuple[PoseBounds, PoseBounds]:
    """Proved bounds for all poses of each cell, and for the centers alone, for the certified sets of a robot's legs."""
    over, centers = Equations(cells, sets, held), Equations(Cells.of_poses(cells.center), sets, held)
    at_center = centers.deviations()
    return over.bounds(at_center + over.across(centers)), centers.bounds(at_center)


def pose_bounds(poses: Pose, sets: Sequence[CertifiedSet], held: Sequence[int] = ()) -> PoseBounds:
    """The same for K poses."""
    centers = Equations(Cells.of_poses(poses), sets, held)
    return centers.bounds(centers.deviations())


def pose_inverse(jacobian: Floats, held: Sequence[int] = ()) -> Floats:
    """(..., 6, n): how the pose follows the legs, by the pseudo-inverse of (..., n, 6); 0 for coordinates `held`."""
    free, out = np.setdiff1d(np.arange(6), held), np.zeros(np.swapaxes(jacobian, -1, -2).shape)
    out[..., free, :] = np.linalg.pinv(jacobian[..., free])
    return out


class Equations:
    """F of n legs over K cells, for all x of the sets, with approximate inverses C (K, 6, n) of its Jacobian.

    For the legs that the controller believes in: `rotation` (K, 1, 3, 3): R. `arm` (K, n, 3): R b^. `vector` (K, n, 3):
    v = P + R b^ - a^, mm. `length` (K, n): ||v||.
    """

    def __init__(self, cells: Cells, sets: Sequence[CertifiedSet], held: Sequence[int] = ()) -> None:
        self.cells, self.sets = cells, sets
        self.controller, self.basis = np.stack([one.controller for one in sets]), np.stack([one.basis for one in sets])
        self.box, self.along = (joined([getattr(one, name)[None] for one in sets], 0) for name in ("box", "along"))
        robot = Robot.from_parameters("controller", self.controller)
        jacobian = pose_jacobian(robot, cells.center)
        jacobian[..., 3:] *= 2.0
        self._free = np.diag(np.isin(np.arange(6), held, invert=True).astype(np.float64))
        with np.errstate(all="ignore"):
            self.regular = np.linalg.cond(np.delete(jacobian, held, axis=-1)) < 1e12
            self.inverse = pose_inverse(np.where(self.regular[:, None, None], jacobian, 1.0), held)
        self.rotation = turned_pose(cells.reach[:, 3:], cells.center)
        self.arm = applied(self.rotation, self.controller[None, :, 3:6])
        position = cells.center.position + cells.reach[:, :3]
        self.vector = position[:, None] + self.arm - self.controller[None, :, :3]
        self.length = norm(self.vector)
        # mm: lengths of the legs at the centers, in floating point, make deviations mm
        self.scale: Floats = np.linalg.norm(leg_vectors(robot, cells.center), axis=-1)
        self._directions = np.swapaxes(self.basis, 1, 2)[None]  # (1, n, 7 directions, 7 components)

    def deviations(self) -> Intervals:
        """(K, n) mm at centers: (||P + R b - a||^2 - (||v|| - l^ + l)^2) / (2 scale) over S."""
        exact = self._form() / self.scale[..., None]
        asked = exact.mid
        at_center = joined([one.ranges(asked[:, k])[:, None] for k, one in enumerate(self.sets)])
        return at_center + total((exact - asked) * self.box[None])

    def _form(self) -> Intervals:
        """(K, n, 17): the linear form in z of each leg."""
        count, n = self.length.shape
        of_products = -intervals(self.rotation.reshape((count, 1, 9)).broadcast_to((count, n, 9)))
        of_beta, of_w = applied(transposed(self.rotation), self.vector), intervals(np.full((count, n, 1), 0.5))
        return joined([-self.vector, of_beta, -self.length[..., None], of_w, of_products])

    def across(self, centers: Equations) -> Intervals:
        """(K, n) mm: what the linear form adds between the centers and the other poses of the cells, for all z of S.

        Of its first seven coefficients as a mean-value form in (p, s) for each direction of the sets' basis: a
        direction that the measurements leave open changes the length much the same at all poses. Of the products by
        their boxes.
        """
        linear = total(total(self._slopes() * self.cells.reach[:, None, None, :]) * self.along[None])
        # z[:7] = basis @ (basis.T @ z) + (I - basis @ basis.T) z[:7]: rounding alone
        squared = total(intervals(self.basis[:, :, None, :]) * self.basis[:, None, :, :])
        lost = applied(np.eye(7)[None] - squared, self.box[:, :7])
        change = self._form() - centers._form()
        added = linear + total(change[..., :7] * lost[None])
        return (added + total(change[..., 8:] * self.box[None, :, 8:])) / self.scale

    def _slopes(self) -> Intervals:
        """(K, n, 7, 6): gradient in (p, s) of v.(R tau_b - tau_a) - ||v|| tau_l for each direction tau of the basis."""
        tau = self._directions
        turned_b = applied(self.rotation[:, :, None], tau[..., 3:6])  # (K, n, 7, 3)
        unit = (self.vector / self.length[..., None])[:, :, None]
        of_position = turned_b - tau[..., :3] - unit * tau[..., 6:]
        of_turn = cross(turned_b, self.vector[:, :, None]) + cross(self.arm[:, :, None], of_position)
        return joined([of_position, along_turn(self.cells.reach[:, None, None, 3:], of_turn)])

    def bounds(self, deviation: Intervals) -> PoseBounds:
        """From F(0) without errors e."""
        value = self.with_error(deviation)
        step = -applied(intervals(self.inverse), value)
        image, proved = proved_image(self.spread, step, self.regular & np.isfinite(value.lo).all(axis=1))
        sizes_ = sizes(self.inverse, value, self.spread(_with_zero(image)))
        position, angle = (np.where(proved, size, np.inf) for size in sizes_)
        box = IntervalArray(np.where(proved[:, None], image.lo, -np.inf), np.where(proved[:, None], image.hi, np.inf))
        return PoseBounds(proved, box, position, angle)

    def with_error(self, deviation: Intervals) -> Intervals:
        """With all errors e: the deviation less e (2 (L + l) + e) / (2 scale). Infinite for legs below eps."""
        eps = np.array([one.eps for one in self.sets])[None]
        length = self.length + self.box[None, :, 6]  # L + l
        most = eps * ((length + 0.5 * intervals(eps)) / self.scale)
        reach = np.where(length.lo <= eps, np.inf, most.hi)
        return deviation + IntervalArray(-reach, reach)

    def spread(self, box: Intervals) -> Intervals:
        """(I - C J(D)) D, (K, 6), for boxes D (K, 6) of (p, s) that hold 0, with the interval Jacobian J of F."""
        return applied(self._free[None] - self._product(intervals(box)), box)

    def _product(self, box: Intervals) -> Intervals:
        """C J (K, 6, 6) over D, all x of the sets and all poses of the cells.

        With r the mobile joint's place R b, w = P - a and u = w + r the leg, J is (u, 2 (m - s x m) / (1 + s.s)) over
        scale, m = r x u. Sums over legs are taken before the range over poses, so that what moves all legs alike
        cancels: with a shift t and a turn 2 S of the pose, from the cell's center on, and the weights C / scale,

            sum u = sum u_0 + (sum 1) t + 2 S x (sum r)
            sum m = sum m_0 + (sum r) x t + (T - tr T) 2 S          with T = sum r w'
        """
        reach = self.cells.reach
        shift = reach[:, :3] + box[:, :3]
        turn = _turns_joined(box[:, 3:], reach[:, 3:])
        weight = (intervals(self.inverse) / self.scale[:, None])[..., None]  # (K, 6, n, 1)
        nowhere = intervals(np.zeros(turn.shape))
        arm_0, leg_0 = self._at(nowhere, nowhere)
        arm, leg = self._at(turn, shift)
        arms = _sum(weight, arm)  # (K, 6, 3)
        outer = arm[..., :, None] * (leg - arm)[..., None, :]  # (K, n, 3, 3)
        of_turn = intervals(_sum(weight, outer.reshape((*outer.shape[:2], 9))).reshape((len(reach.lo), 6, 3, 3)))
        trace = of_turn[..., 0, 0] + of_turn[..., 1, 1] + of_turn[..., 2, 2]
        way = _path(turn)[:, None]
        units = total(weight[..., 0])
        of_legs = _sum(weight, leg_0) + units[..., None] * shift[:, None] + cross(way, arms)
        turned_by = applied(of_turn, way) - trace[..., None] * way
        moments = _sum(weight, cross(arm_0, leg_0)) + (cross(arms, shift[:, None]) + turned_by)
        return joined([of_legs, along_turn(box[:, None, 3:], moments)])

    def _at(self, turn: Intervals, shift: Intervals) -> tuple[Intervals, Intervals]:
        """R b and the leg P + R b - a, (K, n, 3) both, over all x of the sets; `turn` is S and `shift` t, (K, 3)."""
        matrix = turned_pose(turn, self.cells.center)
        arm = applied(matrix, (self.controller[:, 3:6] + self.box[:, 3:6])[None])
        place = (self.cells.center.position + shift)[:, None]
        plain = place - (self.controller[:, :3] + self.box[:, :3])[None] + arm
        return arm, intervals(plain.intersect(self._leg(matrix, place)))

    def _leg(self, matrix: Intervals, place: Intervals) -> Intervals:
        """The leg by the sets' directions: what shifts a and b alike hardly changes it."""
        known = place + applied(matrix, self.controller[None, :, 3:6]) - self.controller[None, :, :3]
        tau = self._directions
        by_each = applied(matrix[:, :, None], tau[..., 3:6]) - tau[..., :3]
        # the basis is orthonormal up to rounding: so much of the sets' size covers what that leaves
        stray = _STRAY * self.box.mag[None, :, :7].sum(axis=2, keepdims=True)
        return known + total(by_each * self.along[None, :, :, None], 2) + IntervalArray(-stray, stray)


def _sum(weight: Intervals, vectors: IntervalArray) -> Intervals:
    """Weighted sums over the legs: (K, 6, n, 1) and (K, n, m) give (K, 6, m)."""
    return total(weight * vectors[:, None], 2)


def _turns_joined(s: Intervals, t: Intervals) -> Intervals:
    """S with R(1, S) = R(1, s) R(1, t), a box around 0 of (K, 3); infinite where a half-turn is among them."""
    scalar = (1.0 - total(s * t))[:, None]
    found, far = (s + t + cross(s, t)) / scalar, scalar.lo <= 0.0
    return _with_zero(IntervalArray(np.where(far, -np.inf, found.lo), np.where(far, np.inf, found.hi)))


def _path(turn: Intervals) -> Intervals:
    """What the turns tau S, tau from 0 to 1, add up to: 2 S times a number between 1 / (1 + S.S) and 1."""
    least = (1.0 / (1.0 + intervals(squares(turn).hi))).lo
    return intervals(IntervalArray(2.0 * least, np.full_like(least, 2.0)))[:, None] * turn


def proved_image(
    spread: Callable[[Intervals], IntervalArray], step: Intervals, good: Bools
) -> tuple[IntervalArray, Bools]:
    """An image of D by the operator `step + spread(D)`, and whether it lies in the interior of D; D always holds 0."""
    box = _inflated(step)
    image: IntervalArray = step
    proved = np.zeros(len(good), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(_TRIES):
            image = step + spread(box)
            proved = good & ((image.lo > box.lo) & (image.hi < box.hi)).all(axis=1)
            if proved[good].all():
                break
            grown = _inflated(image)
            keep = proved[:, None] | ~np.isfinite(grown.lo) | ~np.isfinite(grown.hi)
            box = Intervals(np.where(keep, box.lo, grown.lo), np.where(keep, box.hi, grown.hi))
        for _ in range(_REFINED):
            image = image.intersect(step + spread(_with_zero(image)))
    return image, proved & np.isfinite(image.lo).all(axis=1)


def sizes(inverse: Floats, value: IntervalArray, spread: IntervalArray) -> tuple[Floats, Floats]:
    """Bounds (K,) of ||p|| in mm and of the angle in rad.

    (p, s) = -C F(0) + an element of `spread`, and a norm is largest at a corner of the box of F(0). The angle of
    R(1, s) is 2 atan ||s|| <= 2 ||s||.
    """
    legs = inverse.shape[-1]
    corners = (np.arange(1 << legs)[:, None] >> np.arange(legs) & 1).astype(bool)
    values = np.where(corners[None], value.hi[:, None], value.lo[:, None])  # (K, 2^n, n)
    moves = applied(intervals(inverse)[:, None], np.where(np.isfinite(values), values, 0.0))  # (K, 2^n, 6)
    more = intervals(spread.mag)
    position, turn = (
        intervals(norm(moves[..., part]).hi.max(axis=1)) + norm(more[:, part]).hi for part in (slice(3), slice(3, 6))
    )
    return position.hi, 2.0 * turn.hi


def _with_zero(box: IntervalArray) -> Intervals:
    return Intervals(np.minimum(box.lo, 0.0), np.maximum(box.hi, 0.0))


def _inflated(box: IntervalArray) -> Intervals:
    """Around zero and the box."""
    held = _with_zero(box)
    more = _INFLATE * (held.hi - held.lo) + 1e-9
    return Intervals(held.lo - more, held.hi + more)


# ------------------------------------------------------------------------------------------------------------------
# The workspace, and the worst that the certified sets allow anywhere in it: branch and bound on the worst cell.

AXES = ("x", "y", "z", "rx", "ry", "rz")
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
        known: dict[str, tuple[float, float]] = dict.fromkeys(AXES[3:], (0.0, 0.0))
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

    def sample(self, count: int) -> Pose:
        """`count` poses drawn from it, always the same."""
        return rotated(np.random.default_rng(1).uniform(self.lo, self.hi, (count, 6)))


def rotated(rows: Floats) -> Pose:
    """Poses P, R(1, S) of rows (P, 2 S)."""
    return Pose(rows[:, :3], normalised(small_rotation(rows[:, 3:])))


@dataclass(frozen=True, eq=False)
class Covered:
    """What the branch and bound leaves.

    boxes (K, 6) of (P, S), a cover of the workspace; `proved` (K,): those of which something is; `position` (K,) mm
    and `rotation` (K,) rad: no pose of the cell is off by more. `at` (6,): the pose
    whose own bound is the worst that was met, `at_position` mm. `complete`: the search ended by its gap.
    """

    boxes: IntervalArray
    proved: Bools
    position: Floats
    rotation: Floats
    at: Floats
    at_position: float
    complete: bool

    @property
    def worst(self) -> float:
        """mm: proved of all poses in the cells that are proved."""
        return float(self.position[self.proved].max(initial=0.0))


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
    search = Search(dividing.pieces(first_grid(workspace.box)), dividing, dividing.priority, abreast=_AT_ONCE)
    while True:
        if tell is not None:
            waits = 0.0 if search.lowest is None else max(-search.lowest, 0.0)
            tell(dividing.attained, max(waits, dividing.highest_kept))
        if not search.waiting or search.waiting + len(search.kept) >= most:
            break
        next(search)
    cells = [*search.kept, *(Piece(node.box, node.state) for node in search.pending)]
    return Covered(
        boxes=IntervalArray(np.stack([cell.box.lo for cell in cells]), np.stack([cell.box.hi for cell in cells])),
        proved=np.array([cell.state.proved for cell in cells]),
        position=np.array([cell.state.position for cell in cells]),
        rotation=np.array([cell.state.rotation for cell in cells]),
        at=dividing.at,
        at_position=dividing.attained,
        complete=not search.waiting,
    )


class _Cell(NamedTuple):
    """What is proved of a cell; `worth`: the bound that a division may lower, 0 where it is left out."""

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

    @staticmethod
    def priority(node: Node) -> float:
        return -float(node.state.worth)

    def pieces(self, boxes: IntervalArray) -> list[Piece]:
        """Cells (K, 6) with their bounds."""
        over, centers = cell_bounds(Cells.of_boxes(boxes), self._sets, self._held)
        met = np.where(centers.proved, centers.position, 0.0)
        if met.max() > self.attained:
            self.at, self.attained = boxes.mid[met.argmax()], float(met.max())
        small = ((boxes.hi - boxes.lo) / self._width).max(axis=1) <= _SMALLEST
        worth = np.where(~over.proved & small, 0.0, over.position)
        cells = map(_Cell, over.proved, over.position, over.rotation, worth)
        return list(map(Piece, Box.rows(AXES, boxes.lo, boxes.hi), cells))

    def __call__(self, node: Node) -> Decision:
        return self.all([node])[0]

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """Each is cut in two along its longest side, where that may lower the worst bound."""
        lo, hi = np.stack([node.box.lo for node in nodes]), np.stack([node.box.hi for node in nodes])
        worth = np.array([node.state.worth for node in nodes])
        cut = np.flatnonzero((worth > (1.0 + self._gap) * self.attained) & (hi > lo).any(axis=1))
        halves = self.pieces(_halves(IntervalArray(lo[cut], hi[cut]))) if cut.size else []
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


def _halves(boxes: IntervalArray) -> IntervalArray:
    worth = (boxes.hi - boxes.lo) * np.array([1.0, 1.0, 1.0, _ARM, _ARM, _ARM])
    axis, rows = np.argmax(worth, axis=1), np.arange(len(worth))
    middle = boxes.mid[rows, axis]
    first_hi, second_lo = boxes.hi.copy(), boxes.lo.copy()
    first_hi[rows, axis] = second_lo[rows, axis] = middle
    return IntervalArray(np.concatenate([boxes.lo, second_lo]), np.concatenate([first_hi, boxes.hi]))
