"""The operation table: one row per operation (forward, backward, derivative, adjoint), on any engine.

Arrays carry a leading batch axis: a node of shape S is evaluated as an array of shape (B, *S), B boxes
at once. Operands of unequal rank are aligned behind the batch axis (`align`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.expression import Expr

Values = tuple[IntervalArray, ...]
Forward = Callable[[Arithmetic, Expr, Values], IntervalArray]
# (engine, node, value of the node, values of its arguments) -> one array per argument
Backward = Callable[[Arithmetic, Expr, IntervalArray, Values], Values]
# (engine, node, adjoint of the node) -> what it adds to the adjoint of each argument
Adjoint = Callable[[Arithmetic, Expr, IntervalArray], Values]
Positions = np.ndarray[tuple[int, ...], np.dtype[np.intp]]


@dataclass(frozen=True)
class Operation:
    """One row of the table.

    `forward` evaluates; `backward` narrows the arguments (in the node's shape, before intersection
    with what was known); `derivative` gives the partial derivatives for the chain rule, or is None for
    an operation that is linear and structural: its tangent is `forward` of the tangent. `adjoint` is the
    transpose of a linear operation (in the node's shape before sums over broadcast axes, or the argument's);
    None for the others, which multiply by their derivative.
    """

    forward: Forward
    backward: Backward
    derivative: Backward | None = None
    adjoint: Adjoint | None = None


def align(x: IntervalArray, rank: int) -> IntervalArray:
    """Give an array of shape (B, *S) the rank 1 + `rank` by ones behind the batch axis."""
    missing = rank + 1 - x.ndim
    return x if missing == 0 else x.reshape((x.shape[0],) + (1,) * missing + x.shape[1:])


def _aligned(node: Expr, xs: Values) -> Values:
    return tuple(align(x, node.ndim) for x in xs)


def _one(value: float = 1.0) -> IntervalArray:
    return IntervalArray.point(value)


def _negated(e: Arithmetic, x: IntervalArray) -> IntervalArray:
    return IntervalArray(-x.hi, -x.lo)


# index: a gather by flat position; its converse is an intersecting scatter ---------------------------


def _flat(x: IntervalArray) -> IntervalArray:
    return x.reshape((x.shape[0], -1))


def _index_forward(e: Arithmetic, node: Expr, xs: Values) -> IntervalArray:
    positions = _positions(node)
    return _flat(xs[0])[:, positions.ravel()].reshape((xs[0].shape[0], *node.shape))


def _index_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    flat, positions = _flat(xs[0]), _positions(node).ravel()
    values = _flat(out)
    batch = max(flat.shape[0], values.shape[0])  # readings have one row until some box has narrowed them
    lo, hi = (np.repeat(bound, batch // len(bound), axis=0) for bound in (flat.lo, flat.hi))
    rows = np.arange(batch)[:, None]
    np.maximum.at(lo, (rows, positions[None, :]), values.lo)
    np.minimum.at(hi, (rows, positions[None, :]), values.hi)
    return (IntervalArray(lo, hi).reshape((batch, *xs[0].shape[1:])),)


def _index_adjoint(e: Arithmetic, node: Expr, g: IntervalArray) -> Values:
    shape = node.args[0].shape
    return (scatter(e, _flat(g), _positions(node).ravel(), int(np.prod(shape))).reshape((g.shape[0], *shape)),)


def scatter(e: Arithmetic, values: IntervalArray, positions: Positions, size: int) -> IntervalArray:
    """Columns of `values` (B, M) added up at their `positions` (M,): the transpose of a gather, (B, size)."""
    count = np.bincount(positions, minlength=size)
    most = int(count.max(initial=0))
    batch, many = values.shape
    padded = [np.concatenate([bound, np.zeros((batch, 1))], axis=1) for bound in (values.lo, values.hi)]
    order = np.argsort(positions, kind="stable")
    first = np.repeat(np.cumsum(count) - count, count)
    sources = np.full((size, most), many)  # the column of zeros, where fewer than `most` meet
    sources[positions[order], np.arange(many) - first] = order
    if most == 1:
        return IntervalArray(padded[0][:, sources[:, 0]], padded[1][:, sources[:, 0]])
    return e.sum(IntervalArray(padded[0][:, sources], padded[1][:, sources]), 2)


def _positions(node: Expr) -> Positions:
    assert isinstance(node.data, np.ndarray)
    return node.data


# sum: each term is what the total leaves when the others are taken off --------------------------------


def _sum_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    axis = node.parameter + 1
    terms = IntervalArray(np.moveaxis(xs[0].lo, axis, 0), np.moveaxis(xs[0].hi, axis, 0))
    others = _sum_of_others(e, terms)
    left = e.sub(out[None], others)
    return (IntervalArray(np.moveaxis(left.lo, 0, axis), np.moveaxis(left.hi, 0, axis)),)


def _sum_adjoint(e: Arithmetic, node: Expr, g: IntervalArray) -> Values:
    axis, shape = node.parameter + 1, (g.shape[0], *node.args[0].shape)
    return (IntervalArray(np.expand_dims(g.lo, axis), np.expand_dims(g.hi, axis)).broadcast_to(shape),)


def _sum_of_others(e: Arithmetic, terms: IntervalArray) -> IntervalArray:
    """For each k along axis 0 the sum of all terms but the k-th, by prefixes and suffixes."""
    count = terms.shape[0]
    if count == 1:
        return IntervalArray.point(np.zeros(terms.shape))
    prefix, suffix = [terms[0]], [terms[count - 1]]  # sums of the first terms and of the last ones
    for k in range(1, count - 1):
        prefix.append(e.add(prefix[-1], terms[k]))
        suffix.append(e.add(suffix[-1], terms[count - 1 - k]))
    between = [e.add(prefix[k - 1], suffix[count - 2 - k]) for k in range(1, count - 1)]
    sums = [suffix[-1], *between, prefix[-1]]
    return IntervalArray(np.stack([s.lo for s in sums]), np.stack([s.hi for s in sums]))


# powers and roots -------------------------------------------------------------------------------------


def _either_sign(x: IntervalArray, root: IntervalArray) -> IntervalArray:
    """The part of x in `root` or in `-root`, as a hull (root >= 0)."""
    return x.intersect(root).hull(x.intersect(IntervalArray(-root.hi, -root.lo)))


def _power_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    n, x = node.parameter, xs[0]
    if n == 0:
        return (x,)
    if n < 0:
        out, n = e.div(_one(), out), -n
    return (e.root(out, n) if n % 2 else _either_sign(x, e.root(out, n)),)


def _power_derivative(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    n = node.parameter
    return (e.mul(_one(float(n)), e.power(xs[0], n - 1)) if n else IntervalArray.point(np.zeros(1)),)


def _sign(x: IntervalArray) -> IntervalArray:
    """Derivative of abs: 1, -1, or anything between where x holds zero inside (or nothing else)."""
    return IntervalArray(
        np.where((x.lo >= 0.0) & (x.hi > 0.0), 1.0, -1.0), np.where((x.hi <= 0.0) & (x.lo < 0.0), -1.0, 1.0)
    )


# minimum and maximum ----------------------------------------------------------------------------------


def _min_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    return _from_below(out, x, y), _from_below(out, y, x)


def _from_below(out: IntervalArray, x: IntervalArray, other: IntervalArray) -> IntervalArray:
    """x >= out; and x must attain the minimum where the other argument cannot."""
    hi = np.where(other.lo > out.hi, out.hi, np.inf)
    return IntervalArray(out.lo, np.where(np.isnan(out.hi), np.nan, hi))


def _max_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = (_negated(e, v) for v in _aligned(node, xs))
    minus = _negated(e, out)
    return _negated(e, _from_below(minus, x, y)), _negated(e, _from_below(minus, y, x))


def _share_of_smaller(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Derivative of min(x, y) with respect to x: 1 where x is smaller, 0 where y is, else [0, 1]."""
    return IntervalArray(np.where(x.hi <= y.lo, 1.0, 0.0), np.where(x.lo > y.hi, 0.0, 1.0))


