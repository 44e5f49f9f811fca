"""The constraint network: named variables with domains, readings known only to a set, constraints.

A point x solves the network when THERE EXISTS one value of every reading in its set such that every
element of every constraint is defined and holds; elements of arrays that no constraint takes need not be defined.
(Constants are exact numbers; an interval constant is an enclosure of one, and whatever is claimed holds for every
number in it.)
"""

import hashlib
import itertools
import math
import operator
from collections.abc import Callable, Hashable, Iterable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Self, TypeVar

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import ArrayLike, Indices, Names, Shape
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.interval.box import checked_name, component_names, has_points
from cpcal.solver.interval.numbers import float_bounds
from cpcal.solver.network.expression import Constraint, Expr, as_expr, pair, topological

Domain = Interval | tuple[ArrayLike, ArrayLike]

T = TypeVar("T")

_KEPT = 16  # things made of one network
_NOTHING = Box((), [], [])
_numbers = itertools.count(1)  # of networks without a name, for messages


class ConstraintNetwork:
    """Variables, readings and constraints, in the order in which they were added. `name` is for messages alone."""

    def __init__(self, name: str = "") -> None:
        self.name = checked_name(name or f"network {next(_numbers)}")
        self._variables = dict[str, Expr]()
        self._domains = list[Box]()
        self._domain = _NOTHING  # of the variables when it was last asked for
        self._owner = dict[str, str]()  # of every component's name, the variable
        self._constraints = list[Constraint]()
        self._made = dict[Hashable, Any]()  # the last few things that were made of it, by what they depend on

    def variable(self, name: str, shape: int | Shape = (), domain: Domain = (-np.inf, np.inf)) -> Expr:
        """A new unknown; components of an array are called `name[0]`, `name[1,2]`, in boxes.

        `domain` is an Interval or a pair of bounds that broadcast to `shape`. Raises ModelError for a name that is
        taken, a shape without elements and a domain without numbers.
        """
        if name in self._variables:
            raise ModelError(f"a variable needs a name of its own: {name!r} is taken in {self.name!r}")
        try:
            sizes = tuple(map(operator.index, shape if isinstance(shape, (tuple, list)) else (shape,)))
        except TypeError:
            sizes = (0,)
        if any(size < 1 for size in sizes) or isinstance(shape, bool):  # a domain, which comes third, is the usual slip
            raise ModelError(
                f"{shape!r} is no shape of {name!r}: give one or more positive integers; "
                f"a domain is written variable({name!r}, domain=(lower, upper))"
            )
        leaf = Expr("variable", shape=sizes, name=checked_name(name), owner=self.name)
        taken = [self._owner[part] for part in component_names(leaf) if part in self._owner]
        if taken:
            raise ModelError(f"components of {name!r} would be called like those of {taken[0]!r}: rename one of both")
        self._domains.append(_domain(leaf, domain))
        self._variables[name] = leaf
        self._owner |= dict.fromkeys(component_names(leaf), name)
        return leaf

    constant = staticmethod(as_expr)

    @staticmethod
    def reading(center: ArrayLike, radius: ArrayLike) -> Expr:
        """A measured quantity known to lie within `radius` of `center`: THERE EXISTS a value in that set.

        The leading axis counts measurements (a scalar reading is shared by all of them). Where every
        radius is zero this is a constant.
        """
        try:
            values = IntervalArray.around(center, radius)
        except ValueError:
            raise ModelError("the shapes of centres and radii of a reading do not fit") from None
        least, most = float_bounds(radius)
        if not np.all(np.isfinite(values.lo) & np.isfinite(values.hi) & (least >= 0)):
            raise ModelError("a reading needs finite centres and finite, non-negative radii")
        return Expr("reading" if most.any() else "constant", shape=values.shape, data=values)

    def add(self, constraint: Constraint | Iterable[Constraint]) -> None:
        """Require a constraint (or several). Raises ModelError, and adds none, if one is of another network."""
        listed = isinstance(constraint, Iterable) and not isinstance(constraint, (Expr, str))
        items: list[Any] = list(constraint) if listed else [constraint]  # type: ignore[arg-type]
        for item in items:
            if not isinstance(item, Constraint):
                raise ModelError(f"add() takes constraints, not {item!r}: use ==, <=, >= or .within()")
            self.check_owner(*item.parts)
        self._constraints += items

    def check_owner(self, *roots: Expr) -> None:
        """Raises ModelError where one of the expressions holds a variable of another network (copies have the same)."""
        for leaf in topological(roots):
            own = self._variables.get(leaf.name)
            if leaf.op == "variable" and (own is None or leaf.digest != own.digest):
                raise ModelError(
                    f"variable {leaf.name!r} belongs to another network, {leaf.owner!r}, not to {self.name!r}: build "
                    f"each expression from the variables of one network (name them: Network(name=...))"
                )

    def check_box(self, box: object) -> None:
        """Raises ModelError for anything but a box of this network's components, in their order."""
        if not isinstance(box, Box) or box.names != self.names:
            given = f"a box of {', '.join(box.names)}" if isinstance(box, Box) else repr(box)
            raise ModelError(f"{given} is no box of {self.name!r}, whose components are {', '.join(self.names)}")

    def without_constraints(self) -> Self:
        """A new network with the same variables and domains and no constraints yet."""
        other = copy(self)
        other._constraints, other._made = [], {}
        return other

    @property
    def variables(self) -> tuple[Expr, ...]:
        return tuple(self._variables.values())

    def __str__(self) -> str:
        lines = [f"{name} in {self.domain[name]}" for name in self.names]
        return "\n".join([f"{self.name}:", *lines, *map(str, self._constraints)])

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        return tuple(self._constraints)

    @property
    def names(self) -> Names:
        """Component names of the flattened variables: the names in a `Box`."""
        return tuple(self._owner)

    @property
    def places(self) -> dict[bytes, Indices]:
        """Of each variable, by its digest, where its components stand in a box, in its shape."""
        ends = np.cumsum([0, *(leaf.size for leaf in self.variables)])
        parts = zip(self.variables, ends, ends[1:], strict=False)
        return {leaf.digest: np.arange(start, end).reshape(leaf.shape) for leaf, start, end in parts}

    @property
    def domain(self) -> Box:
        """The box of all variables' domains."""
        if len(self._domain) < len(self._owner):
            lo, hi = (np.concatenate([getattr(box, side) for box in self._domains]) for side in ("lo", "hi"))
            self._domain = Box(self.names, lo, hi)
        return self._domain

    def component(self, expr: Expr) -> str:
        """The name in a box of a variable, or of one element of it. Raises ModelError for others."""
        if isinstance(expr, Expr) and expr.shape == ():
            leaf, position = (expr.args[0], int(expr.places)) if expr.op == "index" else (expr, 0)
            if leaf.op == "variable":
                self.check_owner(leaf)
                return component_names(leaf)[position]
        raise ModelError(f"{expr!r} is not a scalar variable of this network")

    @property
    def digest(self) -> str:
        """SHA-256 over variables, domains and constraints, in order; the same for networks built alike."""
        hasher = hashlib.sha256(repr(self.names).encode())
        hasher.update(self.domain.lo.tobytes() + self.domain.hi.tobytes())
        roots = [expr for c in self._constraints for expr in c.parts]
        number = dict[bytes, int]()
        for node in topological(roots):
            args = tuple(number[arg.digest] for arg in node.args)
            number[node.digest] = len(number)
            hasher.update(repr((node.op, node.shape, node.parameter, node.name, args)).encode())
            for array in (node.data.lo, node.data.hi, node.places.astype(np.int64)):
                hasher.update(array.tobytes())
        hasher.update(repr([number[expr.digest] for expr in roots]).encode())
        return hasher.hexdigest()

    def once(self, what: Hashable, make: Callable[[], T]) -> T:
        """What `make` gives for the network as it is now: made once for it and its copies, under the name `what`.

        For what contractors, choices and proofs all need, and only read: tapes, which take long where there are
        thousands of constraints.
        """
        parts = [part.digest for c in self._constraints for part in c.parts]
        box = self.domain
        key = (what, self.names, box.lo.tobytes(), box.hi.tobytes(), *parts)
        found = self._made.get(key)
        if found is None:
            self._made[key] = found = make()
            for oldest in list(self._made)[:-_KEPT]:
                self._made.pop(oldest, None)
        return found

    def __copy__(self) -> Self:
        """With containers of its own: what is added to one is not added to the other. What was made, they share."""
        other = object.__new__(type(self))
        other.__dict__ |= {key: value if key == "_made" else copy(value) for key, value in self.__dict__.items()}
        return other

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_made": {}}

    def __repr__(self) -> str:
        count = sum(c.body.size for c in self._constraints)
        return f"<{type(self).__name__}: {len(self.names)} unknowns, {count} constraints>"


