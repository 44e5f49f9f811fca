"""Steps of a certificate: what contractors and linear programs propose on a box, proved by the checker's own rule.

Weights are proposed in float64. They are shortened, and `Rule` says in exact arithmetic what they prove. A search goes
on from the boxes that were proved, so what is written is what the checker will see.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from fractions import Fraction as F
from functools import partial
from operator import itemgetter, le
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cpcal.checker import Refused
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import ModelRows, Row, Rule, Weights
from cpcal.common.files import replacing
from cpcal.common.values import Bools, Floats, floats
from cpcal.solver.certificate.exact_network import Statement, exact_box, free, limits, number
from cpcal.solver.certificate.float_rows import FloatRule, Parts, Product, Square, rows_of
from cpcal.solver.contract import Contraction, Step, StepWeights
from cpcal.solver.interval import Box
from cpcal.solver.interval.numbers import round_down, round_up
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus
from cpcal.solver.search.passes import Proof

T = TypeVar("T")
Claims = dict[str, Any]  # line of a certificate


def line(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n"


def claims(
    cap: float | None,
    *,
    refuted: bool = False,
    lo: float | None = None,
    hi: float | None = None,
    enclosure: Box | ExactBox | None = None,
    point: Sequence[float] | Floats | None = None,
    holds: str | Sequence[int] = "all",
    factor: float | None = None,
    fails: Sequence[int] = (),
) -> Claims:
    """What a certificate says of all points with an objective up to `cap`: that there is no solution, where they lie,
    the bracket of the objective, and a point, with the measurements that it satisfies and those that it fails: for some
    reading, or with a `factor` for all readings of sets with so many times the stated half-widths."""
    scale, at = None if factor is None else number(factor), None if point is None else [number(v) for v in point]
    bracket = None if lo is None else {"lo": number(lo), "hi": None if hi is None else number(hi)}
    return {
        "cap": None if cap is None else number(cap),
        "infeasible": refuted,
        "epsilon": bracket,
        "enclosure": None if enclosure is None else limits(enclosure),
        "point": None if at is None else {"at": at, "holds": holds, "factor": scale, "fails": list(fails)},
    }


def written(row: Row) -> list[Any]:
    """The JSON of a row; signs that are all 0 are left out."""
    return [*row] if set(row[2]) & {"-", "+"} else [*row[:2]]


@dataclass(frozen=True)
class Proposed:
    """Weights of rows (by their numbers in a table), of products and of squares, in float64.

    value  the bound that they promise, in [-1, 1]; infinite where they exclude the box
    """

    rows: Sequence[int]
    products: Sequence[Product]
    squares: Sequence[Square]
    weights: tuple[Floats, Floats, Floats]
    value: float = 0.0

    def shortened(self, bits: Sequence[int]) -> Floats:
        """All of them, of so many bits at most: a row for each number."""
        largest = [math.frexp(values.max(initial=0.0))[1] for values in self.weights]
        behind = np.subtract.outer(bits, np.repeat(largest, [values.size for values in self.weights]))
        return np.asarray(np.ldexp(np.rint(np.ldexp(np.concatenate(self.weights), behind)), -behind))

    def exact(self, bits: int) -> Weights:
        """The checker's form of them; those that vanish are left out. Raises Refused where it has none."""
        if not np.isfinite(np.concatenate(self.weights)).all():
            raise Refused("weights are too large to be written", "limit")
        (rows, r), (products, p), (squares, t) = (_whole(values, bits) for values in self.weights)
        if not -1000 <= min(r, p, t) <= max(r, p, t) < 1000:
            raise Refused("weights are too large or too small to be written", "limit")
        return Weights(
            tuple([(n, w) for n, w in zip(self.rows, rows, strict=True) if w]),
            tuple([(*product, w) for product, w in zip(self.products, products, strict=True) if w]),
            tuple([(i, F(touch), w) for (i, touch), w in zip(self.squares, squares, strict=True) if w]),
            (r, p, t),
        )


def _whole(values: Floats, bits: int) -> tuple[list[int], int]:
    """Whole numbers that are nearly proportional to nonnegative ones, and the power of two between them."""
    exponent = math.frexp(values.max(initial=0.0))[1] - bits
    return list(map(int, np.rint(np.ldexp(values, -exponent)).tolist())), exponent


