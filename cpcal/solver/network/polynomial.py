"""Arrays of polynomials in the network's variables, with coefficients that depend on the readings.

A monomial is the sorted tuple of the flat indices of its factors: () is 1, (0, 0, 3) is x0^2 x3. All
elements of an array share their monomials, which is what makes N measurements cheap.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.interval.operations import CODES
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.expression import Expr, topological
from cpcal.solver.network.network import ConstraintNetwork

# ------------------------------------------------------------------------------------------------------------------
# What operations do to polynomials: to their monomials once, to their coefficients as often as readings change.
#
# Each function takes the monomials of its operands and gives those of the result, and the `Operation` that makes the
# result's coefficients (1 + J, T, *B) of the operands'.

Monomial = tuple[int, ...]
Monomials = tuple[Monomial, ...]
Operation = Callable[[Sequence[IntervalArray]], IntervalArray]
Terms = tuple[Monomials, Operation]


def structural(e: Arithmetic, node: Expr, x: Monomials) -> Terms:
    """Minus, elements of an array, the sum along one of its axes."""
    shape = node.args[0].shape

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        if node.op == "neg":
            return e.neg(args[0])
        full = args[0].broadcast_to((*args[0].shape[:2], *shape))
        if node.op == "sum":
            return coef.total_over(e, full, node.parameter + 1)
        assert isinstance(node.data, np.ndarray)
        return full.reshape((*full.shape[:2], -1))[:, :, node.data]

    return x, made


def sum_of(e: Arithmetic, rank: int, x: Monomials, y: Monomials, sign: float) -> Terms:
    """x + sign y, for arrays of a common rank."""
    monomials, of_x, of_y = _union(x, y)

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        return coef.combined_terms(e, _aligned(args[0], rank), _aligned(args[1], rank), of_x, of_y, sign)

    return monomials, made


def product_of(e: Arithmetic, rank: int, x: Monomials, y: Monomials) -> Terms:
    """x y, for arrays of a common rank."""
    monomials, table = _products(x, y, False)

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        return coef.term_products(e, _aligned(args[0], rank), _aligned(args[1], rank), table, len(monomials), False)

    return monomials, made


def square_of(e: Arithmetic, rank: int, x: Monomials) -> Terms:
    monomials, table = _products(x, x, True)

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        own = _aligned(args[0], rank)
        return coef.term_products(e, own, own, table, len(monomials), True)

    return monomials, made


def quotient_of(e: Arithmetic, rank: int, x: Monomials, y: Monomials) -> Terms:
    """x / y for a constant y."""
    monomials, product = product_of(e, rank, x, ((),))

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        return product([args[0], coef.reciprocal(e, constant_term(args[1], y))[:, None]])

    return monomials, made


def power_of(rank: int, products: Sequence[Operation]) -> Operation:
    """One factor after the other, by the products with each."""

    def made(args: Sequence[IntervalArray]) -> IntervalArray:
        out = IntervalArray.point(np.ones((1, 1) + (1,) * rank))
        for product in products:
            out = product([out, args[0]])
        return out

    return made


def value_of(e: Arithmetic, node: Expr, args: Sequence[Monomials]) -> Terms:
    """Any operation on constants: a constant, over all readings in their sets."""

    def made(values: Sequence[IntervalArray]) -> IntervalArray:
        known = [coef.total(e, constant_term(c, m)) for c, m in zip(values, args, strict=True)]
        own = [x.reshape(x.shape[1:]).broadcast_to(node.shape) for x in known]
        return e.apply(CODES[node.op], own[0], own[-1], node.parameter)[None, None]

    return ((),), made


def constant_term(c: IntervalArray, monomials: Monomials) -> IntervalArray:
    """The coefficient of 1, which is zero where it is not listed."""
    return c[:, monomials.index(())] if () in monomials else IntervalArray.point(np.zeros((1, *c.shape[2:])))


def _aligned(c: IntervalArray, rank: int) -> IntervalArray:
    missing = rank + 2 - c.ndim
    return c if missing == 0 else c.reshape((*c.shape[:2], *(1,) * missing, *c.shape[2:]))


# What follows depends on the monomials alone, which networks of one kind share.


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


Found = PolynomialArray | NotPolynomial


@dataclass(frozen=True)
class _Recorded:
    """How a node's coefficients follow from those of its arguments: `keep` are the monomials that do not vanish."""

    digest: bytes
    args: tuple[bytes, ...]
    operation: Operation
    keep: Bools | None


