"""The constraint network: named variables with domains, readings known only to a set, constraints.

A point x solves the network when THERE EXISTS one value of every reading in its set such that every
element of every constraint holds. (Constants are exact numbers; an interval constant is an enclosure
of one, and whatever is claimed holds for every number in it.)
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.errors import ModelError
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.network.expression import Constraint, Expr, Operand, Shape, as_expr, enclosed

Domain = Interval | tuple[npt.ArrayLike, npt.ArrayLike]


class ConstraintNetwork:
    """Variables, readings and constraints, in the order in which they were added."""

    def __init__(self) -> None:
        self._variables: dict[str, Expr] = {}
        self._domains: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]] = []
        self._constraints: list[Constraint] = []

    def variable(self, name: str, shape: int | Shape = (), domain: Domain = (-np.inf, np.inf)) -> Expr:
        """A new unknown; components of an array are called `name[0]`, `name[1,2]`, in boxes.

        `domain` is an Interval or a pair of bounds that broadcast to `shape`.
        """
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        if name in self._variables or not name:
            raise ModelError(f"a variable needs a name of its own; {name!r} is empty or taken")
        lo, hi = (domain.lo, domain.hi) if isinstance(domain, Interval) else domain
        try:
            lows = np.broadcast_to(enclosed(lo).lo, shape).ravel()
            highs = np.broadcast_to(enclosed(hi).hi, shape).ravel()
        except ValueError:
            raise ModelError(f"the domain of {name!r} does not fit its shape {shape}") from None
        if not bool(np.all(lows <= highs)):
            raise ModelError(f"the domain of {name!r} is empty or NaN: {lo} to {hi}")
        leaf = Expr("variable", shape=shape, name=name)
        self._variables[name] = leaf
        self._domains.append((lows, highs))
        return leaf

    @staticmethod
    def constant(value: Operand) -> Expr:
        """An exact number or array, or an enclosure of one (Interval, IntervalArray)."""
        return as_expr(value)

    @staticmethod
    def reading(center: npt.ArrayLike, radius: npt.ArrayLike) -> Expr:
        """A measured quantity known to lie within `radius` of `center`: THERE EXISTS a value in that set.

        The leading axis counts measurements (a scalar reading is shared by all of them). Where every
        radius is zero this is a constant.
        """
        values = IntervalArray.around(center, radius)
        if not bool(np.all(np.isfinite(values.lo) & np.isfinite(values.hi))) or bool(np.any(np.asarray(radius) < 0)):
            raise ModelError("a reading needs finite centres and finite, non-negative radii")
        if not np.any(radius):
            return Expr("constant", shape=values.shape, data=values)
        return Expr("reading", shape=values.shape, data=values)

    def add(self, constraint: Constraint | Iterable[Constraint]) -> None:
        """Require a constraint (or several)."""
        if isinstance(constraint, Expr) or not isinstance(constraint, (Constraint, Iterable)):
            raise ModelError(f"add() takes constraints, not {constraint!r}: use ==, <=, >= or .within()")
        items = [constraint] if isinstance(constraint, Constraint) else list(constraint)
        for item in items:
            for leaf in leaves((item.body, item.lower, item.upper)):
                if leaf.op == "variable" and self._variables.get(leaf.name) is not leaf:
                    raise ModelError(f"variable {leaf.name!r} belongs to another network")
        self._constraints += items

    def without_constraints(self) -> ConstraintNetwork:
        """A new network with the same variables and domains and no constraints yet."""
        copy = ConstraintNetwork()
        copy._variables, copy._domains = dict(self._variables), list(self._domains)
        return copy

    @property
    def variables(self) -> tuple[Expr, ...]:
        return tuple(self._variables.values())

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        return tuple(self._constraints)

    @property
    def names(self) -> tuple[str, ...]:
        """Component names of the flattened variables: the names in a `Box`."""
        return tuple(name for leaf in self._variables.values() for name in component_names(leaf))

    @property
    def domain(self) -> Box:
        """The box of all variables' domains."""
        empty = (np.zeros(0), np.zeros(0))
        lows, highs = zip(*(self._domains or [empty]), strict=True)
        return Box(self.names, np.concatenate(lows), np.concatenate(highs))

    def component(self, expr: Expr) -> str:
        """The name in a box of a variable, or of one element of it. Raises ModelError for others."""
        leaf = expr.args[0] if expr.op == "index" else expr
        if expr.shape == () and leaf.op == "variable" and self._variables.get(leaf.name) is leaf:
            position = int(expr.data) if isinstance(expr.data, np.ndarray) else 0
            return component_names(leaf)[position]
        raise ModelError(f"{expr!r} is not a scalar variable of this network")

    @property
    def digest(self) -> str:
        """SHA-256 over variables, domains and constraints, in order; the same for networks built alike."""
        hasher = hashlib.sha256(repr(self.names).encode())
        hasher.update(self.domain.lo.tobytes() + self.domain.hi.tobytes())
        roots = [expr for c in self._constraints for expr in (c.body, c.lower, c.upper)]
        number: dict[bytes, int] = {}
        for node in topological(roots):
            args = tuple(number[arg.digest] for arg in node.args)
            number[node.digest] = len(number)
            hasher.update(repr((node.op, node.shape, node.parameter, node.name, args)).encode())
            if isinstance(node.data, IntervalArray):
                hasher.update(node.data.lo.tobytes() + node.data.hi.tobytes())
            elif node.data is not None:
                hasher.update(node.data.astype(np.int64).tobytes())
        hasher.update(repr([number[expr.digest] for expr in roots]).encode())
        return hasher.hexdigest()

    def __getstate__(self) -> tuple[list[Expr], dict[str, Any]]:
        roots = [expr for c in self._constraints for expr in (c.body, c.lower, c.upper)]
        return topological(roots), self.__dict__  # arguments first: pickle follows them without deep recursion

    def __setstate__(self, state: tuple[list[Expr], dict[str, Any]]) -> None:
        self.__dict__.update(state[1])

    def __repr__(self) -> str:
        count = sum(int(np.prod(c.body.shape)) for c in self._constraints)
        return f"<{type(self).__name__}: {len(self.names)} unknowns, {count} constraints>"


def component_names(leaf: Expr) -> tuple[str, ...]:
    """`x` for a scalar, `x[0]`, `x[1]` or `x[0,1]` for the components of an array."""
    if leaf.shape == ():
        return (leaf.name,)
    return tuple(f"{leaf.name}[{','.join(map(str, index))}]" for index in np.ndindex(leaf.shape))


def topological(roots: Iterable[Expr]) -> list[Expr]:
    """All distinct nodes under `roots`, arguments first; equal expressions are one node."""
    order: dict[bytes, Expr] = {}
    stack: list[tuple[Expr, bool]] = [(root, False) for root in reversed(list(roots))]
    while stack:
        node, expanded = stack.pop()
        if node.digest in order:
            continue
        if expanded:
            order[node.digest] = node
        else:
            stack.append((node, True))
            stack.extend((arg, False) for arg in reversed(node.args))
    return list(order.values())


def leaves(roots: Iterable[Expr]) -> Iterator[Expr]:
    """The variables, constants and readings under `roots`, each once."""
    return (node for node in topological(roots) if not node.args)