def _excluding(rule: Rule, proposed: Proposed, bits: Sequence[int]) -> Weights | None:
    """The shortest that prove that nothing is in the box."""
    return next((weights for weights in map(proposed.exact, bits) if rule.excludes(weights)), None)


def brief(value: F | float, down: bool, loss: float) -> float:
    """A float64 with few digits that is at most about `loss` below (above) a number."""
    if loss > 0.0:
        unit, whole = math.ldexp(1.0, math.frexp(loss)[1] - 1), math.floor if down else math.ceil
        if isinstance(value, F):
            value = whole(value / F(unit)) * F(unit)
        elif abs(value) < 2.0**53 * unit:  # else it is a multiple; a quotient by a power of two is exact
            value = whole(value / unit) * unit
    return round_down(value) if down else round_up(value)


Bound = tuple[int, str, float | F, Sequence[Weights]]  # unknown, side, what is proved, and by what


def _record(
    table: Sequence[Row], name: int, cap: str | None, excluding: Sequence[Weights], bounds: Sequence[Bound],
    *, families: bool = False,
) -> dict[str, Any] | None:  # fmt: skip
    """The step of a certificate; None where nothing is proved. Its rows are counted anew.

    `families`: several sets of weights for each claim.
    """
    proofs = [*excluding, *(weights for *_, sets in bounds for weights in sets)]
    used = sorted({n for weights in proofs for n, _ in weights.rows})
    places = {n: new for new, n in enumerate(used)}

    def said(sets: Sequence[Weights]) -> Any:
        texts = [
            {
                "rows": [[places[n], w] for n, w in weights.rows],
                "products": weights.products,
                "tangents": [[i, number(t), w] for i, t, w in weights.tangents],
                "exponents": weights.exponents,
            }
            for weights in sets
        ]
        return texts if families else texts[0]

    rows = [written(table[n]) for n in used]
    if excluding:
        return {"exclude": name, "cap": cap, "rows": rows, "weights": said(excluding)}
    entries = [[i, side, number(value), said(sets)] for i, side, value, sets in bounds]
    return {"pass": name, "cap": cap, "rows": rows, "bounds": entries} if bounds else None


# ------------------------------------------------------------------------------------------------------------------
# Steps that contractors propose.

_BITS = (10, 14, 18, 24, 32, 53)  # of the largest weight: the first that prove nearly as much as was proposed
_LOSS = 0.02  # of the width that was proposed, given away for shorter numbers
_ROUNDING = 0.5  # of that loss: more may not be due to rounding


class WeightProver:
    """Proves what a contractor proposes on a box, as far as the rule goes. Steps without weights count for nothing."""

    def __init__(self, statement: Statement, loss: float = _LOSS) -> None:
        self._statement, self._loss = statement, loss

    def __call__(self, box: Box, proposed: Contraction) -> Proof:
        o = self._statement.problem.objective
        cap = None if o is None else number(float(box.hi[o]))
        width = np.zeros(len(box)) if proposed.box.is_empty else proposed.box.hi - proposed.box.lo
        table = _Table(self._statement, exact_box(box), proposed.steps)
        lo, hi = box.lo.copy(), box.hi.copy()
        bounds, steps = list[Bound](), list[Step]()
        for step in proposed.steps:
            if step.weights is None:
                continue
            if step.variable is None:
                excluding = _within_limits(partial(table.excluding, step.weights))
                if excluding is not None:
                    record = _record(table.rows, 0, cap, [excluding], ())
                    return Proof(Box.empty(box.names), (*steps, step), record)
                continue
            i, ends = box.index(step.variable), lo if step.side == "lo" else hi
            found = _within_limits(partial(table.bound, i, step, step.weights, self._loss * width[i]))
            if found is not None and (found[1] > ends[i] if step.side == "lo" else found[1] < ends[i]):
                ends[i] = found[1]
                bounds.append((i, step.side, found[1], found[:1]))
                steps.append(step)
        return Proof(box.with_bounds(lo, hi), tuple(steps), _record(table.rows, 0, cap, (), bounds))