class Expander:
    """Expands expressions of one network over all of their reading sets; every node once.

    `again` repeats that over parts of the sets, for the price of the arithmetic. What is not expanded at `deadline` (of
    time.monotonic()), or would have very many terms, counts as not polynomial.
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
            start += int(np.prod(leaf.shape))
        self._leaves = {node.digest: node for node in topological(roots) if node.op == "reading"}
        self._whole = self._allotted({})
        self._done: dict[bytes, Found] = {}
        self._recorded: dict[bytes, _Recorded] = {}  # of the nodes that depend on readings
        self._orders: dict[bytes, list[_Recorded]] = {}

    def expand(self, root: Expr) -> PolynomialArray:
        """The polynomial form of `root`. Raises NotPolynomial."""
        for node in topological((root,)) if root.digest not in self._done else ():
            if node.digest not in self._done:
                try:
                    self._done[node.digest] = self._node(node)
                except NotPolynomial as reason:
                    self._done[node.digest] = reason
        found = self._done[root.digest]
        if isinstance(found, NotPolynomial):
            raise found
        return found

    def again(self, roots: Sequence[Expr], sets: Mapping[bytes, IntervalArray]) -> list[PolynomialArray]:
        """The forms of some `roots`, which `expand` has found, for readings in other `sets`, parts of theirs.

        A coefficient that is zero for all readings of the whole sets is zero for these: monomials stay away.
        """
        known, out = self._allotted(sets), []
        for root in roots:
            whole = self.expand(root)
            for step in self._steps(root):
                if step.digest not in known:
                    value = step.operation([known.get(arg) or self._coefficients(arg) for arg in step.args])
                    known[step.digest] = value if step.keep is None else value[:, step.keep]
            if root.digest in known:
                whole = replace(whole, coefficients=known[root.digest])
            out.append(whole)
        return out

    def _steps(self, root: Expr) -> list[_Recorded]:
        """Of the nodes under a root that depend on readings, arguments first."""
        if root.digest not in self._orders:
            under = (self._recorded.get(node.digest) for node in topological((root,)))
            self._orders[root.digest] = [step for step in under if step is not None]
        return self._orders[root.digest]

    def _coefficients(self, digest: bytes) -> IntervalArray:
        found = self._done[digest]
        assert isinstance(found, PolynomialArray)
        return found.coefficients

    def _node(self, node: Expr) -> PolynomialArray:
        if node.op == "variable":
            return self._variable(node)
        if node.op == "constant":
            assert isinstance(node.data, IntervalArray)
            return PolynomialArray(node.shape, ((),), _owned(node.data)[None, None])
        if node.op == "reading":
            return PolynomialArray(node.shape, ((),), self._whole[node.digest], reads=bool(node.shape))
        args = []
        for arg in node.args:
            found = self._done[arg.digest]
            if isinstance(found, NotPolynomial):
                raise found
            args.append(found)
        _check_rows(node, args)
        monomials, operation = self._operation(node, args)
        coefficients = operation([arg.coefficients for arg in args])
        keep = _occurring(monomials, coefficients)
        if keep is not None:
            monomials = tuple(m for m, kept in zip(monomials, keep.tolist(), strict=True) if kept)
            coefficients = coefficients[:, keep]
        if "reading" in node.ops:
            digests = tuple(arg.digest for arg in node.args)
            self._recorded[node.digest] = _Recorded(node.digest, digests, operation, keep)
        return PolynomialArray(node.shape, monomials, coefficients, any(arg.reads for arg in args))

    def _variable(self, node: Expr) -> PolynomialArray:
        count, start = int(np.prod(node.shape)), self._start[node.digest]
        unit = np.eye(count).reshape((1, count, *node.shape))
        return PolynomialArray(node.shape, tuple((start + k,) for k in range(count)), IntervalArray.point(unit))

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

    def _operation(self, node: Expr, args: list[PolynomialArray]) -> Terms:
        e, rank, own = self._engine, node.ndim, [arg.monomials for arg in args]
        if node.op in ("neg", "index", "sum"):
            return structural(e, node, own[0])
        if node.op in ("add", "sub"):
            return sum_of(e, rank, own[0], own[1], 1.0 if node.op == "add" else -1.0)
        if node.op == "mul":
            self._check_size(len(own[0]) * len(own[1]))
            return product_of(e, rank, own[0], own[1])
        if node.op == "sqr":
            self._check_size(len(own[0]) ** 2)
            return square_of(e, rank, own[0])
        if node.op == "power" and node.parameter >= 0:
            return self._power(rank, own[0], node.parameter)
        if node.op == "div" and args[1].is_constant:
            return quotient_of(e, rank, own[0], own[1])
        if all(arg.is_constant for arg in args):
            return value_of(e, node, own)
        raise NotPolynomial(f"{node.op!r} of an expression with variables")

    def _power(self, rank: int, x: Monomials, exponent: int) -> Terms:
        """A whole power, one factor after the other."""
        monomials: Monomials = ((),)
        products: list[Operation] = []
        for _ in range(exponent):
            self._check_size(len(monomials) * len(x))
            monomials, product = product_of(self._engine, rank, monomials, x)
            products.append(product)
        return monomials, power_of(rank, products)

    def _check_size(self, products: int) -> None:
        if products > _MOST_PRODUCTS:
            raise NotPolynomial(f"a product of {products} terms")
        if time.monotonic() > self._deadline:
            raise NotPolynomial("the time limit came first")


def _owned(data: IntervalArray) -> IntervalArray:
    """A copy that may be written: kernels are compiled for such arrays."""
    lo = data.lo.copy()
    return IntervalArray(lo, lo if data.hi is data.lo else data.hi.copy())


def _occurring(monomials: Monomials, coefficients: IntervalArray) -> Bools | None:
    """The monomials whose coefficients are not all zero, and the constant; None for all of them."""
    keep = coef.occurring_terms(coefficients)
    if keep.all():
        return None
    keep |= np.array([m == () for m in monomials], np.bool_)
    return keep


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