def _min_derivative(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    first = _share_of_smaller(x, y)
    return first, e.sub(_one(), first)


def _max_derivative(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = (_negated(e, v) for v in _aligned(node, xs))
    first = _share_of_smaller(x, y)
    return first, e.sub(_one(), first)


# add, sub, mul, div: an argument that is a constant stays as it is. No box is kept for that: where no value of the
# constant fits, none of the other argument does (or the node itself, of constants alone, came out empty).

Narrowed = Callable[[], IntervalArray]


def _narrowed(node: Expr, xs: Values, first: Narrowed, second: Narrowed) -> Values:
    x, y = node.args
    return xs[0] if x.op == "constant" else first(), xs[1] if y.op == "constant" else second()


def _add_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    return _narrowed(node, xs, lambda: e.sub(out, y), lambda: e.sub(out, x))


def _sub_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    return _narrowed(node, xs, lambda: e.add(out, y), lambda: e.sub(x, out))


def _mul_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    return _narrowed(node, xs, lambda: e.factor(out, y, x), lambda: e.factor(out, x, y))


def _div_backward(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    x, y = _aligned(node, xs)
    return _narrowed(node, xs, lambda: e.mul(out, y), lambda: e.factor(x, out, y))


def _div_derivative(e: Arithmetic, node: Expr, out: IntervalArray, xs: Values) -> Values:
    y = align(xs[1], node.ndim)
    return e.div(_one(), y), _negated(e, e.div(out, y))


TABLE: dict[str, Operation] = {
    "neg": Operation(
        lambda e, n, xs: e.neg(xs[0]), lambda e, n, out, xs: (e.neg(out),), adjoint=lambda e, n, g: (_negated(e, g),)
    ),
    "index": Operation(_index_forward, _index_backward, adjoint=_index_adjoint),
    "sum": Operation(lambda e, n, xs: e.sum(xs[0], n.parameter + 1), _sum_backward, adjoint=_sum_adjoint),
    "add": Operation(
        lambda e, n, xs: e.add(*_aligned(n, xs)),
        _add_backward,
        lambda e, n, out, xs: (_one(), _one()),
        lambda e, n, g: (g, g),
    ),
    "sub": Operation(
        lambda e, n, xs: e.sub(*_aligned(n, xs)),
        _sub_backward,
        lambda e, n, out, xs: (_one(), _one(-1.0)),
        lambda e, n, g: (g, _negated(e, g)),
    ),
    "mul": Operation(
        lambda e, n, xs: e.mul(*_aligned(n, xs)),
        _mul_backward,
        lambda e, n, out, xs: (align(xs[1], n.ndim), align(xs[0], n.ndim)),
    ),
    "div": Operation(lambda e, n, xs: e.div(*_aligned(n, xs)), _div_backward, _div_derivative),
    "sqr": Operation(
        lambda e, n, xs: e.sqr(xs[0]),
        lambda e, n, out, xs: (_either_sign(xs[0], e.sqrt(out)),),
        lambda e, n, out, xs: (e.mul(_one(2.0), xs[0]),),
    ),
    "sqrt": Operation(
        lambda e, n, xs: e.sqrt(xs[0]),
        lambda e, n, out, xs: (e.sqr(out),),
        lambda e, n, out, xs: (e.div(_one(0.5), out),),
    ),
    "power": Operation(lambda e, n, xs: e.power(xs[0], n.parameter), _power_backward, _power_derivative),
    "abs": Operation(
        lambda e, n, xs: e.abs(xs[0]),
        lambda e, n, out, xs: (_either_sign(xs[0], out),),
        lambda e, n, out, xs: (_sign(xs[0]),),
    ),
    "min": Operation(lambda e, n, xs: e.minimum(*_aligned(n, xs)), _min_backward, _min_derivative),
    "max": Operation(lambda e, n, xs: e.maximum(*_aligned(n, xs)), _max_backward, _max_derivative),
}
