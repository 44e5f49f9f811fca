"""The lines of a .nl file, one after the other, with what each may hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from cpcal.common.errors import CpcalError, InputError, shown
from cpcal.common.errors import Problem as Wrong
from cpcal.problems.minibex_values import Value, applied, as_operand, minus, negative, over, plus, power, times
from cpcal.problems.problem import Answer, StatedProblem
from cpcal.solver.contract import Verdict
from cpcal.solver.model import Network
from cpcal.solver.network import Expr


class NlLines:
    """`at` is the number of lines that were taken."""

    def __init__(self, lines: Sequence[str], where: str) -> None:
        self.lines, self.where, self.at = lines, where, 0

    def next(self) -> str:
        if self.at >= len(self.lines):
            raise self.wrong("ends in the midst of a segment", "write the file anew")
        self.at += 1
        return self.code(self.lines[self.at - 1])

    @staticmethod
    def code(line: str) -> str:
        return line.partition("#")[0].strip()

    def numbers(self, k: int) -> list[int]:
        self.at = k + 1
        try:
            return [int(word) for word in self.code(self.lines[k]).split()]
        except ValueError:
            raise self.wrong("holds what is no whole number", "write the file anew") from None

    def bound(self) -> tuple[float, float]:
        kind, *values = self.next().split()
        value = [self.finite(word) for word in values]
        forms = {"0": 2, "1": 1, "2": 1, "3": 0, "4": 1}
        if kind not in forms or len(value) != forms[kind]:
            raise self.wrong("states no bounds that are understood", "write it without complementarity")
        if kind == "0":
            return value[0], value[1]
        single = value[0] if value else math.inf
        return (single if kind in ("2", "4") else -math.inf), (single if kind in ("1", "4") else math.inf)

    def finite(self, word: str) -> float:
        value = float(word)
        if math.isnan(value):
            raise ValueError("nan")
        return value

    def term(self) -> tuple[int, Fraction]:
        number, value = self.next().split()
        return int(number), Fraction(self.finite(value))

    def wrong(self, what: str, remedy: str) -> InputError:
        line = min(max(self.at, 1), max(len(self.lines), 1))
        return InputError([Wrong(self.where, what, remedy, line)])


# ------------------------------------------------------------------------------------------------------------------
# AMPL's .nl files in their text form (header "g"), as AMPL, JuMP and Pyomo write them, read into networks.
#
# D. M. Gay, Writing .nl files (Sandia report SAND2005-7907P); segments are told by their first letter.

MOST = 100_000  # variables, and constraints
_HEADER = 10  # lines
_DEEPEST = 500

_BINARY: dict[int, Callable[[Value, Value], Value]] = {0: plus, 1: minus, 2: times, 3: over, 5: power, 76: power}
_NAMED = {
    13: "floor",
    14: "ceil",
    15: "abs",
    37: "tanh",
    38: "tan",
    39: "sqrt",
    40: "sinh",
    41: "sin",
    43: "log",
    44: "exp",
    45: "cosh",
    46: "cos",
    47: "atanh",
    49: "atan",
    50: "asinh",
    51: "asin",
    52: "acosh",
    53: "acos",
}
_LISTS = {11: "min", 12: "max", 54: "sum"}
_KNOWN = {*_BINARY, *_NAMED, *_LISTS, 16, 42, 48, 77}  # and minus, log10, atan2, square


@dataclass
class _Parts:
    """What the segments say, before it becomes a network."""

    bodies: dict[int, Value] = field(default_factory=dict)  # nonlinear parts of constraints
    goals: dict[int, tuple[bool, Value]] = field(default_factory=dict)
    linear: dict[int, list[tuple[int, Fraction]]] = field(default_factory=dict)
    gradients: dict[int, list[tuple[int, Fraction]]] = field(default_factory=dict)
    row_bounds: list[tuple[float, float]] = field(default_factory=list)


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


class _Reader(NlLines):
    def __init__(self, lines: Sequence[str], where: str) -> None:
        super().__init__(lines, where)
        self.parts = _Parts()
        self.defined: dict[int, Value] = {}
        self.variables: list[Expr] = []

    def problem(self) -> StatedProblem:
        if not self.lines or not self.lines[0].startswith("g"):
            raise self.wrong("is no text form of .nl", "write it with option g: presolve off, text")
        if len(self.lines) < _HEADER:
            raise self.wrong("ends in its header", "write it anew")
        counts = [self.numbers(k) for k in range(1, _HEADER)]
        self.count, self.rows, self.objectives = (self.size(counts[0], k) for k in range(3))
        integer = self.integers(counts)
        whole = np.zeros(self.count, bool)
        whole[integer] = True
        lo, hi = self.bounds_ahead()
        network = Network("problem")
        self.at = 0
        if not self.count:
            raise self.wrong("has no variables", "give a problem with some")
        self.variables = list(network.variable("x", shape=self.count, domain=(lo, hi), integer=whole))
        self.at = _HEADER
        while self.at < len(self.lines):
            self.segment()
        self.state(network)
        goal = self.parts.goals.get(0)
        if self.objectives > 1:
            raise self.wrong("has more than one objective", "choose one")
        names = tuple(network.names[k] for k in integer)
        if goal is None:
            return StatedProblem(network, integer=names)
        body = as_operand(plus(goal[1], self.linear_form(self.parts.gradients.get(0, []))))
        return StatedProblem(
            network, body if isinstance(body, Expr) else self.variables[0] * 0.0 + body, goal[0], names
        )

    # the header -------------------------------------------------------------------------------

    def size(self, counts: Sequence[int], k: int) -> int:
        if k >= len(counts) or not 0 <= counts[k] <= MOST:
            raise self.wrong("states no sizes, or too large ones", f"at most {MOST:,} variables and constraints")
        return counts[k]

    def integers(self, counts: Sequence[Sequence[int]]) -> list[int]:
        """Which variables are whole numbers: the last of each group, by the order that the format asks for."""
        in_rows, in_goals, in_both = (*counts[3], 0, 0, 0)[:3]
        binary, whole, both, rows, goals = (*counts[5], 0, 0, 0, 0, 0)[:5]
        ends = (in_both, in_rows, max(in_goals, in_rows), self.count)
        return [
            k for end, n in zip(ends, (both, rows, goals, binary + whole), strict=True) for k in range(end - n, end)
        ]

    def bounds_ahead(self) -> tuple[np.ndarray, np.ndarray]:
        """The segment of the variables' bounds, which stands behind those that need the variables."""
        for k in range(_HEADER, len(self.lines)):
            if self.lines[k].startswith("b"):
                self.at = k + 1
                pairs = [self.bound() for _ in range(self.count)]
                return np.array([p[0] for p in pairs], float), np.array([p[1] for p in pairs], float)
        return np.full(self.count, -math.inf), np.full(self.count, math.inf)

    # segments ---------------------------------------------------------------------------------

    def segment(self) -> None:
        line = self.code(self.lines[self.at])
        kind, told = line[:1], line[1:].split()
        self.at += 1
        if not kind:
            return
        if kind not in _SEGMENTS:
            raise self.wrong(f"{shown(line[:20])} begins no segment that is understood", "write it without suffixes")
        _SEGMENTS[kind](self, told)

    def body(self, told: list[str]) -> None:
        self.parts.bodies[int(told[0])] = self.expression()

    def goal(self, told: list[str]) -> None:
        self.parts.goals[int(told[0])] = (int(told[1]) == 1, self.expression())

    def definition(self, told: list[str]) -> None:
        """A common expression: linear terms, then the rest."""
        number, count = int(told[0]), int(told[1])
        terms = [self.term() for _ in range(count)]
        self.defined[number] = plus(self.expression(), self.linear_form(terms))

    def jacobian(self, told: list[str]) -> None:
        self.parts.linear[int(told[0])] = [self.term() for _ in range(int(told[1]))]

    def gradient(self, told: list[str]) -> None:
        self.parts.gradients[int(told[0])] = [self.term() for _ in range(int(told[1]))]

    def ranges(self, told: list[str]) -> None:
        self.parts.row_bounds = [self.bound() for _ in range(self.rows)]

    def variable_bounds(self, told: list[str]) -> None:
        self.at += self.count  # read already

    def skipped(self, told: list[str]) -> None:
        """The start, duals, column counts, suffixes: so many lines."""
        count = int(told[1]) if len(told) > 1 else int(told[0])
        self.at += count

    def linear_form(self, terms: Sequence[tuple[int, Fraction]]) -> Value:
        total: Value = Fraction(0)
        for number, factor in terms:
            if factor:
                total = plus(total, times(factor, self.named(number)))
        return total

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
            return Fraction(self.finite(told))
        if kind in ("s", "l"):
            return Fraction(int(told))
        if kind == "v":
            return self.named(int(told))
        if kind != "o":
            raise self.wrong(
                f"{shown(line[:20])} begins no expression that is understood", "write the problem without it"
            )
        return self.operation(int(told), depth + 1)

    def operation(self, code: int, depth: int) -> Value:
        if code in _LISTS:
            parts = [self.expression(depth) for _ in range(int(self.next()))]
            if _LISTS[code] == "sum":
                total: Value = Fraction(0)
                for part in parts:
                    total = plus(total, part)
                return total
            return applied(_LISTS[code], parts)
        if code not in _KNOWN:
            raise self.wrong(f"the operation o{code} is not understood", "write the problem without it")
        first = self.expression(depth)
        if code == 16:
            return negative(first)
        if code == 77:
            return power(first, Fraction(2))
        if code == 42:
            return over(applied("log", [first]), applied("log", [Fraction(10)]))
        if code in _NAMED:
            return applied(_NAMED[code], [first])
        second = self.expression(depth)
        if code in _BINARY:
            return _BINARY[code](first, second)
        return applied("atan2", [first, second])

    # the network ------------------------------------------------------------------------------

    def state(self, network: Network) -> None:
        for k in range(self.rows):
            lo, hi = self.parts.row_bounds[k] if k < len(self.parts.row_bounds) else (-math.inf, math.inf)
            body = as_operand(
                plus(self.parts.bodies.get(k, Fraction(0)), self.linear_form(self.parts.linear.get(k, [])))
            )
            if lo == -math.inf and hi == math.inf:
                continue
            if not isinstance(body, Expr):
                body = self.variables[0] * 0.0 + body
            network.add(body.within((lo, hi)))


