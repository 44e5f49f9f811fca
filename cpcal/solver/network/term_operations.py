"""What operations do to polynomials: to their monomials once, to their coefficients as often as readings change.

Each function takes the monomials of its operands and gives those of the result, and the `Operation` that makes the
result's coefficients (1 + J, T, *B) of the operands'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from cpcal.common.arrays import Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.engines import elementwise
from cpcal.solver.network.expression import Expr

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
        known = tuple(coef.total(e, constant_term(c, m)) for c, m in zip(values, args, strict=True))
        return elementwise(e, node, known)[None]

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
