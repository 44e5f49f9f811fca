"""Proposed steps, proved by the checker's own rule before they count for a certificate.

A contractor proposes bounds with weights; they are shortened, and `Rule` says in exact arithmetic what they prove. The
search goes on from the boxes that were proved, so what is written is what the checker will see.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cpcal.checker import Refused
from cpcal.checker.problem import Box as ExactBox
from cpcal.checker.rule import Row, Rule, Weights
from cpcal.common.arrays import Bools, Floats
from cpcal.solver.certificate.float_rule import FloatRule, Parts, Product, Square
from cpcal.solver.certificate.readings import rows_of
from cpcal.solver.certificate.statement import Statement, free, number
from cpcal.solver.contract import Contraction, Step, StepWeights, shrunk
from cpcal.solver.interval import Box
from cpcal.solver.search import Proof

T = TypeVar("T")
_BITS = (10, 14, 18, 24, 32, 53)  # of the largest weight: the first that prove nearly as much as was proposed
_LOSS = 0.02  # of the width that was proposed, given away for shorter numbers
_ROUNDING = 0.5  # of that loss: more may not be due to rounding
_NEARLY = 0.9  # of a proved width: a proposed one below that was not proved


class WeightProver:
    """Proves what a contractor proposes on a box, as far as the rule goes. Steps without weights count for nothing."""

    def __init__(self, statement: Statement) -> None:
        self._statement = statement

    def __call__(self, box: Box, proposed: Contraction) -> Proof:
        table = _Table(self._statement, ExactBox(_fractions(box.lo), _fractions(box.hi)))
        o = self._statement.problem.objective
        cap = None if o is None else number(float(box.hi[o]))
        table.take(proposed.steps)
        lo, hi, bounds = box.lo.copy(), box.hi.copy(), []
        steps: list[Step] = []
        for step in proposed.steps:
            if step.weights is None:
                continue
            if step.variable is None:
                excluding = _within_limits(partial(_excluding, table, step.weights))
                if excluding is not None:
                    (weights,), rows = table.encoded([excluding])
                    exclude = {"exclude": 0, "cap": cap, "rows": rows, "weights": weights}
                    return Proof(Box.empty(box.names), (*steps, step), exclude, True)
                continue
            i = box.index(step.variable)
            found = _within_limits(partial(_bound, table, i, step, _LOSS * _width(proposed.box, i)))
            if found is None:
                continue
            proof, bound = found
            if (step.side == "lo" and bound > lo[i]) or (step.side == "hi" and bound < hi[i]):
                (lo if step.side == "lo" else hi)[i] = bound
                bounds.append((i, step.side, number(bound), proof))
                steps.append(step)
        left, record = box.with_bounds(lo, hi), None
        if bounds:
            texts, rows = table.encoded([proof for *_, proof in bounds])
            entries = [[*entry[:3], text] for entry, text in zip(bounds, texts, strict=True)]
            record = {"pass": 0, "cap": cap, "rows": rows, "bounds": entries}
        return Proof(left, tuple(steps), record, _complete(left, proposed.box))


class _Table:
    """The rows of one step, each with the reference reading that was chosen for it, and the rule on the box."""

    def __init__(self, statement: Statement, box: ExactBox) -> None:
        self._statement = statement
        self._rows: list[Row] = []
        self._places: dict[tuple[str, int], int] = {}
        self.rule = Rule(statement.problem, box, self._rows, free)
        self.fast = FloatRule(self.rule, statement.problem, self._rows)

    def take(self, steps: Sequence[Step]) -> None:
        """Choose the reading of every row that the steps speak of."""
        named = (entry[:3] for step in steps if step.weights is not None for entry in step.weights.rows)
        places = [place for row in dict.fromkeys(named) if (place := self._statement.place(*row)) is not None]
        new = [place for place in dict.fromkeys(places) if place not in self._places]
        self._places |= {place: n for n, place in enumerate(new, start=len(self._rows))}
        first = len(self._rows)
        self._rows += rows_of(self._statement.problem, self.rule.x, new)
        _within_limits(partial(self.fast.form, range(first, len(self._rows))))

    def _place(self, constraint: int, part: int, element: int) -> int | None:
        """The number in the table of a polynomial row of the network; None where the statement has no such row."""
        place = self._statement.place(constraint, part, element)
        return None if place is None else self._places[place]

    def proposed(self, weights: StepWeights) -> _Proposed:
        """Weights as a contractor gives them, of rows of the table."""
        placed = [self._place(*e[:3]) for e in weights.rows]
        products = [(i, j, int(p), int(q)) for i, j, p, q, _ in weights.products]
        squares = [(i, t) for i, t, _ in weights.tangents]
        values = (np.array([e[-1] for e in kind]) for kind in (weights.rows, weights.products, weights.tangents))
        known = [n is not None for n in placed]
        parts = self.fast.parts([n for n in placed if n is not None], products, squares)
        return _Proposed(placed, products, squares, tuple(values), parts, np.array(known, np.bool_))

    def encoded(self, proofs: Sequence[Weights]) -> tuple[list[dict[str, Any]], list[list[Any]]]:
        """The JSON of weights, and of the rows that they speak of."""
        used = sorted({n for weights in proofs for n, _ in weights.rows})
        places = {n: new for new, n in enumerate(used)}
        texts = [
            {
                "rows": [[places[n], w] for n, w in weights.rows],
                "products": weights.products,
                "tangents": [[i, number(t), w] for i, t, w in weights.tangents],
                "exponents": weights.exponents,
            }
            for weights in proofs
        ]
        return texts, [written(self._rows[n]) for n in used]


@dataclass(frozen=True)
class _Proposed:
    """Weights (of rows, of products, of squares) that a contractor proposes, and what they are put on.

    A row that the statement has not is None in `rows`, False in `known`, and missing in `parts`.
    """

    rows: list[int | None]
    products: list[Product]
    squares: list[Square]
    weights: tuple[Floats, ...]
    parts: Parts
    known: Bools

    def shortened(self, bits: int) -> Floats:
        """Weights of the parts, as whole numbers of so many bits at most times a power of two."""
        values, largest = self._placed
        return np.asarray(np.ldexp(np.rint(np.ldexp(values, bits - largest)), largest - bits))

    @cached_property
    def _placed(self) -> tuple[Floats, npt.NDArray[np.intc]]:
        """The weights of the parts, and the exponent of the largest of their kind."""
        kinds = [self.weights[0][self.known], *self.weights[1:]]
        largest = [_exponent(values) for values in self.weights]
        return np.concatenate(kinds), np.repeat(np.array(largest, np.intc), [values.size for values in kinds])

    def exact(self, bits: int) -> Weights:
        """The checker's form of them; those that vanish are left out. Raises Refused where it has none."""
        (rows, r), (products, p), (squares, t) = (whole(values, bits) for values in self.weights)
        if not (all(-1000 <= e < 1000 for e in (r, p, t)) and all(np.isfinite(v).all() for v in self.weights)):
            raise Refused("weights are too large or too small to be written", "limit")
        kinds = zip(self.rows, rows, strict=True), zip(self.products, products, strict=True)
        return Weights(
            tuple((n, int(w)) for n, w in kinds[0] if w and n is not None),
            tuple((*product, int(w)) for product, w in kinds[1] if w),
            tuple((i, F(touch), int(w)) for (i, touch), w in zip(self.squares, squares, strict=True) if w),
            (r, p, t),
        )


