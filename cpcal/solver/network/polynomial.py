"""Arrays of polynomials in the network's variables, with coefficients that depend on the readings.

A monomial is the sorted tuple of the flat indices of its factors: () is 1, (0, 0, 3) is x0^2 x3. All
elements of an array share their monomials, which is what makes N measurements cheap.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cpcal.common.arrays import Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.dag import topological
from cpcal.solver.network.engines import elementwise
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.network import ConstraintNetwork

Monomial = tuple[int, ...]
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
        if () in self.monomials:
            return self.coefficients[:, self.monomials.index(())]
        return IntervalArray.point(np.zeros((1,) + (1,) * len(self.shape)))


Found = PolynomialArray | NotPolynomial
Terms = tuple[tuple[Monomial, ...], IntervalArray]


class Expander:
    """Expands expressions of one network; every node once.

    `fixed` keeps what depends on no reading: one for all expanders of a network, whatever their `sets`. What is not
    expanded at `deadline` (of time.monotonic()), or would have very many terms, counts as not polynomial.
    """

    def __init__(
        self,
        network: ConstraintNetwork,
        engine: Arithmetic,
        roots: tuple[Expr, ...],
        sets: dict[bytes, IntervalArray] | None = None,
        fixed: dict[bytes, Found] | None = None,
        deadline: float = math.inf,
    ) -> None:
        self._engine, self._deadline = engine, deadline
        self._fixed: dict[bytes, Found] = {} if fixed is None else fixed
        self._start: dict[bytes, int] = {}
        start = 0
        for leaf in network.variables:
            self._start[leaf.digest] = start
            start += int(np.prod(leaf.shape))
        self._readings: dict[bytes, PolynomialArray] = {}
        self._allot([node for node in topological(roots) if node.op == "reading"], sets or {})
        self._done: dict[bytes, Found] = {}  # what depends on readings

    def expand(self, root: Expr) -> PolynomialArray:
        """The polynomial form of `root`. Raises NotPolynomial."""
        for node in topological((root,)):
            if node.digest not in self._done and node.digest not in self._fixed:
                reads = node.op == "reading" or any(arg.digest in self._done for arg in node.args)
                known = self._done if reads else self._fixed
                try:
                    known[node.digest] = self._node(node)
                except NotPolynomial as reason:
                    known[node.digest] = reason
        found = self._of(root)
        if isinstance(found, NotPolynomial):
            raise found
        return found

    def _of(self, node: Expr) -> Found:
        return self._done[node.digest] if node.digest in self._done else self._fixed[node.digest]

    def _node(self, node: Expr) -> PolynomialArray:
        if node.op == "variable":
            return self._variable(node)
        if node.op == "constant":
            assert isinstance(node.data, IntervalArray)
            return _cleared(node.shape, ((),), _owned(node.data)[None, None])
        if node.op == "reading":
            return self._readings[node.digest]
        args = []
        for arg in node.args:
            found = self._of(arg)
            if isinstance(found, NotPolynomial):
                raise found
            args.append(found)
        _check_rows(node, args)
        monomials, coefficients = self._operation(node, args)
        return _cleared(node.shape, monomials, coefficients, any(arg.reads for arg in args))

    def _variable(self, node: Expr) -> PolynomialArray:
        count, start = int(np.prod(node.shape)), self._start[node.digest]
        unit = np.eye(count).reshape((1, count, *node.shape))
        return PolynomialArray(node.shape, tuple((start + k,) for k in range(count)), IntervalArray.point(unit))

    def _allot(self, readings: list[Expr], sets: dict[bytes, IntervalArray]) -> None:
        """One scaled reading `delta_j` per component of a reading whose set has a width in some row."""
        columns: list[tuple[Expr, int, IntervalArray]] = []
        for node in readings:
            values = sets.get(node.digest, node.data)
            assert isinstance(values, IntervalArray)
            flat = values.reshape((node.shape[0], -1) if node.shape else (1, 1))
            for j in np.flatnonzero((flat.rad > 0.0).any(axis=0)):
                columns.append((node, int(j), flat))
        for node in readings:
            values = sets.get(node.digest, node.data)
            assert isinstance(values, IntervalArray)
            slopes = np.zeros((1 + len(columns), *node.shape))
            slopes[0] = values.mid
            rows = slopes.reshape((1 + len(columns), *((node.shape[0], -1) if node.shape else (1, 1))))
            for k, (owner, component, flat) in enumerate(columns, start=1):
                if owner is node:
                    rows[k, :, component] = flat.rad[:, component]
            used = 1 + len(columns) if any(owner is node for owner, _, _ in columns) else 1
            own = IntervalArray.point(slopes[:used, None])
            self._readings[node.digest] = PolynomialArray(node.shape, ((),), own, reads=bool(node.shape))

    def _operation(self, node: Expr, args: list[PolynomialArray]) -> Terms:
        e, x = self._engine, args[0]
        if node.op in ("neg", "index", "sum"):
            return x.monomials, self._structural(node, x)
        if node.op in ("add", "sub"):
            return polynomial_sum(e, node.ndim, x, args[1], 1.0 if node.op == "add" else -1.0)
        if node.op == "mul":
            return self._product(node.ndim, x, args[1])
        if node.op == "sqr":
            self._check_size(len(x.monomials) ** 2)
            return polynomial_product(e, node.ndim, x, x, square=True)
        if node.op == "power" and node.parameter >= 0:
            return self._power(node, x)
        if node.op == "div" and args[1].is_constant:
            divisor = coef.reciprocal(e, args[1].constant)
            shape = (divisor.shape[0], 1, *divisor.shape[1:])
            return self._product(node.ndim, x, PolynomialArray(args[1].shape, ((),), divisor.reshape(shape)))
        if all(arg.is_constant for arg in args):
            values = tuple(coef.total(e, arg.constant) for arg in args)
            return ((),), elementwise(e, node, values)[None]
        raise NotPolynomial(f"{node.op!r} of an expression with variables")

    def _structural(self, node: Expr, arg: PolynomialArray) -> IntervalArray:
        c = arg.coefficients
        if node.op == "neg":
            return self._engine.neg(c)
        full = c.broadcast_to((*c.shape[:2], *arg.shape))
        if node.op == "sum":
            return coef.total_over(self._engine, full, node.parameter + 1)
        assert isinstance(node.data, np.ndarray)
        return full.reshape((*full.shape[:2], -1))[:, :, node.data]

    def _product(self, rank: int, x: PolynomialArray, y: PolynomialArray) -> Terms:
        self._check_size(len(x.monomials) * len(y.monomials))
        return polynomial_product(self._engine, rank, x, y)

    def _power(self, node: Expr, x: PolynomialArray) -> Terms:
        out = PolynomialArray(node.shape, ((),), IntervalArray.point(np.ones((1, 1) + (1,) * node.ndim)))
        for _ in range(node.parameter):
            out = PolynomialArray(node.shape, *self._product(node.ndim, out, x))
        return out.monomials, out.coefficients

    def _check_size(self, products: int) -> None:
        if products > _MOST_PRODUCTS:
            raise NotPolynomial(f"a product of {products} terms")
        if time.monotonic() > self._deadline:
            raise NotPolynomial("the time limit came first")


def _owned(data: IntervalArray) -> IntervalArray:
    """A copy that may be written: kernels are compiled for such arrays."""
    lo = data.lo.copy()
    return IntervalArray(lo, lo if data.hi is data.lo else data.hi.copy())


def _cleared(
    shape: tuple[int, ...], monomials: tuple[Monomial, ...], coefficients: IntervalArray, reads: bool = False
) -> PolynomialArray:
    """Without the monomials whose coefficients are all zero, but for the constant."""
    keep = coef.occurring_terms(coefficients)
    if not keep.all():
        keep |= np.array([m == () for m in monomials], np.bool_)
        monomials = tuple(m for m, kept in zip(monomials, keep.tolist(), strict=True) if kept)
        coefficients = coefficients[:, keep]
    return PolynomialArray(shape, monomials, coefficients, reads)


def polynomial_sum(e: Arithmetic, rank: int, x: PolynomialArray, y: PolynomialArray, sign: float) -> Terms:
    """x + sign y, for arrays of a common rank."""
    monomials, of_x, of_y = _union(x.monomials, y.monomials)
    return monomials, coef.combined_terms(e, _aligned(x, rank), _aligned(y, rank), of_x, of_y, sign)


def polynomial_product(
    e: Arithmetic, rank: int, x: PolynomialArray, y: PolynomialArray, *, square: bool = False
) -> Terms:
    """x y, for arrays of a common rank; `square`: they are one."""
    monomials, table = _products(x.monomials, y.monomials, square)
    return monomials, coef.term_products(e, _aligned(x, rank), _aligned(y, rank), table, len(monomials), square)


def _aligned(x: PolynomialArray, rank: int) -> IntervalArray:
    c = x.coefficients
    missing = rank + 2 - c.ndim
    return c if missing == 0 else c.reshape((*c.shape[:2], *(1,) * missing, *c.shape[2:]))


# What follows depends on the monomials alone, which networks of one kind share.


@lru_cache(maxsize=256)
def _union(x: tuple[Monomial, ...], y: tuple[Monomial, ...]) -> tuple[tuple[Monomial, ...], Indices, Indices]:
    """All monomials, and for each its place among those of x and of y, -1 where it has none."""
    of_x, of_y = ({m: k for k, m in enumerate(own)} for own in (x, y))
    both = tuple(of_x | of_y)
    places = [np.array([own.get(m, -1) for m in both], np.intp) for own in (of_x, of_y)]
    return both, places[0], places[1]


@lru_cache(maxsize=256)
def _products(x: tuple[Monomial, ...], y: tuple[Monomial, ...], square: bool) -> tuple[tuple[Monomial, ...], Indices]:
    """The monomials of a product, and (P, 3) which terms multiply to which; of a square both orders are one."""
    place: dict[Monomial, int] = {}
    table = []
    for i, p in enumerate(x):
        for j in range(i if square else 0, len(y)):
            m = tuple(sorted(p + y[j]))
            table.append((i, j, place.setdefault(m, len(place))))
    return tuple(place), np.array(table, np.intp).reshape(len(table), 3)


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
