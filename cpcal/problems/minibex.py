"""Minibex read: text to tokens, tokens to declarations and trees, these to a network and an objective.

file        = [ "constants" { constant ";" } ] parts "variables" variable { (";" | ",") variable } ";" parts
              [ "minimize" expression [";"] ] [ "constraints" block { ";" block } [";"] "end" | "end" ]
parts       = { function }
constant    = [ "*" ] name dimensions ("=" | "in") expression     "*": its value may be set by a program
variable    = name dimensions [ "in" expression ]
dimensions  = { "[" expression "]" }     at most two
function    = "function" name "(" name dimensions { "," name dimensions } ")"
              { name "=" expression ";" } "return" expression [";"] "end"
block       = "for" name "=" expression ":" expression ";" block { ";" block } [";"] "end"
            | expression ("=" | "<=" | ">=" | "<" | ">" | "in") expression
expression  = sums of products of powers: + -, then * /, then ^ (which binds a minus sign to what follows)
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from functools import partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import CpcalError, InputError, shown, unusable
from cpcal.problems.values import (
    FUNCTIONS,
    MOST,
    RESERVED,
    Data,
    StatedProblem,
    Value,
    applied,
    array_of,
    as_operand,
    divided,
    indexed,
    interval_of,
    is_row,
    minus,
    negative,
    pairs,
    plus,
    power,
    stacked,
    times,
)
from cpcal.solver.interval import Interval
from cpcal.solver.model import Network
from cpcal.solver.network import Constraint, Expr

# ------------------------------------------------------------------------------------------------------------------
# Text cut into tokens, each with its line and column.

_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n]+|//[^\n]*|/\*.*?\*/)
    |(?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?)
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<sign><=|>=|[-+*/^=<>()\[\];,:])""",
    re.VERBOSE | re.DOTALL,
)
_SECTIONS = ("constants", "variables", "function", "minimize", "constraints", "end", "for", "return")
_KEYWORDS = {form: word for word in _SECTIONS for form in (word, word.capitalize(), word.upper())}
_TOKENS_MOST = 1_000_000
_CONSTRAINTS_MOST = 100_000
_DEEPEST = 60  # of nested brackets, functions and loops

_HABITS = {"==": "write = once", "**": "write ^ for a power"}  # of other languages
_RELATIONS = ("=", "<=", ">=", "<", ">", "in")
_LARGEST = float(np.finfo(float).max)
_BINARY: dict[str, Callable[[Value, Value], Value]] = {"+": plus, "-": minus, "*": times, "/": divided, "^": power}

Names = Mapping[str, Value]


class Token(NamedTuple):
    """kind: "number", "name", "keyword", "sign" or "end of file"; text as written (keywords in small letters)."""

    kind: str
    text: str
    line: int
    column: int


class SyntaxNode(NamedTuple):
    """kind       "number", "name", "call or index", "index", "row", "column", "interval", "sum", "negative" or the
               sign of an operation; of constraints "relation", "loop"
    parts      the nodes below; `token` is where it stands, and the sign of a relation
    from_zero  of an index in square brackets
    """

    kind: str
    token: Token
    parts: tuple["SyntaxNode", ...] = ()
    from_zero: bool = False


class Function(NamedTuple):
    inputs: tuple[Token, ...]
    steps: tuple[tuple[Token, SyntaxNode], ...]
    result: SyntaxNode


def read_minibex(text: str, where: str) -> StatedProblem:
    """The problem in a text called `where`. Raises InputError that names line and column.

    Numbers are the float64 nearest to their decimal text; quotients and whole powers of numbers are exact. An interval
    that is declared as data means THERE EXISTS a value of it at each place where it is written. "<" is read as "<=".
    """
    return _Reader(text, where).problem()


