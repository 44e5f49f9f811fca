"""The worth of Minibex's expressions, by the names that are known where they stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.errors import CpcalError, InputError, ModelError, shown
from cpcal.problems.minibex_read import (
    DEEPEST,
    File,
    Function,
    Loop,
    Parser,
    Relation,
    Source,
    Symbol,
    SyntaxNode,
    Token,
)
from cpcal.problems.minibex_values import (
    FORMS,
    FUNCTIONS,
    MOST,
    RESERVED,
    Data,
    Value,
    applied,
    array_of,
    as_operand,
    indexed,
    interval_of,
    is_row,
    minus,
    negative,
    over,
    pairs,
    plus,
    power,
    stacked,
    times,
    transposed,
)
from cpcal.problems.problem import StatedProblem
from cpcal.solver.interval import Interval
from cpcal.solver.model import Network
from cpcal.solver.network import Constraint, Expr
from cpcal.solver.network.mathematics import floor

Names = Mapping[str, Value]

PI = Interval(3.141592653589793, 3.1415926535897936)
_BINARY: dict[str, Callable[[Value, Value], Value]] = {"+": plus, "-": minus, "*": times, "/": over, "^": power}
_UNARY: dict[str, Callable[[Value], Value]] = {"negative": negative, "transposed": transposed}


class Evaluator:
    """Functions see `constants` and their inputs, nothing else. Every error is an InputError with line and column."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.constants: dict[str, Value] = {"pi": PI, "oo": Data(Interval(np.finfo(float).max, np.inf))}
        self.functions: dict[str, Function] = {}
        self.used: set[str] = set()  # names that were asked for
        self.depth = 0

    def value(self, node: SyntaxNode, names: Names) -> Value:
        with Placed(self.source, node.token):
            return self.worth(node, names)

    def worth(self, node: SyntaxNode, names: Names) -> Value:
        if node.kind == "number":
            return Fraction(node.token.value)
        if node.kind == "name":
            return self.named(node.token, names)
        if node.kind in _BINARY:
            return self.chain(node, names)
        if node.kind in _UNARY:
            return _UNARY[node.kind](self.value(node.parts[0], names))
        if node.kind in ("row", "column"):
            return stacked([self.value(part, names) for part in node.parts], row=node.kind == "row")
        if node.kind in ("interval", "ball"):
            low, high = (interval_of(self.value(part, names)) for part in node.parts)
            return Data(_between(low, high) if node.kind == "interval" else low + Interval(-high.hi, high.hi))
        if node.kind == "sum":
            return self.total(node, names)
        return self.indexed_or_called(node, names)

    def chain(self, node: SyntaxNode, names: Names) -> Value:
        """A sum or product of any length, from its left end: no call for each of its signs."""
        signs = []
        while node.kind in _BINARY:
            signs.append(node)
            node = node.parts[0]
        found = self.value(node, names)
        for sign in reversed(signs):
            right = self.value(sign.parts[1], names)
            with Placed(self.source, sign.token):
                found = _BINARY[sign.kind](found, right)
        return found

    def named(self, token: Token, names: Names) -> Value:
        if token.text not in names:
            raise self.source.wrong(f"{shown(token.text)} is not declared", "declare it before it is used", token)
        self.used.add(token.text)
        return names[token.text]

    def scalar(self, node: SyntaxNode, names: Names) -> Expr:
        value = as_operand(self.value(node, names))
        if not isinstance(value, Expr):
            raise self.source.wrong("a number that depends on a variable must stand here", "write one", node.token)
        return value

    def whole(self, node: SyntaxNode, names: Names) -> int:
        value = self.value(node, names)
        if not isinstance(value, Fraction) or value.denominator != 1:
            raise self.source.wrong("a whole number must stand here", "write one, or a name of one", node.token)
        return int(value)

    def total(self, node: SyntaxNode, names: Names) -> Value:
        name, value = node.parts[0].token, None
        for k in self.turns(name, node.parts[1], node.parts[2], names):
            entry = self.value(node.parts[3], {**names, name.text: Fraction(k)})
            value = entry if value is None else plus(value, entry)
        return Fraction(0) if value is None else value

    def turns(self, name: Token, first: SyntaxNode, last: SyntaxNode, names: Names) -> range:
        """Of a loop or a sum."""
        start, end = self.whole(first, names), self.whole(last, names)
        if end - start >= MOST:
            raise self.source.wrong(f"{end - start + 1:,} turns", f"give at most {MOST:,}", name)
        return range(start, end + 1)

    def indexed_or_called(self, node: SyntaxNode, names: Names) -> Value:
        head, *places = node.parts
        if node.kind == "call or index" and head.token.text not in names:
            return self.called(node.token, [self.value(place, names) for place in places])
        array = self.value(head, names)
        if not isinstance(array, np.ndarray):
            raise self.source.wrong("a number has no index", "take it out", node.token)
        row = is_row(array) and len(places) == 1
        if len(places) > array.ndim:
            raise self.source.wrong(f"{len(places)} indices for {array.ndim} dimensions", "give fewer", node.token)
        sides = array.shape[1:] if row else array.shape
        return indexed(array, tuple(self.place(p, names, n, node) for p, n in zip(places, sides, strict=False)))

    def place(self, node: SyntaxNode, names: Names, side: int, of: SyntaxNode) -> int | slice:
        base = 0 if of.from_zero else 1
        ends = node.parts if node.kind == "range" else (node, node)
        first, last = (self.whole(end, names) for end in ends) if ends else (base, side - 1 + base)
        if not base <= first <= last <= side - 1 + base:
            what = f"the index {first if first == last else f'{first}:{last}'} is not from {base} to {side - 1 + base}"
            raise self.source.wrong(what, "x(1) and x[0] are the first", node.token)
        return slice(first - base, last - base + 1) if node.kind == "range" else first - base

    def called(self, token: Token, arguments: list[Value]) -> Value:
        if token.text in FUNCTIONS:
            return applied(token.text, arguments)
        if token.text in FORMS:
            return FORMS[token.text](arguments)
        if token.text not in self.functions:
            raise self.source.wrong(f"{shown(token.text)} is no function", "declare it, or correct the name", token)
        function = self.functions[token.text]
        if len(arguments) != len(function.inputs):
            what = f"{token.text} takes {len(function.inputs)} arguments, not {len(arguments)}"
            raise self.source.wrong(what, "give as many", token)
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.source.wrong("functions call one another without end", "take the circle out", token)
        inputs = {symbol.token.text: value for symbol, value in zip(function.inputs, arguments, strict=True)}
        local: dict[str, Value] = {**self.constants, **inputs}
        for step, expression in function.steps:
            local[step.text] = self.value(expression, local)
        found = self.value(function.result, local)
        self.depth -= 1
        return found


