"""Which combinations of an image's equations are worth a row: found by linear programs, believed by nobody.

Each end of each unknown is the vertex of a program. What an image's errors can do to its six equations is a zonotope;
where a vertex lies outside of it, the plane between the two is a cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.box_contraction import ConstraintRows
from cpcal.handeye.frame_equations import FRAMES, R_F, R_X
from cpcal.handeye.frame_programs import FramePrograms
from cpcal.handeye.image_pose_sets import stated_rows
from cpcal.handeye.pose_links import Cut, Links
from cpcal.handeye.quadratic_rows import Quadratics
from cpcal.solver.linear import Dense, LinearStatus

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