class _Table:
    """The rows of one step, each with the reference reading that was chosen for it, and the rule on the box."""

    def __init__(self, statement: Statement, box: ExactBox, steps: Sequence[Step]) -> None:
        self._statement = statement
        given = [step.weights.rows for step in steps if step.weights is not None]
        places = list(dict.fromkeys(statement.place(*entry[:3]) for rows in given for entry in rows))
        self._numbers = {place: n for n, place in enumerate(places)}
        self.rows: list[Row] = []
        self._rule = Rule(statement.problem, box, self.rows, free)
        self.rows += rows_of(statement.problem, self._rule.x, places)
        self._fast = FloatRule(self._rule, statement.problem, self.rows)
        _within_limits(partial(self._fast.form, range(len(places))))

    def _proposed(self, given: StepWeights) -> tuple[Proposed, Parts]:
        rows = [self._numbers[self._statement.place(*e[:3])] for e in given.rows]
        products = [(i, j, int(p), int(q)) for i, j, p, q, _ in given.products]
        squares = [(i, t) for i, t, _ in given.tangents]
        of_rows, of_products, of_squares = (
            floats([e[-1] for e in kind]) for kind in (given.rows, given.products, given.tangents)
        )
        proposed = Proposed(rows, products, squares, (of_rows, of_products, of_squares))
        return proposed, self._fast.parts(rows, products, squares)

    def excluding(self, given: StepWeights) -> Weights | None:
        proposed, parts = self._proposed(given)
        lowest, _ = self._fast.lowest(parts, proposed.shortened(_BITS))
        for bits, least in zip(_BITS, lowest.tolist(), strict=True):
            if least > 0.0:
                return proposed.exact(bits)
        return _excluding(self._rule, proposed, _BITS)

    def bound(self, i: int, step: Step, given: StepWeights, loss: float) -> tuple[Weights, float]:
        """The shortest weights, and the bound on unknown i that they prove, that lose little of what was proposed."""
        (proposed, parts), down = self._proposed(given), step.side == "lo"
        doubtful = []  # what float64 arithmetic gives away may be all that is missing
        tried = self._fast.bounds(i, step.side, parts, proposed.shortened(_BITS))
        for bits, proved, rounding in zip(_BITS, *(part.tolist() for part in tried), strict=True):
            if abs(proved - step.bound) <= loss:
                return proposed.exact(bits), brief(proved, down, loss)
            if not abs(proved - step.bound) > loss + rounding:
                doubtful.append(bits)
        if rounding <= _ROUNDING * loss:
            return proposed.exact(bits), brief(proved, down, loss)
        for weights in [proposed.exact(b) for b in doubtful or [bits]]:
            exactly = self._rule.bound(i, step.side, weights)
            if abs(exactly - F(step.bound)) <= F(loss):
                break
        return weights, brief(exactly, down, loss)


def _within_limits(tried: Callable[[], T]) -> T | None:
    """None where the checker would refuse, because a polynomial is too large for it."""
    try:
        return tried()
    except Refused:
        return None


# ------------------------------------------------------------------------------------------------------------------
# Steps by rows of degree two: linear programs of our own propose.
#
# In the coordinates u of a box a row is linear but for products u_i u_j. A product is either a column of the programs,
# tied to its factors by the bound products (McCormick, and tangents of a square), or it is bounded by its coefficient.
# Programs with columns for the products that count take a tenth of the time and do for most boxes (narrow ones need
# none); those with all columns contract boxes of all rotations.

_WORTH = 0.02  # of a half-width: what a bound must gain to be kept, or twice the loss
_CORNERS = [(p, q) for p in (1.0, -1.0) for q in (1.0, -1.0)]
_TANGENTS = [(p, p) for p in (1.0, 2.0, -2.0, -1.0)]  # (1 + p u)^2, the square of the distance from -1 / p
_FEW_BITS = (14, 24, 40)
_COARSELY = 0.02  # share of a row's largest coefficient: products below it are given away at first
_PAYS = 0.7  # median share of the widths that programs with few columns must leave, or less
_NEGLIGIBLE = 0.003  # half-widths: programs that give away no more of products need no more columns
_PASSES = 80
_NARROW = 0.125  # of an entry: above it the `first` rows alone, whose passes take a tenth of the time
_WIDE = 1.0  # of an entry of a rotation: columns of all products gain little in the next box where they did in this one
_VAIN = 5  # halvings in a row after which passes gain little: the next one would hardly help; twice so many of `first`
_NOTHING = 1e-99  # coefficients below it are none
_NOISE = 2e-15  # of rounding, as a share of the sum of a row's terms


