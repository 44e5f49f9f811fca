"""Arrays of polynomials in the network's variables, with coefficients that depend on the readings.

A monomial is the sorted tuple of the flat indices of its factors: () is 1, (0, 0, 3) is x0^2 x3. All
elements of an array share their monomials, which is what makes N measurements cheap.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.values import Bools, Indices, Names, Shape
from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.kernels import Arrays
from cpcal.solver.interval.operations import CODES
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.expression import Constraint, Expr, as_expr, positions, sqr, topological
from cpcal.solver.network.network import ConstraintNetwork, passes_down
from cpcal.solver.network.tape import ReadingSets, Tape

Monomial = tuple[int, ...]
Monomials = tuple[Monomial, ...]


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
    if len(x) * len(y) > _MOST_PRODUCTS:
        raise NotPolynomial(f"a product of {len(x) * len(y)} terms")
    place = dict[Monomial, int]()
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


class PolynomialArray(NamedTuple):
    """Elements of shape `shape`: the sum of `monomials` (T of them) times `coefficients`.

    Their lower and upper bounds are (1 + J, T, E) for E elements in C order, or for E = 1 where all are the same; the
    first axis is that of `coefficient`.
    """

    shape: Shape
    monomials: Monomials
    coefficients: Arrays
    reads: bool = False  # whether readings with a measurement axis occur

    @property
    def is_constant(self) -> bool:
        return not any(self.monomials)

    def spread(self, shape: Shape) -> Callable[[Arrays], Arrays]:
        """What makes coefficients of these elements those of elements of a shape; of one where all are the same."""
        if self.coefficients[0].shape[2] in (1, math.prod(shape)):
            return lambda own: own
        return _taken(np.broadcast_to(positions(self.shape), shape).ravel())


def _taken(places: Indices) -> Callable[[Arrays], Arrays]:
    return lambda own: (own[0].take(places, 2), own[1].take(places, 2))


Operation = Callable[..., Arrays]  # from the coefficients of an operation's arguments to its own


class Expander:
    """Expands expressions of one network over all of their reading sets; every node once.

    `over` repeats that over parts of the sets. What is not expanded at `deadline` (of time.monotonic()), or would have
    very many terms, counts as not polynomial.
    """

    def __init__(self, network: ConstraintNetwork, roots: tuple[Expr, ...], deadline: float) -> None:
        self._deadline = deadline
        self._places = network.places
        self._leaves = {node.digest: node for node in topological(roots) if node.op == "reading"}
        self._whole = self._allotted({})
        self._done = dict[bytes, PolynomialArray | NotPolynomial]()
        # of a node's operation the monomials, which of them do not vanish for all readings, and whether it has some
        self._plans = dict[bytes, tuple[Any, ...]]()
        self._orders = dict[bytes, list[Expr]]()  # of nodes under a root that depend on readings, arguments first

    def expand(self, root: Expr) -> PolynomialArray:
        """The polynomial form of `root`. Raises NotPolynomial."""
        for node in topological((root,), self._done):
            try:
                args = [self._found(arg) for arg in node.args]
                if not all(passes_down(node, arg) for arg, own in zip(node.args, args, strict=True) if own.reads):
                    raise NotPolynomial(f"{node.op!r} mixes the measurements of a reading")
                if node.op in ("mul", "sqr", "power") and time.monotonic() > self._deadline:
                    raise NotPolynomial("the time limit came first")
                self._done[node.digest] = self._node(node, args, self._whole)
            except NotPolynomial as reason:
                self._done[node.digest] = reason
        return self._found(root)

    def over(self, sets: Mapping[bytes, IntervalArray]) -> Callable[[Expr], PolynomialArray]:
        """What expands roots for readings in other `sets`, parts of theirs. Raises NotPolynomial as `expand` does.

        A coefficient that is zero for all readings of the whole sets is zero for these: monomials stay away.
        """
        if not sets:
            return self.expand
        readings, known = self._allotted(sets), dict[bytes, PolynomialArray]()

        def again(root: Expr) -> PolynomialArray:
            whole = self.expand(root)
            if root.digest not in self._orders:
                self._orders[root.digest] = [node for node in topological((root,)) if "reading" in node.ops]
            for node in self._orders[root.digest]:
                if node.digest not in known:
                    args = [known.get(arg.digest) or self._found(arg) for arg in node.args]
                    known[node.digest] = self._node(node, args, readings)
            return known.get(root.digest, whole)

        return again

    def _found(self, node: Expr) -> PolynomialArray:
        found = self._done[node.digest]
        if isinstance(found, NotPolynomial):
            raise found
        return found

    def _node(self, node: Expr, args: list[PolynomialArray], readings: Mapping[bytes, Arrays]) -> PolynomialArray:
        if node.op == "variable":
            places, unit = self._places[node.digest].ravel().tolist(), np.eye(node.size)[None]
            return PolynomialArray(node.shape, tuple((k,) for k in places), (unit, unit))
        if node.op == "constant":
            lo, hi = node.data.copied()
            return PolynomialArray(node.shape, ((),), (lo.reshape(1, 1, -1), hi.reshape(1, 1, -1)))
        if node.op == "reading":
            return PolynomialArray(node.shape, ((),), readings[node.digest], reads=bool(node.shape))
        plan = self._plans.get(node.digest)
        operation, monomials, keep, reads = plan or (*_operation(node, args), None, any(arg.reads for arg in args))
        lo, hi = operation(*[arg.coefficients for arg in args])
        if keep is None:
            keep = ((lo != 0.0) | (hi != 0.0)).any(axis=(0, 2)) | np.array([m == () for m in monomials], np.bool_)
            monomials = tuple(compress(monomials, keep.tolist()))
            self._plans[node.digest] = operation, monomials, keep, reads
        if len(monomials) < len(keep):
            lo, hi = lo.compress(keep, 1), hi.compress(keep, 1)
        return PolynomialArray(node.shape, monomials, (lo, hi), reads)

    def _allotted(self, sets: Mapping[bytes, IntervalArray]) -> dict[bytes, Arrays]:
        """Every reading's coefficients: one `delta_j` for each component whose set has a width in some row."""
        parts = []
        count = 1
        for node in self._leaves.values():
            values = sets.get(node.digest, node.data)
            mid, rows = values.mid, node.shape[0] if node.shape else 1
            radius = np.maximum(values.hi - mid, mid - values.lo).reshape(rows, -1)
            moving = np.flatnonzero(radius.any(axis=0))
            parts.append((node, mid, radius, moving, count))
            count += len(moving)
        out = {}
        for node, mid, radius, moving, first in parts:
            slopes = np.zeros((count if len(moving) else 1, *node.shape))
            slopes[0] = mid
            flat = slopes.reshape(len(slopes), *radius.shape)
            for k, j in enumerate(moving.tolist()):
                column = radius[:, j]
                flat[first + k, :, j] = np.where(column == 0.0, 0.0, np.nextafter(column, np.inf))
            slopes = slopes.reshape(len(slopes), 1, -1)
            out[node.digest] = slopes, slopes
        return out