class _Reader:
    """Trees of expressions and constraints, by recursive descent, one token ahead; and what they mean.

    The problem of a file is built while it is parsed. Functions see `constants` and their inputs, nothing else. Raises
    InputError at the first token that has no place, and for what has no meaning, with line and column.
    """

    def __init__(self, text: str, where: str) -> None:
        self.text, self.where, self.at, self.depth = text, where, 0, 0
        self.tokens = list(self.cut())
        self.network = Network(Path(where).stem or "problem")
        self.constants: dict[str, Value] = {
            "pi": Interval(3.141592653589793, 3.1415926535897936),
            "oo": Data(Interval(_LARGEST, np.inf)),
        }
        self.names: dict[str, Value] = {}  # of variables
        self.functions: dict[str, Function] = {}
        self.calls = 0  # of functions in one another

    def wrong(self, what: str, remedy: str, token: Token | None = None) -> InputError:
        """The error to raise: it names line and column, of the next token if none is given."""
        token = token or self.now
        return unusable(self.where, f"column {token.column}: {what}", remedy, token.line)

    # tokens -----------------------------------------------------------------------------------

    def cut(self) -> Iterator[Token]:
        """Raises InputError where no token begins."""
        at, line, start, count = 0, 1, 0, 0
        while at < len(self.text):
            found, column = _TOKEN.match(self.text, at), at - start + 1
            kind = found.lastgroup if found else None
            endless = self.text.startswith("/*", at) and kind != "space"
            if found is None or endless or count > _TOKENS_MOST:
                what = "a comment does not end" if endless else f"{shown(self.text[at])} has no meaning"
                raise self.wrong(what, "write Minibex here", Token("sign", self.text[at], line, column))
            text = found.group()
            if kind == "name" and text in _KEYWORDS:
                yield Token("keyword", _KEYWORDS[text], line, column)
            elif kind != "space":
                yield Token(str(kind), text, line, column)
            count += kind != "space"
            line += text.count("\n")
            if "\n" in text:
                start = at + text.rindex("\n") + 1
            at = found.end()
        yield Token("end of file", "", line, at - start + 1)

    @property
    def now(self) -> Token:
        return self.tokens[self.at]

    def take(self) -> Token:
        token = self.now
        self.at += token.kind != "end of file"
        return token

    def takes(self, *texts: str) -> Token | None:
        """The next token, if it is one of these."""
        return self.take() if self.now.text in texts and self.now.kind != "number" else None

    def needs(self, text: str) -> None:
        if not self.takes(text):
            raise self.wrong(f"{self.told()} stands where {shown(text)} should", f"write {shown(text)} before it")

    def name(self) -> Token:
        if self.now.kind != "name":
            raise self.wrong(f"{self.told()} stands where a name should", "write a name: letters, digits and _")
        return self.take()

    def told(self) -> str:
        return "the end of the file" if self.now.kind == "end of file" else shown(self.now.text)

    @contextmanager
    def deeper(self) -> Iterator[None]:
        self.depth += 1
        if self.depth > _DEEPEST:
            what = f"brackets are nested more than {_DEEPEST} deep"
            raise self.wrong(what, "write it in parts, with functions or constants")
        yield
        self.depth -= 1

    # expressions ------------------------------------------------------------------------------

    def expression(self) -> SyntaxNode:
        with self.deeper():
            return self.joined(partial(self.joined, self.signed, "*", "/"), "+", "-")

    def joined(self, part: Callable[[], SyntaxNode], *signs: str) -> SyntaxNode:
        left = part()
        while sign := self.takes(*signs):
            left = SyntaxNode(sign.text, sign, (left, part()))
        return left

    def signed(self) -> SyntaxNode:
        signs = []
        while sign := self.takes("+", "-"):
            signs.append(sign)
        found = self.indexed()
        while sign := self.takes("^"):
            minus_sign, exponent = self.takes("-"), self.indexed()
            exponent = SyntaxNode("negative", minus_sign, (exponent,)) if minus_sign else exponent
            found = SyntaxNode("^", sign, (found, exponent))
        for sign in reversed(signs):
            found = SyntaxNode("negative", sign, (found,)) if sign.text == "-" else found
        return found

    def indexed(self) -> SyntaxNode:
        left = self.atom()
        while opening := self.takes("(", "["):
            parts = self.listed(",")
            self.needs(")" if opening.text == "(" else "]")
            called = left.kind == "name" and opening.text == "("
            kind, token = ("call or index", left.token) if called else ("index", opening)
            left = SyntaxNode(kind, token, (left, *parts), opening.text == "[")
        return left

    def listed(self, sign: str) -> list[SyntaxNode]:
        parts = [self.expression()]
        while self.takes(sign):
            parts.append(self.expression())
        return parts

    def atom(self) -> SyntaxNode:
        token = self.take()
        if token.text == "sum" and self.now.text == "(":
            self.needs("(")
            turns = self.turns()
            self.needs(",")
            found = SyntaxNode("sum", token, (*turns, self.expression()))
            self.needs(")")
            return found
        if token.kind in ("number", "name"):
            return SyntaxNode(token.kind, token)
        if token.text == "[":
            first = self.expression()
            self.needs(",")
            last = self.expression()
            self.needs("]")
            return SyntaxNode("interval", token, (first, last))
        if token.text == "(":
            first, sign = self.expression(), self.now.text
            parts = [first, *self.listed(sign)] if self.takes(",", ";") else [first]
            self.needs(")")
            return first if len(parts) == 1 else SyntaxNode("row" if sign == "," else "column", token, tuple(parts))
        self.at -= token.kind != "end of file"
        before = self.tokens[self.at - 1].text + token.text if self.at else ""
        remedy = _HABITS.get(before, "write a number, a name or a bracket")
        raise self.wrong(f"{self.told()} stands where an expression should begin", remedy)

    def turns(self) -> tuple[SyntaxNode, SyntaxNode, SyntaxNode]:
        """`name = first : last` of a loop or a sum."""
        name = self.name()
        self.needs("=")
        first = self.expression()
        self.needs(":")
        return SyntaxNode("name", name), first, self.expression()

    # functions and constraints ----------------------------------------------------------------

    def named(self) -> tuple[Token, tuple[SyntaxNode, ...]]:
        """A name and its dimensions."""
        token, dimensions = self.name(), []
        while self.takes("["):
            dimensions.append(self.expression())
            self.needs("]")
        if len(dimensions) > 2:
            raise self.wrong(f"{token.text} has {len(dimensions)} dimensions", "give at most two", token)
        return token, tuple(dimensions)

    def function(self) -> Function:
        self.needs("(")
        inputs = [self.named()[0]]
        while self.takes(","):
            inputs.append(self.named()[0])
        self.needs(")")
        steps = []
        while self.now.kind == "name":
            left = self.name()
            self.needs("=")
            steps.append((left, self.expression()))
            self.needs(";")
        self.needs("return")
        result = self.expression()
        self.takes(";")
        self.needs("end")
        return Function(tuple(inputs), tuple(steps), result)

    def blocks(self) -> list[SyntaxNode]:
        """Up to "end", which is taken."""
        out = []
        while not self.takes("end"):
            if loop := self.takes("for"):
                with self.deeper():
                    turns = self.turns()
                    self.needs(";")
                    out.append(SyntaxNode("loop", loop, (*turns, *self.blocks())))
            else:
                out.append(self.relation())
            if self.now.text != "end":
                self.needs(";")
        return out

    def relation(self) -> SyntaxNode:
        left = self.expression()
        if self.now.text not in _RELATIONS:
            raise self.wrong(f"{self.told()} stands where a relation should", "write =, <=, >= or in")
        found = SyntaxNode("relation", self.take(), (left, self.expression()))
        if self.now.text in _RELATIONS:
            raise self.wrong("a second relation follows", "write a <= b and b <= c as two constraints")
        return found

    # what expressions are worth, by the names that are known where they stand -----------------

    @contextmanager
    def placed(self, token: Token) -> Iterator[None]:
        """Gives the token's place to an error of the solver's modelling layer."""
        try:
            yield
        except InputError:
            raise
        except (CpcalError, OverflowError, ZeroDivisionError, ValueError) as error:
            raise self.wrong(str(error).splitlines()[0][:200], "correct the expression", token) from None

    def value(self, node: SyntaxNode, names: Names) -> Value:
        kind, token = node.kind, node.token
        with self.placed(token):
            if kind == "number":
                return Fraction(float(token.text))
            if kind == "name":
                if token.text not in names:
                    raise self.wrong(f"{shown(token.text)} is not declared", "declare it before it is used", token)
                return names[token.text]
            if kind in _BINARY:
                return self.chain(node, names)
            if kind == "sum":
                entries = [self.value(node.parts[3], scope) for scope in self.scopes(node, names)]
                return reduce(plus, entries) if entries else Fraction(0)
            if kind in ("index", "call or index"):
                return self.indexed_or_called(node, names)
            values = [self.value(part, names) for part in node.parts]
            if kind in ("row", "column"):
                return stacked(values, row=kind == "row")
            if kind == "negative":
                return negative(values[0])
            low, high = map(interval_of, values)  # `oo` on its side has no bound
            lo = -np.inf if low.hi <= -_LARGEST else low.lo
            return Data(Interval(lo, np.inf if high.lo >= _LARGEST else high.hi))

    def chain(self, node: SyntaxNode, names: Names) -> Value:
        """A sum or product of any length, from its left end: no call for each of its signs."""
        signs = []
        while node.kind in _BINARY:
            signs.append(node)
            node = node.parts[0]
        found = self.value(node, names)
        for sign in reversed(signs):
            right = self.value(sign.parts[1], names)
            with self.placed(sign.token):
                found = _BINARY[sign.kind](found, right)
        return found

    def whole(self, node: SyntaxNode, names: Names) -> int:
        value = self.value(node, names)
        if not isinstance(value, Fraction) or value.denominator != 1:
            raise self.wrong("a whole number must stand here", "write one, or a name of one", node.token)
        return int(value)

    def scopes(self, node: SyntaxNode, names: Names) -> Iterator[Names]:
        """The names in each turn of a loop or a sum."""
        name, first, last, *_ = node.parts
        start, end = self.whole(first, names), self.whole(last, names)
        if end - start >= MOST:
            raise self.wrong(f"{end - start + 1:,} turns", f"give at most {MOST:,}", name.token)
        for turn in range(start, end + 1):
            yield {**names, name.token.text: Fraction(turn)}

    def indexed_or_called(self, node: SyntaxNode, names: Names) -> Value:
        head, *places = node.parts
        if node.kind == "call or index" and head.token.text not in names:
            return self.called(node.token, [self.value(place, names) for place in places])
        array = self.value(head, names)
        if not isinstance(array, np.ndarray):
            raise self.wrong("a number has no index", "take it out", node.token)
        if len(places) > array.ndim:
            raise self.wrong(f"{len(places)} indices for {array.ndim} dimensions", "give fewer", node.token)
        sides = array.shape[1:] if is_row(array) and len(places) == 1 else array.shape
        base = 0 if node.from_zero else 1
        return indexed(array, tuple(self.index(p, names, n, base) for p, n in zip(places, sides, strict=False)))

    def index(self, node: SyntaxNode, names: Names, side: int, base: int) -> int:
        """From 0; the file counts from `base`."""
        found = self.whole(node, names)
        if not base <= found <= side - 1 + base:
            what = f"the index {found} is not from {base} to {side - 1 + base}"
            raise self.wrong(what, "x(1) and x[0] are the first", node.token)
        return found - base

    def called(self, token: Token, arguments: list[Value]) -> Value:
        if token.text in FUNCTIONS:
            return applied(token.text, arguments)
        if token.text not in self.functions:
            raise self.wrong(f"{shown(token.text)} is no function", "declare it, or correct the name", token)
        function = self.functions[token.text]
        if len(arguments) != len(function.inputs):
            what = f"{token.text} takes {len(function.inputs)} arguments, not {len(arguments)}"
            raise self.wrong(what, "give as many", token)
        self.calls += 1
        if self.calls > _DEEPEST:
            raise self.wrong("functions call one another without end", "take the circle out", token)
        local = self.constants | {name.text: of for name, of in zip(function.inputs, arguments, strict=True)}
        for step, expression in function.steps:
            local[step.text] = self.value(expression, local)
        found = self.value(function.result, local)
        self.calls -= 1
        return found

    # the whole file: declarations, in their order, become a network; an objective, if any -----

    def problem(self) -> StatedProblem:
        if self.takes("constants"):
            while self.now.kind == "name" or self.now.text == "*":
                self.constant()
                self.needs(";")
        if self.parts() and self.now.kind == "end of file":
            raise self.wrong(
                "the file declares functions alone", "declare Variables, and Constraints or what to Minimize"
            )
        self.needs("variables")
        self.variable()
        while self.takes(";", ","):
            if self.now.kind != "name" or self.now.text.lower() == "maximize":
                break
            self.variable()
        self.parts()
        names, goal = self.constants | self.names, None
        if self.takes("minimize"):
            tree = self.expression()
            goal = as_operand(self.value(tree, names))
            if not isinstance(goal, Expr):
                raise self.wrong("a number that depends on a variable must stand here", "write one", tree.token)
        self.takes(";")
        blocks: Sequence[SyntaxNode] = ()
        if self.takes("constraints"):
            self.takes(";")
            blocks = self.blocks()
        elif goal is None:
            largest = self.now.text.lower() == "maximize"
            remedy = "write Minimize and the negative" if largest else "say what is asked for, after a ;"
            raise self.wrong(f"{self.told()} stands where Minimize or Constraints should", remedy)
        else:
            self.takes("end")
        if self.now.kind != "end of file":
            raise self.wrong(f"{shown(self.now.text)} comes after the end", "take it out")
        for count, (relation, scope) in enumerate(self.relations(blocks, names)):
            if count == _CONSTRAINTS_MOST:
                what = f"there are more than {_CONSTRAINTS_MOST:,} constraints"
                raise self.wrong(what, "write fewer", relation.token)
            with self.placed(relation.token):
                self.network.add(self.constraint(relation, scope))
        return StatedProblem(self.network, goal)

    # declarations -----------------------------------------------------------------------------

    def parts(self) -> int:
        """Functions; how many."""
        while self.takes("function"):
            token = self.name()
            self.new(token)
            self.functions[token.text] = self.function()
        return len(self.functions)

    def new(self, token: Token) -> None:
        if any(token.text in known for known in (self.constants, self.names, self.functions, RESERVED)):
            raise self.wrong(f"{shown(token.text)} is there already", "choose another name", token)

    def constant(self) -> None:
        self.takes("*")
        token, dimensions = self.named()
        self.new(token)
        exact = self.takes("=")
        if not exact:
            self.needs("in")
        entries, shape = self.entries(token, dimensions, self.expression())
        with self.placed(token):
            if not exact:
                bounds = [interval_of(entry) for entry in entries]
                entries = [b if b.lo == b.hi else Data(b) for b in bounds]
        self.constants[token.text] = array_of(entries, shape) if shape else entries[0]

    def variable(self) -> None:
        token, dimensions = self.named()
        self.new(token)
        entries, shape = self.entries(token, dimensions, self.expression() if self.takes("in") else None)
        with self.placed(token):
            bounds = [interval_of(entry) for entry in entries]
            lo, hi = (np.array([getattr(b, end) for b in bounds]).reshape(shape) for end in ("lo", "hi"))
            leaf = self.network.variable(token.text, shape=shape, domain=(lo, hi))
        self.names[token.text] = array_of([leaf[k] for k in np.ndindex(shape)], shape) if shape else leaf

    def entries(
        self, token: Token, dimensions: tuple[SyntaxNode, ...], value: SyntaxNode | None
    ) -> tuple[list[Any], tuple[int, ...]]:
        """What a name is set to or lies in, entry by entry, and its shape; one number stands for all entries."""
        shape = tuple(self.whole(node, self.constants) for node in dimensions)
        count = math.prod(shape)
        if any(side < 1 for side in shape) or count > MOST:
            what = f"{token.text} has the dimensions {shape}"
            raise self.wrong(what, f"give whole numbers from 1, and at most {MOST:,} entries", token)
        found = Data(Interval(-np.inf, np.inf)) if value is None else self.value(value, self.constants)
        if not isinstance(found, np.ndarray):
            return [found] * count, shape
        if shape not in (found.shape, found.shape[1:] if is_row(found) else None):  # a row serves as a column
            what = f"{token.text} has the dimensions {shape} and a value of {found.shape}"
            raise self.wrong(what, "give a value of its size", token)
        return list(found.ravel()), shape

    # constraints ------------------------------------------------------------------------------

    def relations(self, blocks: Sequence[SyntaxNode], names: Names) -> Iterator[tuple[SyntaxNode, Names]]:
        for block in blocks:
            if block.kind == "loop":
                for scope in self.scopes(block, names):
                    yield from self.relations(block.parts[3:], scope)
            else:
                yield block, names

    def constraint(self, relation: SyntaxNode, names: Names) -> list[Constraint]:
        left, right = (self.value(side, names) for side in relation.parts)
        sign, out = relation.token.text[0], []
        both = pairs(left, right) if sign == "i" else pairs(minus(left, right), Fraction(0))
        for entry, bounds in both:
            body = as_operand(entry)
            if not isinstance(body, Expr):
                raise self.wrong("a constraint without a variable", "take it out", relation.token)
            if sign == "i":
                inside = interval_of(bounds)
                out.append(body.within((inside.lo, inside.hi)))
            else:
                out.append(body <= 0.0 if sign == "<" else body >= 0.0 if sign == ">" else body == 0.0)
        return out
