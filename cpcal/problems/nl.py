"""AMPL's .nl files in their text form (header "g"), as AMPL, JuMP and Pyomo write them.

D. M. Gay, Writing .nl files (Sandia report SAND2005-7907P); segments are told by their first letter.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce

import numpy as np

from cpcal.common.errors import CpcalError, InputError, shown, unusable
from cpcal.common.values import Floats, Pair
from cpcal.problems.values import (
    StatedProblem,
    Value,
    applied,
    as_operand,
    divided,
    minus,
    negative,
    plus,
    power,
    times,
)
from cpcal.solver.model import Network
from cpcal.solver.network import Expr

MOST = 100_000  # variables, and constraints
_HEADER = 10  # lines
_DEEPEST = 500

_BINARY: dict[int, Callable[[Value, Value], Value]] = {
    0: plus,
    1: minus,
    2: times,
    3: divided,
    5: power,
    76: power,
    48: lambda x, y: applied("atan2", [x, y]),
}
_UNARY: dict[int, Callable[[Value], Value]] = {
    16: negative,
    42: lambda x: divided(applied("log", [x]), applied("log", [Fraction(10)])),
    77: lambda x: power(x, Fraction(2)),
}
_NAMED = {15: "abs", 37: "tanh", 38: "tan", 39: "sqrt", 40: "sinh", 41: "sin", 43: "log"}
_NAMED |= {44: "exp", 45: "cosh", 46: "cos", 47: "atanh", 49: "atan", 50: "asinh", 51: "asin", 52: "acosh", 53: "acos"}
_ZERO: Value = Fraction(0)
_LISTS = {11: "min", 12: "max", 54: "sum"}
_BOUNDS = {"0": 2, "1": 1, "2": 1, "3": 0, "4": 1}  # both ends, an upper one, a lower one, none, one number

Terms = list[tuple[int, Fraction]]


def read_nl(text: str, where: str) -> StatedProblem:
    """The problem in the text of a file called `where`: variables are x[0], x[1], ... in the file's order.

    Numbers are the float64 nearest to their decimal text. Raises InputError that names the line.
    """
    reader = _Reader(text.splitlines(), where)
    try:
        return reader.problem()
    except InputError:
        raise
    except (CpcalError, ValueError, IndexError, OverflowError, RecursionError) as error:
        what = f"is not understood here ({(str(error).splitlines() or [''])[0][:120]})"
        raise reader.wrong(what, "write the file anew, or the problem without it") from None


class _Reader:
    """`at` is the number of lines that were taken."""

    def __init__(self, lines: Sequence[str], where: str) -> None:
        self.lines, self.where, self.at = lines, where, 0
        self.variables: list[Expr] = []
        self.defined: dict[int, Value] = {}  # common expressions, by number
        self.bodies: dict[int, Value] = {}  # nonlinear parts of constraints
        self.goals: dict[int, tuple[bool, Value]] = {}  # whether the largest is asked for
        self.linear: dict[str, dict[int, Terms]] = {"J": {}, "G": {}}  # parts of constraints, of objectives
        self.row_bounds: list[Pair] = []

    def problem(self) -> StatedProblem:
        if not self.lines or not self.lines[0].startswith("g"):
            raise self.wrong("is no text form of .nl", "write it with option g: presolve off, text")
        if len(self.lines) < _HEADER:
            raise self.wrong("ends in its header", "write it anew")
        counts = [self.numbers(k) for k in range(1, _HEADER)]
        if len(counts[0]) < 3 or not all(0 <= size <= MOST for size in counts[0][:3]):
            raise self.wrong("states no sizes, or too large ones", f"at most {MOST:,} variables and constraints")
        self.count, self.rows, objectives = counts[0][:3]
        if any(counts[5]):
            self.at = 7
            raise self.wrong("has whole-number variables", "cpcal solves for real numbers: relax them")
        self.at = 0
        if not self.count:
            raise self.wrong("has no variables", "give a problem with some")
        network, (lo, hi) = Network("problem"), self.bounds_ahead()
        self.variables = list(network.variable("x", shape=self.count, domain=(lo, hi)))
        self.at = _HEADER
        while self.at < len(self.lines):
            self.segment()
        for k in range(self.rows):
            low, high = self.row_bounds[k] if k < len(self.row_bounds) else (-math.inf, math.inf)
            body = self.whole_form("J", k, self.bodies.get(k, _ZERO))
            if low > -math.inf or high < math.inf:
                network.add(body.within((low, high)))
        if objectives > 1:
            raise self.wrong("has more than one objective", "choose one")
        if 0 not in self.goals:
            return StatedProblem(network)
        largest, goal = self.goals[0]
        return StatedProblem(network, self.whole_form("G", 0, goal), largest)

    # lines ------------------------------------------------------------------------------------

    def next(self) -> str:
        if self.at >= len(self.lines):
            raise self.wrong("ends in the midst of a segment", "write the file anew")
        self.at += 1
        return self.lines[self.at - 1].partition("#")[0].strip()

    def numbers(self, k: int) -> list[int]:
        self.at = k
        try:
            return [int(word) for word in self.next().split()]
        except ValueError:
            raise self.wrong("holds what is no whole number", "write the file anew") from None

    def bound(self) -> Pair:
        kind, *values = self.next().split()
        value = [float(_finite(word)) for word in values]
        if len(value) != _BOUNDS.get(kind):
            raise self.wrong("states no bounds that are understood", "write it without complementarity")
        if kind == "0":
            return value[0], value[1]
        single = value[0] if value else math.inf
        return (single if kind in ("2", "4") else -math.inf), (single if kind in ("1", "4") else math.inf)

    def terms(self, count: int) -> Terms:
        """So many lines of a variable's number and its factor."""
        pairs = [self.next().split() for _ in range(count)]
        return [(int(number), Fraction(_finite(value))) for number, value in pairs]

    def wrong(self, what: str, remedy: str) -> InputError:
        line = min(max(self.at, 1), max(len(self.lines), 1))
        return unusable(self.where, what, remedy, line)

    # the header -------------------------------------------------------------------------------

    def bounds_ahead(self) -> Floats:
        """The segment of the variables' bounds, which stands behind those that need the variables."""
        pairs = [(-math.inf, math.inf)] * self.count
        for k in range(_HEADER, len(self.lines)):
            if self.lines[k].startswith("b"):
                self.at = k + 1
                pairs = [self.bound() for _ in range(self.count)]
                break
        return np.array(pairs).T

    # segments ---------------------------------------------------------------------------------

    def segment(self) -> None:
        line = self.next()
        kind, told = line[:1], line[1:].split()
        if kind == "C":
            self.bodies[int(told[0])] = self.expression()
        elif kind == "O":
            self.goals[int(told[0])] = (int(told[1]) == 1, self.expression())
        elif kind == "V":  # a common expression: linear terms, then the rest
            terms = self.terms(int(told[1]))
            self.defined[int(told[0])] = plus(self.expression(), self.linear_form(terms))
        elif kind in self.linear:
            self.linear[kind][int(told[0])] = self.terms(int(told[1]))
        elif kind == "r":
            self.row_bounds = [self.bound() for _ in range(self.rows)]
        elif kind == "b":
            self.at += self.count  # read already
        elif kind in ("x", "d", "k", "S"):  # the start, duals, column counts, suffixes: so many lines
            self.at += int(told[1] if len(told) > 1 else told[0])
        elif kind:
            raise self.wrong(f"{shown(line[:20])} begins no segment that is understood", "write it without suffixes")

    def linear_form(self, terms: Terms) -> Value:
        found = [times(factor, self.named(number)) for number, factor in terms if factor]
        return reduce(plus, found, _ZERO)

    def whole_form(self, kind: str, k: int, rest: Value) -> Expr:
        """A constraint's body, or an objective."""
        body = as_operand(plus(rest, self.linear_form(self.linear[kind].get(k, []))))
        return body if isinstance(body, Expr) else self.variables[0] * 0.0 + body

    def named(self, number: int) -> Value:
        if 0 <= number < self.count:
            return self.variables[number]
        if number not in self.defined:
            raise self.wrong(f"names the variable {number}, which is not there", "write the file anew")
        return self.defined[number]

    def expression(self, depth: int = 0) -> Value:
        """Polish notation, an operand a line."""
        if depth > _DEEPEST:
            raise self.wrong(f"is nested more than {_DEEPEST} deep", "define common parts as variables")
        line = self.next()
        kind, told = line[:1], line[1:].strip()
        if kind == "n":
            return Fraction(_finite(told))
        if kind in ("s", "l"):
            return Fraction(int(told))
        if kind == "v":
            return self.named(int(told))
        if kind != "o":
            what = f"{shown(line[:20])} begins no expression that is understood"
            raise self.wrong(what, "write the problem without it")
        code = int(told)
        if code in _LISTS:
            parts = [self.expression(depth + 1) for _ in range(int(self.next()))]
            return reduce(plus, parts, _ZERO) if _LISTS[code] == "sum" else applied(_LISTS[code], parts)
        if code not in {*_BINARY, *_UNARY, *_NAMED}:
            raise self.wrong(f"the operation o{code} is not understood", "write the problem without it")
        first = self.expression(depth + 1)
        if code in _NAMED:
            return applied(_NAMED[code], [first])
        if code in _UNARY:
            return _UNARY[code](first)
        return _BINARY[code](first, self.expression(depth + 1))


def _finite(word: str) -> float:
    value = float(word)
    if math.isnan(value):
        raise ValueError("nan")
    return value
