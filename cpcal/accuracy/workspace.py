"""The workspace, and the worst that the certified sets allow anywhere in it: branch and bound on the worst cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.accuracy.certified_set import CertifiedSet
from cpcal.accuracy.pose_bounds import Cells, PoseBounds, cell_bounds
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.interval import IntervalArray

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
            raise InputError([Problem("workspace", what, "give LO:HI with LO <= HI for each axis")])

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
                raise InputError(
                    [Problem("workspace", what, "write x=-50:50,y=-50:50,z=430:480, and rx, ry, rz in deg")]
                )
            known[name] = pair if name in AXES[:3] else (float(np.radians(pair[0])), float(np.radians(pair[1])))
        missing = [name for name in AXES if name not in known]
        if missing:
            raise InputError([Problem("workspace", f"lacks {', '.join(missing)}", "give x, y and z in mm")])
        return cls(tuple(known[n][0] for n in AXES), tuple(known[n][1] for n in AXES))

    @property
    def box(self) -> IntervalArray:
        """(6,) of (P, S), outward."""
        lo, hi = np.array(self.lo), np.array(self.hi)
        half = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
        return IntervalArray(lo * half, hi * half)  # halves of floats are exact


@dataclass(frozen=True, eq=False)
class Covered:
    """What the branch and bound leaves.

    boxes (K, 6) of (P, S), a cover of the workspace; `proved` (K,): those of which something is; `position` (K,) mm
    and `rotation` (K,) rad: no pose of the cell is off by more; `share` (K, n) as in PoseBounds. `at` (6,): the pose
    whose own bound is the worst that was met, `at_position` mm. `complete`: the search ended by its gap.
    """

    boxes: IntervalArray
    proved: Bools
    position: Floats
    rotation: Floats
    share: Floats
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
    gap: float = 0.2,
    most: int = 600,
    tell: Callable[[float, float], None] | None = None,
) -> Covered:
    """Cells are divided where the bound is worst, until it is within `gap` of what a pose attains, or `most` cells.

    Cells of which nothing can be proved are divided first; at a 64th of the workspace's width they are left out.
    `tell` is called with the bracket of the worst bound, mm.
    """
    whole = workspace.box
    open_ = _State.of(_grid(whole), sets)
    complete = False
    while True:
        left_out = ~open_.proved & (_size(open_.boxes, whole) <= _SMALLEST)
        rank = np.where(left_out, -np.inf, open_.position)
        highest = float(rank.max(initial=0.0))
        if tell is not None:
            tell(open_.at_position, highest)
        if highest <= (1.0 + gap) * open_.at_position:
            complete = True
            break
        if len(rank) >= most:
            break
        worst = np.argsort(-rank, kind="stable")[:_AT_ONCE]
        worst = worst[rank[worst] > (1.0 + gap) * open_.at_position]
        divisible = [k for k in worst.tolist() if (open_.boxes.hi[k] > open_.boxes.lo[k]).any()]
        if not divisible:
            break
        open_ = open_.divided(np.array(divisible, dtype=np.intp), sets)
    return Covered(
        boxes=open_.boxes,
        proved=open_.proved,
        position=open_.position,
        rotation=open_.rotation,
        share=open_.share,
        at=open_.at,
        at_position=open_.at_position,
        complete=complete,
    )


@dataclass(frozen=True, eq=False)
class _State:
    boxes: IntervalArray
    proved: Bools
    position: Floats
    rotation: Floats
    share: Floats
    at: Floats
    at_position: float

    @classmethod
    def of(cls, boxes: IntervalArray, sets: Sequence[CertifiedSet]) -> _State:
        found, centers = cell_bounds(Cells.of_boxes(boxes), sets)
        at, value = _worst_center(boxes, centers)
        return cls(boxes, found.proved, found.position, found.rotation, found.share, at, value)

    def divided(self, rows: Indices, sets: Sequence[CertifiedSet]) -> _State:
        """With the cells of these rows cut in two, each along its longest side."""
        new = _State.of(_halves(self.boxes[rows]), sets)
        keep = np.setdiff1d(np.arange(len(self.proved)), rows)
        better = new if new.at_position > self.at_position else self
        return _State(
            IntervalArray(
                np.concatenate([self.boxes.lo[keep], new.boxes.lo]), np.concatenate([self.boxes.hi[keep], new.boxes.hi])
            ),
            np.concatenate([self.proved[keep], new.proved]),
            np.concatenate([self.position[keep], new.position]),
            np.concatenate([self.rotation[keep], new.rotation]),
            np.concatenate([self.share[keep], new.share]),
            better.at,
            better.at_position,
        )


def _worst_center(boxes: IntervalArray, centers: PoseBounds) -> tuple[Floats, float]:
    value = np.where(centers.proved, centers.position, 0.0)
    k = int(np.argmax(value))
    return boxes.mid[k], float(value[k])


def _grid(whole: IntervalArray) -> IntervalArray:
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


def _size(boxes: IntervalArray, whole: IntervalArray) -> Floats:
    """Of the longest side, as a share of the workspace's."""
    width = np.where(whole.hi > whole.lo, whole.hi - whole.lo, np.inf)
    return np.asarray(np.max((boxes.hi - boxes.lo) / width, axis=1))