_SEGMENTS: dict[str, Callable[[_Reader, list[str]], None]] = {
    "C": _Reader.body,
    "O": _Reader.goal,
    "V": _Reader.definition,
    "J": _Reader.jacobian,
    "G": _Reader.gradient,
    "r": _Reader.ranges,
    "b": _Reader.variable_bounds,
    "x": _Reader.skipped,
    "d": _Reader.skipped,
    "k": _Reader.skipped,
    "S": _Reader.skipped,
}


# ------------------------------------------------------------------------------------------------------------------
# AMPL's .sol files: the answer to a .nl file, as AMPL, JuMP and Pyomo read it.

SOLVED, UNCERTAIN, INFEASIBLE, LIMIT = 0, 100, 200, 400  # of the solve_result codes
_CODES = {
    Verdict.PROVED: SOLVED,
    Verdict.NOT_CERTIFIED: UNCERTAIN,
    Verdict.REFUTED: INFEASIBLE,
    Verdict.UNKNOWN: LIMIT,
}


def sol_bytes(answer: Answer, rows: int) -> bytes:
    """The text; the point is the best proved one, or the middle of the first box. `rows`: constraints of the .nl."""
    values = _point(answer)
    lines = [f"cpcal: {answer.status}".replace("\n", " "), "", "Options", "3", "1", "1", "0"]
    lines += [str(rows), "0", str(len(answer.problem.network.names)), str(len(values))]
    lines += [repr(value) for value in values]
    return ("\n".join([*lines, f"objno 0 {_CODES[answer.verdict]}"]) + "\n").encode()


def _point(answer: Answer) -> list[float]:
    if answer.point is not None:
        return list(answer.point.values())
    if answer.paving is not None and answer.paving.solutions:
        return [float(v) for v in answer.paving.solutions[0].box.mid[: len(answer.problem.network.names)]]
    return []