class System:
    """Rows as arrays: constants (M,), linear (M, n) and products (M, P) of pairs (P, 2), in float64.

    rows     by side and number, each at most zero at every solution: polynomials with whole coefficients
    lifted   which products may be columns
    groups   of the unknowns that are bounded: with all columns each in what the one before left; `derived`: those that
             are once, at the end, and say nothing of the others
    turns    the unknowns that are entries of rotations
    without  unknowns whose rows are left out
    wrong    so many of what rows are of may be wrong, as `owner` says by side and number
    """

    def __init__(
        self, rows: ModelRows, lifted: Callable[[int, int], bool], groups: Sequence[Sequence[int]],
        turns: Sequence[int], derived: Sequence[int] = (), without: Sequence[int] = (), *,
        wrong: int = 0, owner: Callable[[str, int], int | None] = lambda side, k: None,
    ) -> None:  # fmt: skip
        self.problem, self.groups, self.turns, self.derived = rows.problem(free), groups, list(turns), derived
        self.asked = [i for group in groups for i in group]
        every, left_out = {tag: rows.row(*tag) for tag in rows.tags}, set(without)
        table = {tag: terms for tag, terms in every.items() if not any(map(left_out.intersection, terms))}
        self.tags, self.wrong, size = list(table), wrong, rows.size
        self.owner = [owner(*tag) for tag in self.tags]
        products = sorted({m for terms in table.values() for m in terms if len(m) > 1})
        place = {m: k for k, m in enumerate([(), *((i,) for i in range(size)), *products])}
        values = np.zeros((len(table), len(place)))
        for row, terms in zip(values, table.values(), strict=True):
            unit = 1 << max((c.bit_length() for c in terms.values()), default=0)
            row[[place[m] for m in terms]] = [c / unit for c in terms.values()]
        self.constant, self.linear, self.products = values[:, 0], values[:, 1 : size + 1], values[:, size + 1 :]
        self.pairs = np.array(products, np.intp).reshape(-1, 2)
        own = set(derived)
        self.main = np.array([not any(map(own.intersection, terms)) for terms in table.values()], np.bool_)
        self.lifted = np.array([lifted(*pair) for pair in products], np.bool_)
        self.square = self.pairs[:, 0] == self.pairs[:, 1]

    def centred(self, center: Floats, radius: Floats) -> tuple[Floats, Floats, Floats]:
        """Constants, linear and products in u, where x = center + radius u; constants less about what float64 may get
        wrong of them, which is all that matters in a tiny box."""
        i, j = self.pairs.T
        each = np.eye(len(center))
        spread = each[i] * center[j, None] + each[j] * center[i, None]
        both = center[i] * center[j]
        constant = self.constant + self.linear @ center + self.products @ both
        size = np.abs(self.constant) + np.abs(self.linear) @ np.abs(center) + np.abs(self.products) @ np.abs(both)
        linear = (self.linear + self.products @ spread) * radius
        return constant - _NOISE * size, linear, self.products * (radius[i] * radius[j])