def _operation(node: Expr, args: list[PolynomialArray]) -> tuple[Operation, Monomials]:
    """What an operation does, and the monomials of what it makes, for arguments with these. Raises NotPolynomial."""
    x, op, size, last = args[0], node.op, node.size, args[-1]
    monomials = x.monomials
    if op == "neg":
        return lambda own: (-own[1], -own[0]), monomials
    if op == "index":
        return _taken(node.places.ravel() % x.coefficients[0].shape[2]), monomials  # 0 where all are the same
    if op == "sum":
        before, count = math.prod(x.shape[: node.parameter]), x.shape[node.parameter]

        def summed(own: Arrays) -> Arrays:
            if own[0].shape[2] == 1:
                own = own[0].repeat(size * count, 2), own[1].repeat(size * count, 2)
            full = (len(own[0]), len(monomials) * before, count, size // before)
            lo, hi = coef.centred_sums((own[0].reshape(full), own[1].reshape(full)))
            return lo.reshape(len(lo), -1, size), hi.reshape(len(lo), -1, size)

        return summed, monomials
    one, two, over = x.spread(node.shape), last.spread(node.shape), partial(_over_readings, node)
    known, divides = all(arg.is_constant for arg in args), op == "div" and last.is_constant
    power = op == "power" and node.parameter >= 0
    if op in ("add", "sub"):
        sign, (found, of_x, of_y) = 1.0 if op == "add" else -1.0, _union(monomials, last.monomials)

        def made(*own: Arrays) -> Arrays:
            return coef.combined(one(own[0]), two(own[1]), of_x, of_y, sign, size)

    elif op in ("mul", "sqr") or divides or power:
        found, tables = ((),) if power else monomials, list[tuple[Indices, int]]()
        for _ in range(node.parameter if power else 1):
            found, table = _products(found, ((),) if divides else last.monomials, op == "sqr")
            tables.append((table, len(found)))

        def made(*own: Arrays) -> Arrays:
            out = (np.ones((1, 1, 1)), np.ones((1, 1, 1))) if power else one(own[0])
            factor = two(coef.reciprocal(_constant(own[1])) if divides else own[-1])
            for table, count in tables:
                out = coef.products(out, factor, table, count, size, op == "sqr")
            return out

    elif known:
        return over, ((),)
    else:
        raise NotPolynomial(f"{op!r} of an expression with variables")
    if not known or not found:
        return made, found
    return lambda *own: (over if all(len(lo) == 1 for lo, _ in own) else made)(*own), found


def _constant(own: Arrays) -> Arrays:
    """The coefficient (1 + J, 1, E) of a constant, zero where it is not listed."""
    return own if own[0].shape[1] else (np.zeros((1, 1, own[0].shape[2])),) * 2


def _over_readings(node: Expr, *args: Arrays) -> Arrays:
    """Any operation on constants, over all readings in their sets."""
    ranges = [IntervalArray(*coef.total(_constant(own))) for own in args]
    own = [v.broadcast_to((1, 1, a.size)).reshape(a.shape) for v, a in zip(ranges, node.args, strict=True)]
    values = own[0].apply(CODES[node.op], own[-1], node.parameter).reshape((1, 1, node.size))
    return values.lo, values.hi


@lru_cache(maxsize=4096)
def pairs(monomial: Monomial) -> int:
    """How many pairs of two there are such that one divides the other, and it the monomial."""
    return math.prod((k + 1) * (k + 2) // 2 for k in Counter(monomial).values())


# ------------------------------------------------------------------------------------------------------------------
# From constraints to polynomial inequalities `q <= 0`.
#
# A row `expr <= 0` is replaced by rows whose conjunction it implies (for some reading, the row's own): square roots are
# isolated and squared, absolute values and maxima split. A row that does not become polynomial is left to the other
# contractors and listed in `PolynomialSystem.leftover`.


class Row(NamedTuple):
    """`expr <= 0`, elementwise, wherever `guard >= 0` (everywhere when there is no guard).

    Where the guard v is only known to be >= -t, `expr <= t^2` still holds: see `split`.
    """

    expr: Expr
    constraint: int
    guard: Expr | None = None
    elements: Indices | None = None  # of the constraint's body, flat; None: all


def one_sided(number: int, constraint: Constraint) -> list[Row]:
    """`lower <= body <= upper` as at most two rows; infinite bounds give none."""
    rows = []
    for bound, sign in ((constraint.upper, 1.0), (constraint.lower, -1.0)):
        body = constraint.body
        idle = np.broadcast_to(bound.op == "constant" and bound.data.lo == sign * np.inf, body.shape).ravel()
        if idle.all():
            continue
        elements = np.flatnonzero(~idle) if idle.any() else None
        if elements is not None:
            where = np.unravel_index(elements, body.shape)
            body, bound = body[where], as_expr(bound.data.broadcast_to(body.shape)[where])
        rows.append(Row(body - bound if sign > 0.0 else bound - body, number, elements=elements))
    return rows


def one_sided_rows(network: ConstraintNetwork) -> list[Row]:
    """Those of all constraints, in order."""
    return network.once("rows", lambda: [row for k, c in enumerate(network.constraints) for row in one_sided(k, c)])


Term = tuple[Expr, Expr]  # constant factor, expression


_ZERO, _ONE, _MINUS = map(as_expr, (0.0, 1.0, -1.0))


def _times(factor: Expr, node: Expr) -> Expr:
    """Their product, without a factor that says nothing: each operation is made again on every box."""
    if factor.digest == _ONE.digest:
        return node
    if factor.digest == _MINUS.digest:
        return _ONE if node.digest == _MINUS.digest else _MINUS if node.digest == _ONE.digest else -node
    return factor * node


def terms(expr: Expr) -> list[Term]:
    """`expr` as a sum of constants times expressions that are no sums themselves."""
    out = []
    stack = [(_ONE, expr)]
    while stack:
        factor, node = stack.pop()
        if node.op in ("add", "sub"):
            second = factor if node.op == "add" else _times(_MINUS, factor)
            stack += [(second, node.args[1]), (factor, node.args[0])]
        elif node.op == "neg":
            stack.append((_times(_MINUS, factor), node.args[0]))
        elif node.op == "mul" and node.args[0].is_constant:
            stack.append((_times(factor, node.args[0]), node.args[1]))
        elif node.op in ("mul", "div") and node.args[1].is_constant:
            first, known = node.args
            stack.append((_times(factor, known) if node.op == "mul" else factor / known, first))
        else:
            out.append((factor, node))
    return out


def sign_of(network: ConstraintNetwork, expr: Expr) -> int:
    """1 or -1 for an expression of one sign on the domain, else 0."""
    values = expr.data
    if expr.op != "constant":
        tape = Tape(network, [expr])
        values = tape.values(tape.forward(network.domain.array[None]))
    return int(np.all(values.lo > 0.0)) - int(np.all(values.hi < 0.0))


def isolated(expr: Expr, op: str) -> tuple[Expr, Expr, Expr] | None:
    """The first term with operation `op`: its factor, its node and the sum of all other terms; None without one."""
    of = terms(expr) if op in expr.ops else []
    first = next((k for k, (_, node) in enumerate(of) if node.op == op), None)
    if first is None:
        return None
    others = [_times(*term) for term in of[:first] + of[first + 1 :]]
    rest = sum(others[1:], others[0]) if others else _ZERO
    return (*of[first], rest if rest.shape == expr.shape else rest + np.zeros(expr.shape))


def split(row: Row) -> list[Row] | None:
    """The rows that say the same without the first extremum, absolute value or square root; None where there is none.

    For `c f + r <= 0` with a constant c of one sign:
    max, c > 0, and min, c < 0    a row for each argument
    |u|, c > 0                    a row for u and one for -u; for c < 0 it is the square root of u^2
    sqrt(u), c > 0                r <= 0 and c^2 u <= r^2
    sqrt(u), c < 0                r^2 <= c^2 u where r >= 0. Where r >= -t only, sqrt(c^2 u) >= r gives
                                  c^2 u >= r^2 - t^2: either r >= 0, or r^2 <= t^2
    """
    for op in ("max", "min", "abs", "sqrt") if row.guard is None else ():
        found = isolated(row.expr, op)
        if found is None:
            continue
        factor, node, rest = found
        sign = sign_of(ConstraintNetwork(), factor)
        if (op, sign) in (("max", 1), ("min", -1)):
            return [row._replace(expr=rest + _times(factor, arg)) for arg in node.args]
        if (op, sign) == ("abs", 1):
            return [row._replace(expr=rest + s * factor * node.args[0]) for s in (1.0, -1.0)]
        if op in ("abs", "sqrt") and sign:
            squared = _times(_times(factor, factor), node.args[0])
            if op == "abs":
                squared = sqr(_times(factor, node.args[0]))
            if sign < 0:
                return [row._replace(expr=sqr(rest) - squared, guard=rest)]
            return [row._replace(expr=rest), row._replace(expr=squared - sqr(rest))]
    return None


_MOST = 512  # rows made of one


def rewritten(row: Row) -> list[Row]:
    """The rows that are made of one row; the row itself where they would be more than `_MOST`.

    A sum of n absolute values stands for 2^n rows.
    """
    todo, done = [row], list[Row]()
    while todo:
        if len(todo) + len(done) > _MOST:
            return [row]
        first, *todo = todo
        found = split(first)
        if found is None:
            done.append(first)
        else:
            todo = found + todo
    return done


# ------------------------------------------------------------------------------------------------------------------
# The polynomial form of a network: all rows that have one, over one list of shared monomials.


class PolynomialSystem(NamedTuple):
    """K inequalities `sum_m coefficients[:, k, m] * monomials[m] <= 0` in n variables.

    `coefficients` has shape (1 + J, K, M) (see `coefficient`), and so have `guards`, those of the rows in `guarded`
    (K,); monomial 0 is 1 and with a monomial all its divisors are listed. `origin` (K, 2) holds constraint and element
    of each row, `part` which of the rows made from that constraint it belongs to.
    """

    names: Names
    monomials: Monomials
    coefficients: IntervalArray
    guarded: Bools
    guards: IntervalArray
    origin: Indices
    part: Indices
    leftover: tuple[tuple[int, str], ...]

    def among(self, elements: Indices) -> "PolynomialSystem":
        """The rows of some elements (ascending) of each constraint, which get new numbers."""
        rows = np.flatnonzero(np.isin(self.origin[:, 1], elements))
        constraint, element = self.origin[rows].T
        return self._replace(
            coefficients=self.coefficients[:, rows],
            guarded=self.guarded[rows],
            guards=self.guards[:, rows],
            origin=np.column_stack([constraint, np.searchsorted(elements, element)]),
            part=self.part[rows],
        )


Expanded = tuple[Row, PolynomialArray, PolynomialArray | None]


class PolynomialForms:
    """The polynomial forms of one network for any parts of its reading sets; what they share is done once.

    Rows that are not expanded at `deadline` (of time.monotonic()) have none.
    """

    def __init__(self, network: ConstraintNetwork, deadline: float = math.inf) -> None:
        self._network, self._deadline = network, deadline
        self._parts = list[list[Row]]()  # of each one-sided row those that are made of it
        self._expander: Expander | None = None

    def __getstate__(self) -> dict[str, object]:
        """Without the expander, which holds all coefficients: it is made again where it is wanted."""
        return self.__dict__ | {"_expander": None}

    def on(self, sets: Sequence[ReadingSets] | None = None) -> PolynomialSystem:
        """All rows that have a polynomial form, over one list of shared monomials.

        `sets` may give, for each one-sided row, smaller reading sets that decide it (see `DecisiveReadings`).
        """
        if self._expander is None:
            first = one_sided_rows(self._network)
            self._parts = [rewritten(row) for row in first]
            self._expander = Expander(self._network, tuple(row.expr for row in first), self._deadline)
        expanded, leftover = [], []
        monomials, size = set[Monomial](), 0
        again = map(self._expander.over, sets or [{}] * len(self._parts))
        for part, over in ((part, over) for parts, over in zip(self._parts, again, strict=True) for part in parts):
            roots = (part.expr,) if part.guard is None else (part.expr, part.guard)
            try:
                forms = list(map(over, roots))
                more = {m for p in forms for m in p.monomials} - monomials
                larger = size + sum(map(pairs, more))
                if larger > MOST_PAIRS:
                    raise NotPolynomial("with the other rows, too many products")
                monomials, size = monomials | more, larger
                expanded.append((part, forms[0], None if part.guard is None else forms[1]))
            except NotPolynomial as reason:
                leftover.append((part.constraint, str(reason)))
        return _system(self._network, expanded, leftover)


def _system(network: ConstraintNetwork, rows: list[Expanded], leftover: list[tuple[int, str]]) -> PolynomialSystem:
    bodies, guards = [q for _, q, _ in rows], [g for _, _, g in rows]
    forms = [p for p in (*bodies, *guards) if p is not None]
    monomials = _closed(frozenset(m for p in forms for m in p.monomials))
    slots = max((len(p.coefficients[0]) for p in forms), default=1)
    counts = np.array([math.prod(q.shape) for q in bodies], np.intp)
    origins, parts, before = [np.zeros((0, 2), np.intp)], [], Counter[int]()
    for (row, *_), count in zip(rows, counts.tolist(), strict=True):
        elements = np.arange(count) if row.elements is None else row.elements
        origins.append(np.column_stack([np.full(count, row.constraint), elements]))
        parts.append(before[row.constraint])
        before[row.constraint] += 1
    return PolynomialSystem(
        names=network.names,
        monomials=monomials,
        coefficients=_table(bodies, counts, monomials, slots),
        guarded=np.repeat(np.array([g is not None for g in guards], np.bool_), counts),
        guards=_table(guards, counts, monomials, slots),
        origin=np.concatenate(origins),
        part=np.repeat(np.array(parts, np.intp), counts),
        leftover=tuple(leftover),
    )


@lru_cache(maxsize=16)
def _closed(monomials: frozenset[Monomial]) -> Monomials:
    """All divisors of the given monomials, by degree, then by variables."""
    out: set[Monomial] = {()}
    todo = list(monomials)
    while todo:
        m = todo.pop()
        if m not in out:
            out.add(m)
            todo += [m[:k] + m[k + 1 :] for k in range(len(m))]
    return tuple(sorted(out, key=lambda m: (len(m), m)))


def _table(forms: Sequence[PolynomialArray | None], counts: Indices, monomials: Monomials, slots: int) -> IntervalArray:
    """Coefficients (1 + J, K, M) of all rows: those of a monomial stand side by side in memory."""
    lo, hi = np.zeros((2, slots, len(monomials), int(counts.sum())))
    place, start = {m: k for k, m in enumerate(monomials)}, 0
    for p, count in zip(forms, counts.tolist(), strict=True):
        if p is not None:
            where = slice(len(p.coefficients[0])), [place[m] for m in p.monomials], slice(start, start + count)
            lo[where], hi[where] = p.coefficients
        start += count
    return IntervalArray(lo.transpose(0, 2, 1), hi.transpose(0, 2, 1))
