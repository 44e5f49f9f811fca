"""Arrays of polynomials in the network's variables, with coefficients that depend on the readings.

A monomial is the sorted tuple of the flat indices of its factors: () is 1, (0, 0, 3) is x0^2 x3. All
elements of an array share their monomials, which is what makes N measurements cheap.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.interval.operations import CODES
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.expression import Expr, topological
from cpcal.solver.network.network import ConstraintNetwork

Monomial = tuple[int, ...]
Monomials = tuple[Monomial, ...]
Polynomial = tuple[Monomials, IntervalArray]  # with coefficients (1 + J, T, *B)


def constant_term(c: IntervalArray, monomials: Monomials) -> IntervalArray:
    """The coefficient of 1, which is zero where it is not listed."""
    return c[:, monomials.index(())] if () in monomials else IntervalArray.point(np.zeros((1, *c.shape[2:])))


def _aligned(c: IntervalArray, rank: int) -> IntervalArray:
    """Coefficients of an array of `rank`."""
    missing = rank + 2 - c.ndim
    return c if missing == 0 else c.reshape((*c.shape[:2], *(1,) * missing, *c.shape[2:]))


@lru_cache(maxsize=256)
def _union(x: Monomials, y: Monomials) -> tuple[Monomials, Indices, Indices]:
    """All monomials, and for each its place among those of x and of y, -1 where it has none."""
    of_x, of_y = ({m: k for k, m in enumerate(own)} for own in (x, y))
    both = tuple(of_x | of_y)
    places = [np.array([own.get(m, -1) for m in both], np.intp) for own in (of_x, of_y)]
    return both, places[0], places[1]


@lru_cache(maxsize=256)
def _products(x: Monomials, y: Monomials, square: bool) -> tuple[Monomials, Indices]:
    """The monomials of a product, and (P, 3) which terms multiply to which; of a square both orders are one."""
    place: dict[Monomial, int] = {}
    table = []
    for i, p in enumerate(x):
        for j in range(i if square else 0, len(y)):
            m = tuple(sorted(p + y[j]))
            table.append((i, j, place.setdefault(m, len(place))))
    return tuple(place), np.array(table, np.intp).reshape(len(table), 3)


_MOST_PRODUCTS = 50_000  # of terms in one multiplication, about half a second
MOST_PAIRS = 50_000  # of monomials and divisors: what it takes to write a network on a box in the box's coordinates


class NotPolynomial(Exception):
    """The expression has no polynomial form that this pass knows."""


@dataclass(frozen=True)
class PolynomialArray:
    """Elements of shape `shape`: the sum of `monomials` (T of them) times `coefficients` (1 + J, T, *B).

    B broadcasts to the shape; the first axis is that of `coefficient`.
    """

    shape: tuple[int, ...]
    monomials: tuple[Monomial, ...]
    coefficients: IntervalArray
    reads: bool = False  # whether readings with a measurement axis occur

    @property
    def is_constant(self) -> bool:
        return all(m == () for m in self.monomials)

    @property
    def constant(self) -> IntervalArray:
        """The coefficient of 1."""
        return constant_term(self.coefficients, self.monomials)


class Expander:
    """Expands expressions of one network over all of their reading sets; every node once.

    `again` repeats that over parts of the sets. What is not expanded at `deadline` (of time.monotonic()), or would have
    very many terms, counts as not polynomial.
    """

    def __init__(
        self,
        network: ConstraintNetwork,
        engine: Arithmetic,
        roots: tuple[Expr, ...],
        deadline: float = math.inf,
    ) -> None:
        self._engine, self._deadline = engine, deadline
        self._start: dict[bytes, int] = {}
        start = 0
        for leaf in network.variables:
            self._start[leaf.digest] = start
            start += math.prod(leaf.shape)
        self._leaves = {node.digest: node for node in topological(roots) if node.op == "reading"}
        self._whole = self._allotted({})
        self._done: dict[bytes, PolynomialArray | NotPolynomial] = {}
        self._keep: dict[bytes, Bools] = {}  # of a node's monomials, those that do not vanish for all readings
        self._orders: dict[bytes, list[Expr]] = {}

    def expand(self, root: Expr) -> PolynomialArray:
        """The polynomial form of `root`. Raises NotPolynomial."""
        for node in topological((root,)) if root.digest not in self._done else ():
            if node.digest not in self._done:
                try:
                    args = [self._found(arg) for arg in node.args]
                    _check_rows(node, args)
                    if node.op in ("mul", "sqr", "power") and time.monotonic() > self._deadline:
                        raise NotPolynomial("the time limit came first")
                    self._done[node.digest] = self._node(node, args, self._whole)
                except NotPolynomial as reason:
                    self._done[node.digest] = reason
        return self._found(root)

    def again(self, roots: Sequence[Expr], sets: Mapping[bytes, IntervalArray]) -> list[PolynomialArray]:
        """The forms of some `roots`, which `expand` has found, for readings in other `sets`, parts of theirs.

        A coefficient that is zero for all readings of the whole sets is zero for these: monomials stay away.
        """
        readings, known = self._allotted(sets), dict[bytes, PolynomialArray]()
        for root in roots:
            for node in self._reading_nodes(root):
                if node.digest not in known:
                    args = [known.get(arg.digest) or self._found(arg) for arg in node.args]
                    known[node.digest] = self._node(node, args, readings)
        return [known.get(root.digest) or self._found(root) for root in roots]

    def _reading_nodes(self, root: Expr) -> list[Expr]:
        """The nodes under a root that depend on readings, arguments first."""
        if root.digest not in self._orders:
            self._orders[root.digest] = [node for node in topological((root,)) if "reading" in node.ops]
        return self._orders[root.digest]

    def _found(self, node: Expr) -> PolynomialArray:
        found = self._done[node.digest]
        if isinstance(found, NotPolynomial):
            raise found
        return found

    def _node(
        self, node: Expr, args: list[PolynomialArray], readings: Mapping[bytes, IntervalArray]
    ) -> PolynomialArray:
        if node.op == "variable":
            count, start = math.prod(node.shape), self._start[node.digest]
            unit = IntervalArray.point(np.eye(count).reshape((1, count, *node.shape)))
            return PolynomialArray(node.shape, tuple((start + k,) for k in range(count)), unit)
        if node.op == "constant":
            assert isinstance(node.data, IntervalArray)
            return PolynomialArray(node.shape, ((),), _owned(node.data)[None, None])
        if node.op == "reading":
            return PolynomialArray(node.shape, ((),), readings[node.digest], reads=bool(node.shape))
        monomials, coefficients = self._operation(node, args)
        if node.digest not in self._keep:
            constant = np.array([m == () for m in monomials], np.bool_)
            self._keep[node.digest] = coef.occurring_terms(coefficients) | constant
        keep = self._keep[node.digest]
        if not keep.all():
            monomials = tuple(m for m, kept in zip(monomials, keep.tolist(), strict=True) if kept)
            coefficients = coefficients[:, keep]
        return PolynomialArray(node.shape, monomials, coefficients, any(arg.reads for arg in args))

    def _allotted(self, sets: Mapping[bytes, IntervalArray]) -> dict[bytes, IntervalArray]:
        """Every reading's coefficients: one `delta_j` for each component whose set has a width in some row."""
        parts: list[tuple[Expr, Floats, Floats, Indices, int]] = []
        count = 1
        for node in self._leaves.values():
            values = sets.get(node.digest, node.data)
            assert isinstance(values, IntervalArray)
            mid, rows = values.mid, node.shape[0] if node.shape else 1
            radius = np.maximum(values.hi - mid, mid - values.lo).reshape(rows, -1)
            moving = np.flatnonzero(radius.any(axis=0))
            parts.append((node, mid, radius, moving, count))
            count += len(moving)
        out = dict[bytes, IntervalArray]()
        for node, mid, radius, moving, first in parts:
            slopes = np.zeros((count if len(moving) else 1, *node.shape))
            slopes[0] = mid
            flat = slopes.reshape(len(slopes), *radius.shape)
            for k, j in enumerate(moving.tolist()):
                column = radius[:, j]
                flat[first + k, :, j] = np.where(column == 0.0, 0.0, np.nextafter(column, np.inf))
            out[node.digest] = IntervalArray(slopes[:, None], slopes[:, None])
        return out

    def _operation(self, node: Expr, args: list[PolynomialArray]) -> Polynomial:
        e, x, op = self._engine, args[0], node.op
        if op == "neg":
            return x.monomials, e.neg(x.coefficients)
        if op in ("index", "sum"):
            full = x.coefficients.broadcast_to((*x.coefficients.shape[:2], *x.shape))
            if op == "sum":
                return x.monomials, coef.total_over(e, full, node.parameter + 1)
            return x.monomials, full.reshape((*full.shape[:2], -1))[:, :, node.data]
        one, *other = [(arg.monomials, _aligned(arg.coefficients, node.ndim)) for arg in args]
        if op in ("add", "sub"):
            monomials, of_x, of_y = _union(one[0], other[0][0])
            return monomials, coef.combined_terms(e, one[1], other[0][1], of_x, of_y, 1.0 if op == "add" else -1.0)
        if op == "mul":
            return self._product(one, other[0])
        if op == "sqr":
            return self._product(one, one, square=True)
        if op == "power" and node.parameter >= 0:
            out: Polynomial = ((),), IntervalArray.point(np.ones((1, 1) + (1,) * node.ndim))
            for _ in range(node.parameter):
                out = self._product(out, one)
            return out
        if op == "div" and args[1].is_constant:
            return self._product(one, (((),), _aligned(coef.reciprocal(e, args[1].constant)[:, None], node.ndim)))
        if all(arg.is_constant for arg in args):  # any operation, over all readings in their sets
            known = [coef.total(e, arg.constant) for arg in args]
            own = [v.reshape(v.shape[1:]).broadcast_to(node.shape) for v in known]
            return ((),), e.apply(CODES[op], own[0], own[-1], node.parameter)[None, None]
        raise NotPolynomial(f"{op!r} of an expression with variables")

    def _product(self, x: Polynomial, y: Polynomial, square: bool = False) -> Polynomial:
        if len(x[0]) * len(y[0]) > _MOST_PRODUCTS:
            raise NotPolynomial(f"a product of {len(x[0]) * len(y[0])} terms")
        monomials, table = _products(x[0], y[0], square)
        return monomials, coef.term_products(self._engine, x[1], y[1], table, len(monomials), square)