class _Programs:
    """The linear programs of a system on one box, with some of its rows, and columns for some products."""

    def __init__(self, system: System, center: Floats, radius: Floats, share: float, rows: Bools) -> None:
        constant, linear, products = system.centred(center, radius)
        products[~rows], linear[~rows] = 0.0, 0.0
        size = np.abs(products)
        least = share * np.abs(np.concatenate([linear, products], axis=1)).max(axis=1, keepdims=True)
        chosen = np.flatnonzero(system.lifted & (size > least).any(axis=0))
        beside = np.where(system.square, np.maximum(-products, 0.0), size)
        beside[:, chosen] = 0.0
        given_away = beside.sum(axis=1)
        matrix, rhs = np.concatenate([linear, products[:, chosen]], axis=1), given_away - constant
        scale = np.abs(matrix).max(axis=1)
        kept = np.flatnonzero((scale > _NOTHING) & (np.abs(matrix).sum(axis=1) > rhs))
        self._numbers, self._scale = kept.tolist(), scale[kept]
        self.given_away = float((given_away[kept] / self._scale).max(initial=0.0))  # of products, at most, in u
        first, self.width = len(center), matrix.shape[1]
        # (1 + p u_i) (1 + q u_j) >= 0 ties the column of a product to its factors
        pairs = enumerate(system.pairs[chosen].tolist(), start=first)
        bounds = [(k, i, j, *pq) for k, (i, j) in pairs for pq in (_TANGENTS if i == j else _CORNERS)]
        above = np.zeros((len(bounds), self.width))
        for row, (k, i, j, p, q) in zip(above, bounds, strict=True):
            row[i] -= p
            row[j] -= q
            row[k] = -p * q
        self._bounds = bounds
        lower = -np.ones(self.width)
        lower[first:][system.square[chosen]] = 0.0
        matrix = np.concatenate([above, matrix[kept] / self._scale[:, None]])
        rhs = np.concatenate([np.ones(len(bounds)), rhs[kept] / self._scale])
        self.engine = {side: Dense(matrix, rhs, lower, np.ones(self.width)) for side in ("lo", "hi")}

    def weights(self, solution: LinearSolution, value: float) -> Proposed:
        first, multipliers = len(self._bounds), solution.multipliers
        of_row = solution.rows >= first
        kept = solution.rows[of_row] - first
        used = [
            (*self._bounds[k][1:], w)
            for k, w in zip(solution.rows[~of_row].tolist(), multipliers[~of_row].tolist(), strict=True)
        ]
        products, squares = ([one for one in used if (one[0] == one[1]) is square] for square in (False, True))
        return Proposed(
            [self._numbers[k] for k in kept.tolist()],
            [(i, j, int(p), int(q)) for i, j, p, q, _ in products],
            [(i, -1.0 / p) for i, _, p, *_ in squares],
            (
                multipliers[of_row] / self._scale[kept],
                np.array([w for *_, w in products]),
                np.array([p * q * w for *_, p, q, w in squares]),
            ),
            value,
        )


@dataclass
class Contracted:
    """What is left of a box, None for nothing, and the steps of the certificate that prove it; `timed`: time ended the
    search."""

    left: ExactBox | None = None
    steps: list[dict[str, Any]] = field(default_factory=list)
    programs: int = 0
    timed: bool = False


def write_steps(
    path: Path, header: Mapping[str, Any], left: ExactBox | None, steps: Sequence[Mapping[str, Any]],
    cap: float | None = None,
) -> None:  # fmt: skip
    """A certificate that claims the box that is left, or that nothing is, all or nothing. Raises InputError."""
    said = claims(cap, refuted=left is None, enclosure=left)
    with replacing(path) as out:
        out.writelines(line(one).encode() for one in (header, said, *steps))


