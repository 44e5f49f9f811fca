"""The worth of Minibex's expressions, by the names that are known where they stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from cpcal.common.errors import CpcalError, InputError, shown
from cpcal.problems.minibex_arrays import indexed, is_row, stacked
from cpcal.problems.minibex_expressions import DEEPEST
from cpcal.problems.minibex_forms import FORMS
from cpcal.problems.minibex_tree import Function, SyntaxNode
from cpcal.problems.minibex_values import (
    FUNCTIONS,
    MOST,
    Data,
    Value,
    applied,
    as_operand,
    interval_of,
    minus,
    negative,
    over,
    plus,
    power,
    times,
    transposed,
)
from cpcal.problems.tokens import Source, Token
from cpcal.solver.interval import Interval
from cpcal.solver.network import Expr

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