def _owned(data: IntervalArray) -> IntervalArray:
    """A copy that may be written: kernels are compiled for such arrays."""
    lo = data.lo.copy()
    return IntervalArray(lo, lo if data.hi is data.lo else data.hi.copy())


def pairs(monomials: Iterable[Monomial]) -> int:
    """How many pairs of two there are such that one divides the other, and it one of these."""
    return sum(math.prod((k + 1) * (k + 2) // 2 for k in Counter(m).values()) for m in monomials)


def _check_rows(node: Expr, args: list[PolynomialArray]) -> None:
    """Readings must keep their measurement axis: element k may only depend on the readings of row k."""
    for arg in args:
        if not arg.reads:
            continue
        same_front = bool(node.shape) and node.shape[0] == arg.shape[0]
        if node.op == "sum":
            same_front = node.parameter > 0
        elif node.op == "index" and isinstance(node.data, np.ndarray) and same_front:
            width = int(np.prod(arg.shape[1:]))
            rows = node.data.reshape((node.shape[0], -1)) // width
            same_front = bool((rows == np.arange(node.shape[0])[:, None]).all())
        elif node.ndim != len(arg.shape):
            same_front = False
        if not same_front:
            raise NotPolynomial(f"{node.op!r} mixes the measurements of a reading")