def _domain(leaf: Expr, domain: Domain) -> Box:
    """The box of one variable. Raises ModelError where it holds no number or does not fit the shape."""
    lower, upper = (domain.lo, domain.hi) if isinstance(domain, Interval) else pair(domain, "a domain")
    try:
        lo = np.broadcast_to(float_bounds(lower)[0], leaf.shape).ravel()
        hi = np.broadcast_to(float_bounds(upper)[1], leaf.shape).ravel()
    except ValueError:
        raise ModelError(f"the domain of {leaf.name!r} does not fit its shape {leaf.shape}") from None
    if not has_points(lo, hi).all():
        raise ModelError(f"the domain of {leaf.name!r} holds no number: give (lower, upper) with lower <= upper")
    return Box(component_names(leaf), lo, hi)


# ------------------------------------------------------------------------------------------------------------------
# A network with some of its measurements: the same constraints, fewer elements of each.


def restricted(network: ConstraintNetwork, keep: Sequence[Indices]) -> ConstraintNetwork:
    """The network with, of each constraint, only the elements `keep[c]` along its leading axis.

    What is computed per measurement is computed for those alone. Dropping elements loses no solution.
    """
    smaller = network.without_constraints()
    for constraint, rows in zip(network.constraints, keep, strict=True):
        if not constraint.body.shape:
            smaller.add(constraint)
        elif rows.size:
            along = (constraint.body.ndim, constraint.body.shape[0])
            parts = ((part, (part.ndim, *part.shape[:1]) == along) for part in constraint.parts)
            smaller.add(Constraint(*(select(part, rows) if has_rows else part for part, has_rows in parts)))
    return smaller


