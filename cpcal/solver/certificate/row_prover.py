"""Contracts a box by rows of degree two, with a proof of every step: linear programs propose, the checker's rule
decides.

In the coordinates u of a box a row is linear but for products u_i u_j. A product is either a column of the programs,
tied to its factors by the bound products (McCormick, and tangents of a square), or it is bounded by its coefficient.
Programs without columns take a millisecond and do for narrow boxes; those with columns contract boxes of all rotations.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction as F
from operator import itemgetter, le
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cpcal.checker.polynomial import Spend
from cpcal.checker.rule import Box, Problem, Rule, Weights
from cpcal.common.files import replacing
from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.certificate.exact_network import free, number
from cpcal.solver.certificate.recording import brief, line, rounded, weights_text, whole
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus

Terms = dict[tuple[int, ...], int]
_MET = 1e-3  # a bound that some vertex meets to this (in [-1, 1]) needs no program
_WORTH = 0.02  # of a half-width: what a bound must gain to be kept, or twice the loss
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)
_BITS = (14, 24, 40)  # of the largest weight: the first that prove nearly as much as was proposed
_PAYS = 0.7  # median share of the widths that programs without columns must leave, or less
_NEGLIGIBLE = 0.003  # half-widths: programs that give away no more of products need no columns
_PASSES = 80
_ROUNDING = 2e-15  # of the sum of a row's terms


class TaggedRows(Protocol):
    """Rows by side and number, each at most zero at every solution: polynomials with whole coefficients."""

    @property
    def unknowns(self) -> tuple[str, ...]: ...
    @property
    def tags(self) -> Sequence[tuple[str, int]]: ...
    def row(self, side: str, k: int, /) -> Terms: ...
    def problem(self, spend: Spend, /) -> Problem: ...


class System:
    """Rows as arrays: constants (M,), linear (M, n) and products (M, P) of pairs (P, 2), in float64.

    `lifted` says which products may be columns; `asked`: the unknowns that are bounded; `derived`: those that are once,
    at the end, and that say nothing of the others. So many of what rows are of may be `wrong`, as `owner` says by side
    and number.
    """

    def __init__(
        self, rows: TaggedRows, lifted: Callable[[int, int], bool], asked: Sequence[int], derived: Sequence[int] = (),
        *, wrong: int = 0, owner: Callable[[str, int], int | None] = lambda side, k: None,
    ) -> None:  # fmt: skip
        self.problem, self.asked, self.derived, self.wrong = rows.problem(free), asked, derived, wrong
        self.tags: list[tuple[str, int]] = list(rows.tags)
        self.owner = [owner(*tag) for tag in self.tags]
        names = rows.unknowns
        place: dict[tuple[int, int], int] = {}
        self.constant = np.zeros(len(self.tags))
        self.linear = np.zeros((len(self.tags), len(names)))
        entries: list[tuple[int, int, float]] = []
        for n, tag in enumerate(self.tags):
            terms = rows.row(*tag)
            shift = max((c.bit_length() for c in terms.values()), default=0)
            for m, c in terms.items():
                cut = max(c.bit_length() - 64, 0)
                value = math.ldexp(c >> cut, cut - shift)
                if not m:
                    self.constant[n] = value
                elif len(m) == 1:
                    self.linear[n, m[0]] = value
                else:
                    i, j = sorted(m)
                    entries.append((n, place.setdefault((i, j), len(place)), value))
        self.pairs = np.array(list(place), dtype=np.intp).reshape(-1, 2)
        self.products = np.zeros((len(self.tags), len(place)))
        for n, p, value in entries:
            self.products[n, p] = value
        own = np.isin(self.pairs, list(derived)).any(axis=1)
        self.main: Bools = np.logical_not(self.linear[:, list(derived)].any(axis=1) | self.products[:, own].any(axis=1))
        self.lifted = np.array([lifted(int(i), int(j)) for i, j in self.pairs], dtype=np.bool_)
        self.square = self.pairs[:, 0] == self.pairs[:, 1]

    def centred(self, center: Floats, radius: Floats) -> tuple[Floats, Floats, Floats]:
        """Constants, linear and products in u, where x = center + radius u."""
        i, j = self.pairs.T
        constant = self.constant + self.linear @ center + self.products @ (center[i] * center[j])
        spread = np.zeros((len(self.pairs), len(center)))
        np.add.at(spread, (np.arange(len(i)), i), center[j])
        np.add.at(spread, (np.arange(len(i)), j), center[i])
        return constant, (self.linear + self.products @ spread) * radius, self.products * (radius[i] * radius[j])

    def rounding(self, center: Floats) -> Floats:
        """(M,) about what float64 may get wrong of the constants: all that matters of them in a tiny box."""
        i, j = self.pairs.T
        size = np.abs(self.constant) + np.abs(self.linear) @ np.abs(center)
        return np.asarray(_ROUNDING * (size + np.abs(self.products) @ np.abs(center[i] * center[j])))


class _Programs:
    """The linear programs of a system on one box."""

    def __init__(self, system: System, lo: Floats, hi: Floats, columns: Bools, rows: Bools) -> None:
        self.system, self.count = system, 0
        self.center, self.radius = 0.5 * (lo + hi), 0.5 * (hi - lo)
        constant, linear, products = system.centred(self.center, self.radius)
        constant = constant - system.rounding(self.center)
        products[~rows], linear[~rows] = 0.0, 0.0
        chosen = np.flatnonzero(columns & (np.abs(products).max(axis=0, initial=0.0) > 0.0))
        beside = np.where(system.square, np.maximum(-products, 0.0), np.abs(products))
        beside[:, chosen] = 0.0
        given_away = beside.sum(axis=1)
        matrix = np.concatenate([linear, products[:, chosen]], axis=1)
        rhs = given_away - constant
        scale = np.abs(matrix).max(axis=1)
        kept = np.flatnonzero((scale > 0.0) & (np.abs(matrix).sum(axis=1) > rhs))
        self._tags, self._scale = kept.tolist(), scale[kept]
        self.given_away = float((given_away[kept] / self._scale).max(initial=0.0))  # of products, at most, in u
        size = linear.shape[1]
        self._bounds, above, sides = _bound_products(chosen, system)
        lower = -np.ones(size + len(chosen))
        lower[size:][system.square[chosen]] = 0.0
        self._engine = Dense()
        self._engine.load(
            np.concatenate([above, matrix[kept] / self._scale[:, None]]),
            np.concatenate([sides, rhs[kept] / self._scale]),
            lower,
            np.ones(size + len(chosen)),
        )
        self._width = size + len(chosen)

    def minimize(self, i: int, sign: float) -> LinearSolution:
        objective = np.zeros(self._width)
        objective[i] = sign
        self.count += 1
        return self._engine.minimize(objective)

    def weights(self, solution: LinearSolution) -> _Proposed:
        rows: list[tuple[int, float]] = []
        products: list[tuple[int, int, int, int, float]] = []
        tangents: list[tuple[int, float, float]] = []
        for place, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
            if place >= len(self._bounds):
                place -= len(self._bounds)
                rows.append((self._tags[place], weight / float(self._scale[place])))
                continue
            i, j, p, q, t = self._bounds[place]
            if i == j:
                tangents.append((i, t, weight))
            else:
                products.append((i, j, p, q, weight))
        return _Proposed(rows, products, tangents)


def _bound_products(chosen: Indices, system: System) -> tuple[list[tuple[int, int, int, int, float]], Floats, Floats]:
    """Rows (K, columns) and right sides that tie the columns of the chosen products to their factors."""
    size, kinds = system.linear.shape[1], list[tuple[int, int, int, int, float]]()
    entries: list[tuple[int, float, int, float, int, float]] = []
    sides: list[float] = []
    for column, pair in enumerate(chosen.tolist(), start=size):
        i, j = system.pairs[pair].tolist()
        if i == j:
            kinds += [(i, i, 0, 0, t) for t in _TANGENTS]
            entries += [(i, 2.0 * t, i, 0.0, column, -1.0) for t in _TANGENTS]
            sides += [t * t for t in _TANGENTS]
            continue
        for p, q in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            kinds.append((i, j, p, q, 0.0))
            entries.append((i, -p, j, -q, column, -p * q))
            sides.append(1.0)
    matrix = np.zeros((len(entries), size + len(chosen)))
    for k, (i, a, j, b, column, c) in enumerate(entries):
        matrix[k, i] += a
        matrix[k, j] += b
        matrix[k, column] = c
    return kinds, matrix, np.array(sides)


@dataclass(frozen=True)
class _Proposed:
    """Weights of rows, by their places in the system, of products and of squares; the bound that they promise, in
    [-1, 1], infinite where they exclude the box."""

    rows: list[tuple[int, float]]
    products: list[tuple[int, int, int, int, float]]
    tangents: list[tuple[int, float, float]]
    value: float = 0.0

    def whole(self, bits: int) -> Weights:
        """As whole numbers of so many bits; rows by their places in the system."""
        (rows, r), (products, p), (tangents, t) = (
            _whole(list(kind), bits) for kind in (self.rows, self.products, self.tangents)
        )
        return Weights(tuple(rows), tuple(products), tuple((i, F(at), w) for i, at, w in tangents), (r, p, t))


def _whole(kind: list[tuple[Any, ...]], bits: int) -> tuple[list[tuple[Any, ...]], int]:
    """Entries whose last numbers are whole, without those that vanish, and the power of two that these are times."""
    values, exponent = whole(np.array([e[-1] for e in kind]), bits)
    return [(*e[:-1], int(w)) for e, w in zip(kind, values.tolist(), strict=True) if w], exponent


@dataclass
class Contracted:
    """What is left of a box, None for nothing, and the steps of the certificate that prove it.

    `last`: sides and numbers of the rows of the last step; `open`: whether time or patience ended the search.
    """

    left: Box | None
    steps: list[dict[str, Any]] = field(default_factory=list)
    programs: int = 0
    last: tuple[tuple[str, int], ...] = ()
    ended: str = ""


def write_steps(
    path: Path, header: Mapping[str, Any], left: Box | None, steps: Sequence[Mapping[str, Any]], cap: str | None = None
) -> None:
    """A certificate that claims the box that is left, or that nothing is, all or nothing. Raises InputError."""
    hull = None if left is None else {"lo": [number(v) for v in left.lo], "hi": [number(v) for v in left.hi]}
    claims = {"cap": cap, "infeasible": left is None, "epsilon": None, "enclosure": hull, "point": None}
    with replacing(path) as out:
        out.writelines(line(one).encode() for one in (header, claims, *steps))


def contracted(
    system: System,
    root: Box,
    *,
    narrow: Callable[[Floats], bool],
    gain: float,
    splits: Sequence[int] = (),
    most_boxes: int = 1,
    loss: float = 0.02,
    end: float = math.inf,
    tell: Callable[[Box | None], None] = lambda box: None,
) -> Contracted:
    """Contract until nothing is left or a pass gains less than a share `gain` of the widths, in their geometric mean;
    then halve the widest of the unknowns `splits`, in at most so many boxes.

    narrow   of half-widths: whether programs without columns are worth a try
    loss     share of what is left of a width, given away for shorter numbers
    """
    found = Contracted(None)
    open_, left, fresh = [(0, root)], list[Box](), 1
    while open_:
        name, box = open_.pop()
        descent = _Descent(system, name, box, narrow, gain, loss, end, found, tell)
        box_left = descent.result
        if box_left is None:
            continue
        if not splits or fresh + 1 > 2 * most_boxes - 2 or time.monotonic() > end:
            if system.derived and found.steps:
                descent.bound(system.derived)
            if descent.result is not None:
                left.append(descent.result)
            continue
        i = max(splits, key=lambda k: box_left.hi[k] - box_left.lo[k])
        cut = F(rounded((box_left.lo[i] + box_left.hi[i]) / 2, True))
        found.steps.append({"split": name, "unknown": i, "at": number(cut), "into": [fresh, fresh + 1]})
        open_ += [(fresh, box_left.replaced(i, hi=cut)), (fresh + 1, box_left.replaced(i, lo=cut))]
        fresh += 2
    if left:
        lo, hi = zip(*(box.lo for box in left), strict=True), zip(*(box.hi for box in left), strict=True)
        found.left = Box(tuple(map(min, lo)), tuple(map(max, hi)))
    return found


class _Descent:
    """Passes over one box."""

    def __init__(
        self, system: System, name: int, box: Box, narrow: Callable[[Floats], bool], gain: float, loss: float,
        end: float, found: Contracted, tell: Callable[[Box | None], None],
    ) -> None:  # fmt: skip
        self.system, self.name, self.found, self.narrow, self.loss = system, name, found, narrow, loss
        self.result: Box | None = box
        for _ in range(_PASSES):
            before = self.result
            if before is None:
                break
            if time.monotonic() > end:
                found.ended = "time"
                break
            self._best_pass(before)
            tell(self.result)
            if self.result is None:
                break
            if np.exp(np.log(_shares(before, self.result, system.asked) + 1e-9).mean()) > 1.0 - gain:
                break

    def _best_pass(self, box: Box) -> None:
        """Without columns of products where that is worth a try, and with them where it gained too little."""
        if self.narrow(np.array([float(b - a) / 2 for a, b in zip(box.lo, box.hi, strict=True)])):
            given_away = self._pass(box, np.zeros_like(self.system.lifted), self.system.asked)
            if self.result is None or given_away < _NEGLIGIBLE:
                return
            if np.median(_shares(box, self.result, self.system.asked)) <= _PAYS:
                return
        assert self.result is not None
        self._pass(self.result, self.system.lifted, self.system.asked)

    def bound(self, unknowns: Sequence[int]) -> None:
        """These, on what is left."""
        assert self.result is not None
        self._pass(self.result, self.system.lifted, unknowns)

    def _pass(self, box: Box, columns: Bools, asked: Sequence[int]) -> float:
        """Two programs for each unknown that is asked for; what is proved of them is a step.

        What the programs gave away of products, at most, in half-widths.
        """
        system = self.system
        lo, hi = (np.array([float(v) for v in side]) for side in (box.lo, box.hi))
        rows = np.ones_like(system.main) if asked is system.derived else system.main
        known: dict[frozenset[int], _Programs] = {}

        def programs(without: frozenset[int]) -> _Programs:
            if without not in known:
                right = np.array([owner not in without for owner in system.owner], dtype=np.bool_)
                known[without] = _Programs(system, lo, hi, columns, rows & right)
            return known[without]

        every, prover = programs(frozenset()), _Prover(system, box)
        lowest, highest = np.full(len(lo), np.inf), np.full(len(lo), -np.inf)

        def family(i: int, sign: float, without: frozenset[int], wrong: int) -> list[_Proposed] | None:
            """What proves a bound whichever are wrong: no such few have weights in all of it. None: it is of no use."""
            own = programs(without)
            solution = own.minimize(i, sign)
            if solution.status is LinearStatus.INFEASIBLE:
                value = math.inf
            elif solution.status is LinearStatus.OPTIMAL:
                u = solution.point[: len(lo)]
                np.minimum(lowest, u, out=lowest)
                np.maximum(highest, u, out=highest)
                value = sign * float(u[i])
            worth = min(_WORTH, 2.0 * self.loss)
            if solution.status not in (LinearStatus.OPTIMAL, LinearStatus.INFEASIBLE) or value < worth - 1.0:
                return None
            found = [replace(own.weights(solution), value=value)]
            owners = {system.owner[n] for n, _ in found[0].rows} if wrong else set()
            for owner in sorted(k for k in owners if k is not None):
                more = family(i, sign, without | {owner}, wrong - 1)
                if more is None:
                    return None
                found += more
            return found

        proposed: list[tuple[int, str, list[_Proposed]]] = []
        ends = {(i, sign): -1.0 for i in asked for sign in (1.0, -1.0)}
        for i, sign in ends:
            met = lowest[i] < -1.0 + _MET if sign > 0.0 else highest[i] > 1.0 - _MET
            one = None if every.radius[i] == 0.0 or met else family(i, sign, frozenset(), system.wrong)
            if one is None:
                continue
            ends[i, sign] = min(part.value for part in one)
            if ends[i, sign] < math.inf:
                proposed.append((i, "lo" if sign > 0.0 else "hi", one))
            elif prover.exclude(one):
                break
            else:
                ends[i, sign] = -1.0
        else:
            for i, side, one in proposed:
                width = -ends[i, 1.0] - ends[i, -1.0]
                prover.bound(i, side, one, self.loss * max(width, 1e-9) * float(every.radius[i]))
        self.found.programs += sum(one.count for one in known.values())
        step = prover.step(self.name)
        if step is not None:
            self.found.steps.append(step)
            self.found.last = prover.tags
            self.result = prover.left
        return every.given_away


class _Prover:
    """Exact bounds on one box; `left` is what they leave, None for nothing."""

    def __init__(self, system: System, box: Box) -> None:
        self._system, self._lo, self._hi = system, list(box.lo), list(box.hi)
        self._rule = Rule(system.problem, box, [(*tag, "") for tag in system.tags], free)
        self._bounds: list[tuple[int, str, F, list[Weights]]] = []
        self._excluding: list[Weights] = []

    @property
    def left(self) -> Box | None:
        if self._excluding or not all(map(le, self._lo, self._hi)):
            return None
        return Box(tuple(self._lo), tuple(self._hi))

    def exclude(self, family: Sequence[_Proposed]) -> bool:
        """Whether the box is proved to hold nothing."""
        found = [self._excludes(one) for one in family]
        self._excluding = [] if None in found else [weights for weights in found if weights is not None]
        return bool(self._excluding)

    def _excludes(self, proposed: _Proposed) -> Weights | None:
        return next((weights for weights in map(proposed.whole, _BITS) if self._rule.excludes(weights)), None)

    def bound(self, i: int, side: str, family: Sequence[_Proposed], loss: float) -> None:
        """Keep the weakest bound of a family, if it is proved to be better than what there is."""
        center, radius = float(self._rule.x.center(i)), float(self._rule.x.radius(i))
        proved, sets = list[F](), list[Weights]()
        for one in family:
            if one.value == math.inf:  # what excludes proves any bound
                excluding = self._excludes(one)
                if excluding is None:
                    return
                sets.append(excluding)
                continue
            value, best = center + radius * (one.value if side == "lo" else -one.value), list[tuple[F, Weights]]()
            for weights in map(one.whole, _BITS):
                best.append((self._rule.bound(i, side, weights), weights))
                if abs(float(best[-1][0]) - value) <= loss:
                    break
            bound, weights = (max if side == "lo" else min)(best, key=itemgetter(0))
            proved.append(bound)
            sets.append(weights)
        weakest = min(proved) if side == "lo" else max(proved)
        kept, ends = F(brief(weakest, side == "lo", loss)), self._lo if side == "lo" else self._hi
        if kept > ends[i] if side == "lo" else kept < ends[i]:
            self._bounds.append((i, side, kept, sets))
            ends[i] = kept

    @property
    def tags(self) -> tuple[tuple[str, int], ...]:
        return tuple(self._system.tags[n] for n in sorted({n for weights in self._proofs for n, _ in weights.rows}))

    @property
    def _proofs(self) -> list[Weights]:
        return self._excluding or [weights for *_, sets in self._bounds for weights in sets]

    def step(self, name: int) -> dict[str, Any] | None:
        """As a certificate holds it; None where nothing is proved."""
        used, texts = weights_text(self._proofs)
        given = iter(texts)

        def text(sets: list[Weights]) -> Any:
            found = [next(given) for _ in sets]
            return found if self._system.wrong else found[0]

        rows = [[*self._system.tags[n]] for n in used]
        if self._excluding:
            return {"exclude": name, "cap": None, "rows": rows, "weights": text(self._excluding)}
        if not self._bounds:
            return None
        bounds = [[i, side, number(value), text(sets)] for i, side, value, sets in self._bounds]
        return {"pass": name, "cap": None, "rows": rows, "bounds": bounds}


def _shares(before: Box, after: Box, asked: Sequence[int]) -> Floats:
    """What is left of the widths."""
    found = [
        float((after.hi[i] - after.lo[i]) / (before.hi[i] - before.lo[i])) for i in asked if before.hi[i] > before.lo[i]
    ]
    return np.array(found or [1.0])