@dataclass
class Descent:
    """Contracts until nothing is left or a pass gains less than a share `gain` of the widths, in their geometric mean;
    then halves the widest entry of a rotation where it is wider than `coarse`, in at most so many `boxes`. With a
    `coarse` of 0 it seeks to prove that nothing is left, and ends where a box stays.

    first  a few of the rows: these alone in a box where one of its turns is wider than `_NARROW`
    loss   share of what is left of a width, given away for shorter numbers
    """

    system: System
    gain: float
    boxes: int = 1
    coarse: float = 0.0
    loss: float = 0.02
    end: float = math.inf
    tell: Callable[[ExactBox | None], None] = lambda box: None
    first: System | None = None
    found: Contracted = field(init=False, default_factory=Contracted)

    def over(self, root: ExactBox) -> Contracted:
        """What is left of a box."""
        system, steps = self.system, self.found.steps
        waiting, fresh = [(0, root, 0)], 1
        while waiting:
            name, whole, vain = waiting.pop()
            box = self._passes(name, whole, vain)
            if box is None:
                continue
            vain = vain + 1 if self._gained_little(whole, box) else 0
            own = self._of(box)
            i, width = _widest(own, box)
            enough = vain > 2 * _VAIN if own is self.first else vain > _VAIN or width < self.coarse
            if enough or self._inside(box) or fresh >= 2 * self.boxes - 2 or time.monotonic() > self.end:
                for share in (0.0, _COARSELY) if system.derived and steps else ():  # one side's programs may fail
                    box = None if box is None else self._once_over(system, name, box, share, system.derived)[0]
                if box is not None:
                    left = self.found.left or box
                    self.found.left = ExactBox(tuple(map(min, left.lo, box.lo)), tuple(map(max, left.hi, box.hi)))
                    if not self.coarse:
                        break
                continue
            cut = F(round_down((box.lo[i] + box.hi[i]) / 2))
            steps.append({"split": name, "unknown": i, "at": number(cut), "into": [fresh, fresh + 1]})
            waiting += [(fresh, box.replaced(i, hi=cut), vain), (fresh + 1, box.replaced(i, lo=cut), vain)]
            fresh += 2
        return self.found

    def _inside(self, box: ExactBox) -> bool:
        """Whether what is asked of a box is known of it: the hull of what is left holds it."""
        left = self.found.left
        return left is not None and all(left.lo[i] <= box.lo[i] <= box.hi[i] <= left.hi[i] for i in self.system.asked)

    def _gained_little(self, before: ExactBox, after: ExactBox) -> bool:
        shares = _shares(before, after, self._of(before).asked)
        return self._inside(after) or bool(np.exp(np.log(shares + 1e-9).mean()) > 1.0 - self.gain)

    def _of(self, box: ExactBox) -> System:
        """The rows that count in a box."""
        first = self.first
        return self.system if first is None or _widest(first, box)[1] < _NARROW else first

    def _passes(self, name: int, box: ExactBox, vain: int) -> ExactBox | None:
        """What passes leave of a box, until one gains too little; `vain`: of the boxes before it, so many did."""
        for _ in range(_PASSES):
            if time.monotonic() > self.end:
                self.found.timed = True
                break
            left = self._best(name, box, vain)
            self.tell(left)
            if left is None or (self._gained_little(box, left) and self._of(box) is self._of(left)):
                return left
            box = left
        return box

    def _best(self, name: int, box: ExactBox, vain: int) -> ExactBox | None:
        """With columns of a few products, and of all where that gained too little; but in a wide box only where the one
        before it gained from that."""
        system = self._of(box)
        left, given_away = self._once_over(system, name, box, _COARSELY, system.asked)
        if left is None or given_away < _NEGLIGIBLE or np.median(_shares(box, left, system.asked)) <= _PAYS:
            return left
        if vain and _widest(system, left)[1] > _WIDE:
            return left
        for group in system.groups:
            left = None if left is None else self._once_over(system, name, left, 0.0, group)[0]
        return left

    def _once_over(
        self, system: System, name: int, box: ExactBox, share: float, asked: Sequence[int]
    ) -> tuple[ExactBox | None, float]:
        """Two programs for each unknown that is asked for; what is proved of them is a step.

        And what the programs gave away of products, at most, in half-widths.
        """
        step = _Pass(system, box, share, asked is system.derived)
        left = step.left(asked, self.loss)
        self.found.programs += step.programs
        record = _record(step.rows, name, None, step.exclusion, step.bounds, families=system.wrong > 0)
        self.found.steps += [] if record is None else [record]
        return left, step.of_all.given_away