def written(row: Row) -> list[Any]:
    """The JSON of a row; signs that are all 0 are left out."""
    return [*row] if set(row[2]) & {"-", "+"} else [*row[:2]]


def _within_limits(tried: Callable[[], T]) -> T | None:
    """None where the checker would refuse, because a polynomial is too large for it."""
    try:
        return tried()
    except Refused:
        return None


def _excluding(table: _Table, given: StepWeights) -> Weights | None:
    proposed = table.proposed(given)
    for bits in _BITS:
        if table.fast.lowest(proposed.parts, proposed.shortened(bits))[0] > 0.0:
            return proposed.exact(bits)
    return next((weights for weights in map(proposed.exact, _BITS) if table.rule.excludes(weights)), None)


def _bound(table: _Table, i: int, step: Step, loss: float) -> tuple[Weights, float]:
    """The shortest weights, and the bound on unknown i that they prove, that lose little of what was proposed."""
    assert step.weights is not None
    proposed = table.proposed(step.weights)
    doubtful = []  # what float64 arithmetic gives away may be all that is missing
    for bits in _BITS:
        proved, rounding = table.fast.bound(i, step.side, proposed.parts, proposed.shortened(bits))
        if abs(proved - step.bound) <= loss:
            return proposed.exact(bits), brief(F(proved), step.side == "lo", loss)
        if not abs(proved - step.bound) > loss + rounding:
            doubtful.append(bits)
    if not rounding <= _ROUNDING * loss:
        weights, bound = _exact_bound(table, i, step, [proposed.exact(b) for b in doubtful or [bits]], loss)
        return weights, brief(bound, step.side == "lo", loss)
    return proposed.exact(bits), brief(F(proved), step.side == "lo", loss)


def _exact_bound(table: _Table, i: int, step: Step, tried: list[Weights], loss: float) -> tuple[Weights, F]:
    """The first of the weights that lose little of what was proposed, or the last, and what they prove."""
    for weights in tried:
        proved = table.rule.bound(i, step.side, weights)
        if abs(proved - F(step.bound)) <= F(loss):
            break
    return weights, proved


def _complete(proved: Box, proposed: Box) -> bool:
    """Whether what was proved is hardly wider than what was proposed."""
    if proposed.is_empty:
        return proved.is_empty
    return not shrunk(proved.width, proposed.width, _NEARLY)


def whole(values: Floats, bits: int) -> tuple[Floats, int]:
    """Whole numbers that are nearly proportional to nonnegative ones, and the power of two between them."""
    exponent = _exponent(values) - bits
    return np.rint(np.ldexp(values, -exponent)), exponent


def _exponent(values: Floats) -> int:
    return math.frexp(values.max(initial=0.0))[1]


def rounded(value: F, down: bool) -> float:
    """The nearest float64 that is not above (below) a fraction."""
    nearest = float(value)
    if down and F(nearest) > value:
        return math.nextafter(nearest, -math.inf)
    if not down and F(nearest) < value:
        return math.nextafter(nearest, math.inf)
    return nearest


def brief(value: F, down: bool, loss: float) -> float:
    """A float64 with few digits that is at most about `loss` below (above) a fraction."""
    if loss > 0.0:
        unit = F(2) ** (math.frexp(loss)[1] - 1)
        value = ((value / unit).__floor__() if down else (value / unit).__ceil__()) * unit
    return rounded(value, down)


def _width(box: Box, i: int) -> float:
    return 0.0 if box.is_empty else float(box.hi[i] - box.lo[i])


def _fractions(values: np.ndarray[Any, Any]) -> tuple[F, ...]:
    return tuple(F(float(v)) for v in values)


def line(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n"