class Placed:
    """Gives the token's place to an error of the solver's modelling layer."""

    def __init__(self, source: Source, token: Token) -> None:
        self.source, self.token = source, token

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, InputError):
            return
        if isinstance(error, (CpcalError, OverflowError, ZeroDivisionError, ValueError)):
            raise self.source.wrong(str(error).splitlines()[0][:200], "correct the expression", self.token) from None


def _between(low: Interval, high: Interval) -> Interval:
    """From the one to the other; `oo` on its side has no bound."""
    lo = -np.inf if low.hi <= -np.finfo(float).max else low.lo
    hi = np.inf if high.lo >= np.finfo(float).max else high.hi
    return Interval(lo, hi)


# ------------------------------------------------------------------------------------------------------------------
# What a Minibex file means: its tree becomes a network, and an objective where there is one.

_CONSTRAINTS_MOST = 100_000
_EVERYTHING = Data(Interval(-np.inf, np.inf))


def read_minibex(text: str, where: str) -> StatedProblem:
    """The problem in a text called `where`. Raises InputError that names line and column.

    Numbers are the float64 nearest to their decimal text; quotients and whole powers of numbers are exact. An interval
    that is declared as data means THERE EXISTS a value of it at each place where it is written. "<" is read as "<=".
    """
    source = Source(text, where)
    return _Meaning(source, Parser(source).file()).problem()