class _Pass:
    """Bounds on one box, proposed by programs and proved by the rule.

    A bound has a family of proofs: one without anybody's rows, and where some may be wrong others without those of
    every one that the first rests on, so that some proof holds whichever are wrong.
    """

    def __init__(self, system: System, box: ExactBox, share: float, every: bool) -> None:
        self._system, self._box, self._share = system, box, share
        lo, hi = np.array(box.lo, np.float64), np.array(box.hi, np.float64)
        self._center, self._radius = 0.5 * (lo + hi), 0.5 * (hi - lo)
        self._main = system.main | every
        self.rows: list[Row] = [(*tag, "") for tag in system.tags]
        self._rule = Rule(system.problem, box, self.rows, free)
        self.programs, self.of_all = 0, self._without(frozenset())
        self.bounds, self.exclusion = list[Bound](), list[Weights]()

    def left(self, asked: Sequence[int], loss: float) -> ExactBox | None:
        """What is left of the box, None for nothing; bounds that gain little, or twice the `loss`, are left out.

        Both sides have programs of their own, which two threads solve: what they propose depends on no other.
        """
        proposed, ends = [], dict.fromkeys(asked, -2.0)  # less what is proposed
        with ThreadPoolExecutor(2) as threads:
            of_sides = list(threads.map(partial(self._families, asked, min(_WORTH, 2.0 * loss)), ("lo", "hi")))
        for side, (families, programs) in zip(("lo", "hi"), of_sides, strict=True):
            self.programs += programs
            for i, family in families:
                value = min(part.value for part in family)
                if value < math.inf:
                    ends[i] += value + 1.0
                    proposed.append((i, side, family))
                elif (excluding := self._proved(i, side, family, 0.0)) is not None:
                    self.exclusion = [weights for _, weights in excluding]
                    return None
        lo, hi = list(self._box.lo), list(self._box.hi)
        for i, side, family in proposed:
            given_away = loss * max(-ends[i], 1e-9) * float(self._radius[i])
            found = self._proved(i, side, family, given_away)
            if found is None:
                continue
            weakest = (min if side == "lo" else max)(bound for bound, _ in found if bound is not None)
            kept, own = F(brief(weakest, side == "lo", given_away)), lo if side == "lo" else hi
            if kept > own[i] if side == "lo" else kept < own[i]:
                self.bounds.append((i, side, kept, [weights for _, weights in found]))
                own[i] = kept
        return ExactBox(tuple(lo), tuple(hi)) if all(map(le, lo, hi)) else None

    def _without(self, wrong: frozenset[int]) -> _Programs:
        """Programs without the rows of some."""
        rows = self._main & [owner not in wrong for owner in self._system.owner]
        return _Programs(self._system, self._center, self._radius, self._share, rows)

    def _families(self, asked: Sequence[int], worth: float, side: str) -> tuple[list[tuple[int, list[Proposed]]], int]:
        """What proves bounds on a side whichever are wrong, up to an exclusion, and the number of programs."""
        system, sign, count = self._system, 1.0 if side == "lo" else -1.0, 0
        known = {frozenset[int](): self.of_all}

        def family(i: int, solution: LinearSolution, without: frozenset[int], wrong: int) -> list[Proposed] | None:
            """Such that no few that may be wrong have weights in all of it. None: it is of no use."""
            nonlocal count
            count += 1
            value = math.inf
            if solution.status is LinearStatus.OPTIMAL:
                value = sign * float(solution.point[i])
            elif solution.status is not LinearStatus.INFEASIBLE:
                return None
            if value < worth - 1.0:
                return None
            found = [known[without].weights(solution, value)]
            owners = {system.owner[n] for n in found[0].rows} if wrong else set()
            for more in (without | {owner} for owner in sorted(k for k in owners if k is not None)):
                others = known[more] = known.get(more) or self._without(more)
                part = family(i, others.engine[side].minimize(sign * (np.arange(others.width) == i)), more, wrong - 1)
                if part is None:
                    return None
                found += part
            return found

        of_all, out = self.of_all, []
        wide = np.array([i for i in asked if self._radius[i] != 0.0], np.intp)
        for k, solution in of_all.engine[side].each(sign * (np.arange(of_all.width) == wide[:, None]), wide):
            i = int(wide[k])
            if (found := family(i, solution, frozenset(), system.wrong)) is not None:
                out.append((i, found))
                if min(part.value for part in found) == math.inf:
                    break
        return out, count

    def _proved(
        self, i: int, side: str, family: Sequence[Proposed], loss: float
    ) -> list[tuple[F | None, Weights]] | None:
        """What each of a family proves at least, and by what: None for an exclusion, which proves any bound; and None
        where one proves nothing."""
        center, radius = float(self._center[i]), float(self._radius[i])
        out: list[tuple[F | None, Weights]] = []
        for one in family:
            if one.value == math.inf:
                excluding = _excluding(self._rule, one, _FEW_BITS)
                if excluding is None:
                    return None
                out.append((None, excluding))
                continue
            value = center + radius * (one.value if side == "lo" else -one.value)
            found = []
            for weights in map(one.exact, _FEW_BITS):
                found.append((self._rule.bound(i, side, weights), weights))
                if abs(float(found[-1][0]) - value) <= loss:
                    break
            out.append((max if side == "lo" else min)(found, key=itemgetter(0)))
        return out


def _widest(system: System, box: ExactBox) -> tuple[int, F]:
    """The entry of a rotation that is known least, and how wide it is."""
    return max(((k, box.hi[k] - box.lo[k]) for k in system.turns), key=itemgetter(1))


def _shares(before: ExactBox, after: ExactBox, asked: Sequence[int]) -> Floats:
    """What is left of the widths."""
    found = [
        float((after.hi[i] - after.lo[i]) / (before.hi[i] - before.lo[i])) for i in asked if before.hi[i] > before.lo[i]
    ]
    return np.array(found or [1.0])