def select(root: Expr, rows: Indices) -> Expr:
    """`root[rows]`, with the selection moved down to the leaves as far as it goes."""
    nodes, wanted = topological((root,)), {root.digest}  # whose leading axis is the one that is selected from
    for node in reversed(nodes):
        if node.digest in wanted:
            wanted.update(arg.digest for arg in node.args if passes_down(node, arg, rows))
    done = dict[bytes, Expr]()
    for node in nodes:
        if node.digest in wanted:
            done[node.digest] = _selected(node, rows, done)
    return done[root.digest]


def passes_down(node: Expr, arg: Expr, rows: Indices | slice = slice(None)) -> bool:
    """Whether element k of the node, for each k of these rows, is computed from row k of the argument alone."""
    if not arg.shape or not node.shape or arg.shape[0] != node.shape[0]:
        return False
    if node.op == "sum":
        return node.parameter > 0
    if node.op == "index":
        row = node.places.reshape((node.shape[0], -1))[rows] // math.prod(arg.shape[1:])  # of the argument
        return bool((row == np.arange(node.shape[0])[rows, None]).all())
    return arg.ndim == node.ndim


def _selected(node: Expr, rows: Indices, done: dict[bytes, Expr]) -> Expr:
    shape = (len(rows), *node.shape[1:])
    if node.op in ("constant", "reading"):
        return replace(node, shape=shape, data=node.data[rows])
    if not node.args or (node.op == "sum" and node.parameter == 0):  # of all rows: select from the result
        return node[rows]
    below = tuple(done[arg.digest] if passes_down(node, arg, rows) else arg for arg in node.args)
    if node.op != "index":
        return replace(node, args=below, shape=shape)
    chosen = node.places.reshape((node.shape[0], -1))[rows]
    if passes_down(node, node.args[0], rows):
        width = math.prod(node.args[0].shape[1:])
        chosen = np.arange(len(rows))[:, None] * width + chosen % width
    return replace(node, args=below, shape=shape, places=chosen.reshape(shape))