class _Meaning:
    """Builds the problem of one file."""

    def __init__(self, source: Source, file: File) -> None:
        self.source, self.file, self.evaluator = source, file, Evaluator(source)
        self.temporary: dict[str, Token] = {}  # names that are set in the constraints

    def problem(self) -> StatedProblem:
        known, network = self.evaluator, Network(Path(self.source.where).stem or "problem")
        for symbol in self.file.constants:
            self.new(symbol.token, known.constants)
            known.constants[symbol.token.text] = self.constant(symbol)
        names = dict(known.constants)
        for symbol in self.file.variables:
            self.new(symbol.token, names)
            names[symbol.token.text] = self.variable(symbol, network)
        for symbol in self.file.parameters:
            self.new(symbol.token, names)
            names[symbol.token.text] = self.constant(symbol) if symbol.thin else self.parameter(symbol, network)
        for function in self.file.functions:
            self.new(function.token, {**names, **known.functions})
            known.functions[function.token.text] = function
        goal = None if self.file.goal is None else known.scalar(self.file.goal, names)
        for count, (relation, scope) in enumerate(self.relations(self.file.blocks, names)):
            if count == _CONSTRAINTS_MOST:
                what = f"there are more than {_CONSTRAINTS_MOST:,} constraints"
                raise self.source.wrong(what, "write fewer", relation.sign)
            with Placed(self.source, relation.sign):
                network.add(self.constraint(relation, scope, network))
        self.check_used()
        whole = tuple(name for name, is_whole in zip(network.names, network.whole, strict=True) if is_whole)
        return StatedProblem(network, goal, integer=whole)

    def new(self, token: Token, names: Any) -> None:
        if token.text in names or token.text in RESERVED:
            raise self.source.wrong(f"{shown(token.text)} is there already", "choose another name", token)

    # declarations -----------------------------------------------------------------------------

    def dimensions(self, symbol: Symbol) -> tuple[int, ...]:
        shape = tuple(self.evaluator.whole(node, self.evaluator.constants) for node in symbol.dimensions)
        if any(side < 1 for side in shape) or int(np.prod(shape, dtype=object)) > MOST:
            what = f"{symbol.token.text} has the dimensions {shape}"
            raise self.source.wrong(what, f"give whole numbers from 1, and at most {MOST:,} entries", symbol.token)
        return shape

    def constant(self, symbol: Symbol) -> Value:
        assert symbol.value is not None  # the grammar asks for one
        shape, value = self.dimensions(symbol), self.evaluator.value(symbol.value, self.evaluator.constants)
        with Placed(self.source, symbol.token):
            spread = self.spread(symbol, value, shape)
            entries = spread if symbol.thin else [_data(interval_of(entry)) for entry in spread]
        return array_of(entries, shape) if shape else entries[0]

    def variable(self, symbol: Symbol, network: Network) -> Value:
        shape = self.dimensions(symbol)
        value: Value = _EVERYTHING
        if symbol.value is not None:
            value = self.evaluator.value(symbol.value, self.evaluator.constants)
        with Placed(self.source, symbol.token):
            bounds = [interval_of(entry) for entry in self.spread(symbol, value, shape)]
            lo, hi = (np.array([getattr(b, end) for b in bounds]).reshape(shape) for end in ("lo", "hi"))
            leaf = network.variable(symbol.token.text, shape=shape, domain=(lo, hi))
        return array_of([leaf[k] for k in np.ndindex(shape)], shape) if shape else leaf

    def parameter(self, symbol: Symbol, network: Network) -> Value:
        """Numbers known to lie within bounds: THERE EXISTS a value of each, the same wherever it stands."""
        assert symbol.value is not None  # the grammar asks for one
        shape, value = self.dimensions(symbol), self.evaluator.value(symbol.value, self.evaluator.constants)
        with Placed(self.source, symbol.token):
            bounds = [interval_of(entry) for entry in self.spread(symbol, value, shape)]
            entries = [network.parameter((b.lo, b.hi), forall=False) for b in bounds]
        return array_of(entries, shape) if shape else entries[0]

    def spread(self, symbol: Symbol, value: Value, shape: tuple[int, ...]) -> list[Any]:
        """The entries of a value of that shape; one number stands for all."""
        if not isinstance(value, np.ndarray):
            return [value] * int(np.prod(shape, dtype=int))
        told = shape if value.shape == (1, *shape) else value.shape  # a row and a column of one length
        if told != shape:
            what = f"{symbol.token.text} has the dimensions {shape} and a value of {value.shape}"
            raise self.source.wrong(what, "give a value of its size", symbol.token)
        return list(value.ravel())

    # constraints ------------------------------------------------------------------------------

    def relations(self, blocks: tuple[Relation | Loop, ...], names: Names) -> Iterator[tuple[Relation, Names]]:
        names = dict(names)
        for block in blocks:
            if isinstance(block, Relation):
                new = self.new_name(block, names)
                if new is None:
                    yield block, names
                else:
                    assert block.right is not None
                    names[new.text] = self.evaluator.value(block.right, names)
                    self.temporary[new.text] = new
                continue
            for k in self.evaluator.turns(block.name, block.first, block.last, names):
                yield from self.relations(block.blocks, {**names, block.name.text: Fraction(k)})

    def new_name(self, relation: Relation, names: Names) -> Token | None:
        """What stands alone on the left of = and has no meaning yet gets one."""
        token = relation.left.token
        plain = relation.left.kind == "name" and relation.sign.text == "=" and token.text not in names
        return token if plain and token.text not in self.evaluator.functions else None

    def check_used(self) -> None:
        """A name that is set in the constraints and nowhere used is a slip of the pen."""
        for name, token in self.temporary.items():
            if name not in self.evaluator.used:
                what = f"{shown(name)} is set here and used nowhere"
                raise self.source.wrong(what, "correct the name of the variable, or take the line out", token)

    def constraint(self, relation: Relation, names: Names, network: Network) -> list[Constraint]:
        left = self.evaluator.value(relation.left, names)
        if relation.right is None:
            return [c for entry in np.ravel(np.asarray(left, dtype=object)) for c in self.whole(entry, network)]
        right = self.evaluator.value(relation.right, names)
        if relation.sign.text == "in":
            return [self.within(*parts) for parts in pairs(left, right)]
        difference, out = minus(left, right), []
        for entry in difference.ravel() if isinstance(difference, np.ndarray) else [difference]:
            body = as_operand(entry)
            if not isinstance(body, Expr):
                raise self.source.wrong("a constraint without a variable", "take it out", relation.sign)
            sign = relation.sign.text[0]
            out.append(body <= 0.0 if sign == "<" else body >= 0.0 if sign == ">" else body == 0.0)
        return out

    @staticmethod
    def within(value: Value, bounds: Value) -> Constraint:
        """An expression in an interval of constants."""
        body, inside = as_operand(value), interval_of(bounds)
        if not isinstance(body, Expr):
            raise ModelError("a constraint without a variable")
        return body.within((inside.lo, inside.hi))

    @staticmethod
    def whole(value: Value, network: Network) -> list[Constraint]:
        """`integer(...)`: of a variable a property of it, of an expression an equation."""
        body = as_operand(value)
        if not isinstance(body, Expr):
            raise ModelError("integer() of a number says nothing of a variable")
        if body.op == "variable" or (body.op == "index" and body.args[0].op == "variable"):
            network.require_whole(body)
            return []
        return [floor(body) - body == 0.0]


def _data(bounds: Interval) -> Interval | Data:
    return bounds if bounds.lo == bounds.hi else Data(bounds)
