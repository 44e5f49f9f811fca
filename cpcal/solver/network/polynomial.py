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

import numpy as np

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
    """Elements of shape `shape`; `terms[m]` is a coefficient array (see `coefficient`) that broadcasts to it."""

    shape: tuple[int, ...]
    terms: dict[Monomial, IntervalArray]
    reads: bool = False  # whether readings with a measurement axis occur

    @property
    def is_constant(self) -> bool:
        return all(m == () for m in self.terms)

    @property
    def constant(self) -> IntervalArray:
        zero = IntervalArray.point(np.zeros((1,) + (1,) * len(self.shape)))
        return self.terms.get((), zero)


def _aligned(c: IntervalArray, rank: int) -> IntervalArray:
    missing = rank + 1 - c.ndim
    return c if missing == 0 else c.reshape((c.shape[0],) + (1,) * missing + c.shape[1:])


Found = PolynomialArray | NotPolynomial


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
            return PolynomialArray(node.shape, {(): node.data[None]})
        if node.op == "reading":
            return self._readings[node.digest]
        args = []
        for arg in node.args:
            found = self._of(arg)
            if isinstance(found, NotPolynomial):
                raise found
            args.append(found)
        _check_rows(node, args)
        reads = any(arg.reads for arg in args)
        terms = self._operation(node, args)
        return PolynomialArray(node.shape, {m: c for m, c in terms.items() if m == () or not coef.is_zero(c)}, reads)

    def _variable(self, node: Expr) -> PolynomialArray:
        count, start = int(np.prod(node.shape)), self._start[node.digest]
        unit = np.eye(count).reshape((count, 1, *node.shape))
        return PolynomialArray(node.shape, {(start + k,): IntervalArray.point(unit[k]) for k in range(count)})

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
            terms: dict[Monomial, IntervalArray] = {(): IntervalArray.point(slopes[:used])}
            self._readings[node.digest] = PolynomialArray(node.shape, terms, reads=bool(node.shape))

    def _operation(self, node: Expr, args: list[PolynomialArray]) -> dict[Monomial, IntervalArray]:
        e = self._engine
        if node.op in ("neg", "index", "sum"):
            return {m: self._structural(node, args[0], c) for m, c in args[0].terms.items()}
        if node.op == "add":
            return self._sum(node, args[0].terms, args[1].terms)
        if node.op == "sub":
            return self._sum(node, args[0].terms, {m: e.neg(c) for m, c in args[1].terms.items()})
        if node.op == "mul":
            return self._product(node, args[0], args[1])
        if node.op == "sqr":
            return self._square(node, args[0])
        if node.op == "power" and node.parameter >= 0:
            return self._power(node, args[0])
        if node.op == "div" and args[1].is_constant:
            divisor = PolynomialArray(args[1].shape, {(): coef.reciprocal(e, args[1].constant)})
            return self._product(node, args[0], divisor)
        if all(arg.is_constant for arg in args):
            values = tuple(coef.total(e, arg.constant) for arg in args)
            return {(): elementwise(e, node, values)}
        raise NotPolynomial(f"{node.op!r} of an expression with variables")

    def _structural(self, node: Expr, arg: PolynomialArray, c: IntervalArray) -> IntervalArray:
        full = c.broadcast_to((c.shape[0], *arg.shape))
        if node.op == "neg":
            return self._engine.neg(full)
        if node.op == "sum":
            return coef.total_over(self._engine, full, node.parameter)
        assert isinstance(node.data, np.ndarray)
        return full.reshape((full.shape[0], -1))[:, node.data]

    def _sum(
        self, node: Expr, left: dict[Monomial, IntervalArray], right: dict[Monomial, IntervalArray]
    ) -> dict[Monomial, IntervalArray]:
        out = {m: _aligned(c, node.ndim) for m, c in left.items()}
        for m, c in right.items():
            c = _aligned(c, node.ndim)
            out[m] = coef.add(self._engine, out[m], c) if m in out else c
        return out

    def _product(self, node: Expr, x: PolynomialArray, y: PolynomialArray) -> dict[Monomial, IntervalArray]:
        out: dict[Monomial, IntervalArray] = {}
        self._check_size(len(x.terms) * len(y.terms))
        for p, c in x.terms.items():
            self._check_size(len(y.terms))
            for q, d in y.terms.items():
                self._accumulate(out, p + q, coef.mul(self._engine, _aligned(c, node.ndim), _aligned(d, node.ndim)))
        return out

    def _square(self, node: Expr, x: PolynomialArray) -> dict[Monomial, IntervalArray]:
        e, out = self._engine, dict[Monomial, IntervalArray]()
        items = list(x.terms.items())
        self._check_size(len(items) ** 2)
        for i, (p, c) in enumerate(items):
            self._accumulate(out, p + p, e.sqr(c) if c.shape[0] == 1 else coef.mul(e, c, c))
            for q, d in items[i + 1 :]:
                self._accumulate(out, p + q, coef.doubled(coef.mul(e, c, d)))
        return out

    def _power(self, node: Expr, x: PolynomialArray) -> dict[Monomial, IntervalArray]:
        out = PolynomialArray(node.shape, {(): IntervalArray.point(np.ones((1,) + (1,) * node.ndim))})
        for _ in range(node.parameter):
            out = PolynomialArray(node.shape, self._product(node, out, x))
        return out.terms

    def _check_size(self, products: int) -> None:
        if products > _MOST_PRODUCTS:
            raise NotPolynomial(f"a product of {products} terms")
        if time.monotonic() > self._deadline:
            raise NotPolynomial("the time limit came first")

    def _accumulate(self, out: dict[Monomial, IntervalArray], monomial: Monomial, c: IntervalArray) -> None:
        if coef.is_zero(c):
            return
        key = tuple(sorted(monomial))
        out[key] = coef.add(self._engine, out[key], c) if key in out else c


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
