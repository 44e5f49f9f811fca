"""Minibex text cut into tokens, each with its line and column."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from itertools import pairwise
from typing import NoReturn

from cpcal.common.errors import InputError, Problem, shown

_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n]+|//[^\n]*|/\*.*?\*/)
    |(?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?)
    |(?P<hex>\#[0-9a-fA-F]{1,16})
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<sign><=|>=|:=|[-+*/^'=<>(){}\[\];,:!])""",
    re.VERBOSE | re.DOTALL,
)
_SECTIONS = ("constants", "variables", "parameters", "function", "minimize", "constraints", "end", "for", "return")
KEYWORDS = {form: word for word in _SECTIONS for form in (word, word.capitalize(), word.upper())}
MOST = 1_000_000  # tokens


@dataclass(frozen=True)
class Token:
    """kind: "number", "name", "keyword", "sign" or "end of file"; text as written (keywords in small letters)."""

    kind: str
    text: str
    line: int
    column: int
    value: float = 0.0


class Source:
    """A text and what it is called, for messages."""

    def __init__(self, text: str, where: str) -> None:
        self.text, self.where = text, where

    def wrong(self, what: str, remedy: str, token: Token) -> InputError:
        """The error to raise: it names line and column."""
        return InputError([Problem(self.where, f"column {token.column}: {what}", remedy, token.line)])

    def tokens(self) -> list[Token]:
        """Raises InputError where no token begins."""
        out: list[Token] = []
        at, line, start = 0, 1, 0
        while at < len(self.text):
            found = _TOKEN.match(self.text, at)
            comment = self.text.startswith("/*", at) and found is not None and found.lastgroup != "space"
            if found is None or comment or len(out) > MOST:
                bad = Token("sign", self.text[at], line, at - start + 1)
                what = (
                    "a comment does not end"
                    if self.text.startswith("/*", at)
                    else f"{shown(self.text[at])} has no meaning"
                )
                raise self.wrong(what, "write Minibex here", bad)
            text = found.group()
            if found.lastgroup != "space":
                out.append(_token(found.lastgroup or "", text, line, at - start + 1))
            line += text.count("\n")
            if "\n" in text:
                start = at + text.rindex("\n") + 1
            at = found.end()
        return [*out, Token("end of file", "", line, at - start + 1)]


def _token(kind: str, text: str, line: int, column: int) -> Token:
    if kind == "name" and text in KEYWORDS:
        return Token("keyword", KEYWORDS[text], line, column)
    if kind == "hex":  # the bits of a float64
        return Token("number", text, line, column, struct.unpack(">d", bytes.fromhex(text[1:].zfill(16)))[0])
    return Token(kind, text, line, column, float(text) if kind == "number" else 0.0)


# ------------------------------------------------------------------------------------------------------------------
# The tree of a Minibex file.


@dataclass(frozen=True)
class SyntaxNode:
    """kind       "number", "name", "call or index", "index", "range", "row", "column", "interval", "ball", "sum",
               "negative", "transposed" or the sign of an operation
    parts      the nodes below; `token` is where it stands
    from_zero  of an index in square brackets
    """

    kind: str
    token: Token
    parts: tuple[SyntaxNode, ...] = ()
    from_zero: bool = False


@dataclass(frozen=True)
class Symbol:
    """A declared constant, variable or input: its dimensions, and what it is set to or lies in."""

    token: Token
    dimensions: tuple[SyntaxNode, ...]
    value: SyntaxNode | None = None
    thin: bool = False  # set by "=", not by "in"


@dataclass(frozen=True)
class Function:
    token: Token
    inputs: tuple[Symbol, ...]
    steps: tuple[tuple[Token, SyntaxNode], ...]
    result: SyntaxNode


@dataclass(frozen=True)
class Relation:
    """`right` is None for "integer". A name that nothing has yet = `right` says what the name stands for."""

    sign: Token
    left: SyntaxNode
    right: SyntaxNode | None = None


@dataclass(frozen=True)
class Loop:
    name: Token
    first: SyntaxNode
    last: SyntaxNode
    blocks: tuple[Relation | Loop, ...]


@dataclass(frozen=True)
class File:
    constants: tuple[Symbol, ...]
    variables: tuple[Symbol, ...]
    functions: tuple[Function, ...]
    goal: SyntaxNode | None
    blocks: tuple[Relation | Loop, ...]
    parameters: tuple[Symbol, ...] = ()


# ------------------------------------------------------------------------------------------------------------------
# Expressions of Minibex: tokens to a tree.
#
# expression  = sums of products of powers: + -, then * /, then ^ and ' (which bind a minus sign to what follows them)

_HABITS = {"==": "write = once", "**": "write ^ for a power"}  # of other languages
DEEPEST = 60  # of nested brackets, functions and loops


class ExpressionParser:
    """Recursive descent, one token ahead. Raises InputError at the first token that has no place."""

    def __init__(self, source: Source) -> None:
        self.source, self.tokens, self.at, self.depth = source, source.tokens(), 0, 0

    # expressions ------------------------------------------------------------------------------

    def expression(self) -> SyntaxNode:
        self.deeper()
        left = self.product()
        while self.now.text in ("+", "-") and self.now.kind == "sign":
            sign = self.take()
            left = SyntaxNode(sign.text, sign, (left, self.product()))
        self.depth -= 1
        return left

    def product(self) -> SyntaxNode:
        left = self.signed()
        while self.now.text in ("*", "/") and self.now.kind == "sign":
            sign = self.take()
            left = SyntaxNode(sign.text, sign, (left, self.signed()))
        return left

    def signed(self) -> SyntaxNode:
        signs = []
        while self.now.text in ("+", "-") and self.now.kind == "sign":
            signs.append(self.take())
        found = self.power()
        for sign in reversed(signs):
            found = SyntaxNode("negative", sign, (found,)) if sign.text == "-" else found
        return found

    def power(self) -> SyntaxNode:
        left = self.indexed()
        while self.now.text == "^":
            sign = self.take()
            minus = self.take() if self.now.text == "-" else None
            exponent = self.indexed()
            left = SyntaxNode("^", sign, (left, SyntaxNode("negative", minus, (exponent,)) if minus else exponent))
        return left

    def indexed(self) -> SyntaxNode:
        left = self.atom()
        while self.now.text in ("(", "[", "'"):
            opening = self.take()
            if opening.text == "'":
                left = SyntaxNode("transposed", opening, (left,))
                continue
            parts = [self.place()]
            while self.takes(","):
                parts.append(self.place())
            self.needs(")" if opening.text == "(" else "]")
            called = left.kind == "name" and opening.text == "("
            kind, token = ("call or index", left.token) if called else ("index", opening)
            left = SyntaxNode(kind, token, (left, *parts), opening.text == "[")
        return left

    def place(self) -> SyntaxNode:
        """An index, an argument, a range of indices, or ":" for all."""
        token = self.now
        if self.takes(":"):
            return SyntaxNode("range", token)
        first = self.expression()
        return SyntaxNode("range", token, (first, self.expression())) if self.takes(":") else first

    def atom(self) -> SyntaxNode:
        token = self.take()
        if token.kind in ("number", "name"):
            if token.text == "sum" and self.now.text == "(":
                return self.sum(token)
            return SyntaxNode(token.kind, token)
        if token.text == "[":
            first = self.expression()
            self.needs(",")
            last = self.expression()
            self.needs("]")
            return SyntaxNode("interval", token, (first, last))
        if token.text == "<":
            middle = self.expression()
            self.needs(",")
            radius = self.expression()
            self.needs(">")
            return SyntaxNode("ball", token, (middle, radius))
        if token.text == "(" and token.kind == "sign":
            return self.bracketed(token)
        self.at -= 1
        before = self.tokens[self.at - 1].text + token.text if self.at else ""
        remedy = _HABITS.get(before, "write a number, a name or a bracket")
        return self.fail(f"{self.told()} stands where an expression should begin", remedy)

    def bracketed(self, token: Token) -> SyntaxNode:
        parts = [self.expression()]
        sign = self.now.text
        if sign in (",", ";"):
            while self.takes(sign):
                parts.append(self.expression())
        self.needs(")")
        return parts[0] if len(parts) == 1 else SyntaxNode("row" if sign == "," else "column", token, tuple(parts))

    def sum(self, token: Token) -> SyntaxNode:
        self.needs("(")
        name = self.name()
        self.needs("=")
        first = self.expression()
        self.needs(":")
        last = self.expression()
        self.needs(",")
        body = self.expression()
        self.needs(")")
        return SyntaxNode("sum", token, (SyntaxNode("name", name), first, last, body))

    # tokens -----------------------------------------------------------------------------------

    @property
    def now(self) -> Token:
        return self.tokens[self.at]

    def take(self) -> Token:
        token = self.now
        if token.kind != "end of file":
            self.at += 1
        return token

    def takes(self, text: str) -> bool:
        if self.now.text == text and self.now.kind != "number":
            self.take()
            return True
        return False

    def needs(self, text: str) -> None:
        if not self.takes(text):
            self.fail(f"{self.told()} stands where {shown(text)} should", f"write {shown(text)} before it")

    def name(self) -> Token:
        if self.now.kind != "name":
            self.fail(f"{self.told()} stands where a name should", "write a name: letters, digits and _")
        return self.take()

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            self.fail(f"brackets are nested more than {DEEPEST} deep", "write it in parts, with functions or constants")

    def told(self) -> str:
        return "the end of the file" if self.now.kind == "end of file" else shown(self.now.text)

    def fail(self, what: str, remedy: str) -> NoReturn:
        raise self.source.wrong(what, remedy, self.now)


# ------------------------------------------------------------------------------------------------------------------
# The grammar of Minibex: text to a tree. What it means stands in `minibex_meaning`.
#
# file        = [ "constants" { constant ";" } ] parts "variables" variable { (";" | ",") variable } ";" parts
#               [ "minimize" expression [";"] ] [ "constraints" block { ";" block } [";"] "end" | "end" ]
# parts       = { function | "parameters" constant { (";" | ",") constant } ";" }
# constant    = [ "*" ] name dimensions ("=" | "in") expression     "*": its value may be set by a program
# variable    = name dimensions [ "in" expression ]
# dimensions  = { "[" expression "]" }     at most three
# function    = "function" name "(" name dimensions { "," name dimensions } ")"
#               { name "=" expression ";" } "return" expression [";"] "end"
# block       = "for" name "=" expression ":" expression ";" block { ";" block } [";"] "end"
#             | expression ("=" | "<=" | ">=" | "<" | ">" | "in") expression | "integer" "(" expression ")"
#             | "(" block ")" | name "=" expression     for a new name: what it stands for from there on
# expression  : `minibex_expressions`

RELATIONS = ("=", "<=", ">=", "<", ">", "in")

_OPENING, _CLOSING = ("(", "["), (")", "]")


class Parser(ExpressionParser):
    """Of a whole file."""

    # the file ---------------------------------------------------------------------------------

    def file(self) -> File:
        constants: list[Symbol] = []
        if self.takes("constants"):
            while self.now.kind == "name" or self.now.text == "*":
                constants.append(self.constant())
                self.needs(";")
        functions, parameters = self.parts()
        if functions and self.now.kind == "end of file":
            self.fail("the file declares functions alone", "declare Variables, and Constraints or what to Minimize")
        self.needs("variables")
        variables = [self.variable()]
        while self.takes(";") or self.takes(","):
            if self.now.kind != "name" or self.now.text.lower() == "maximize":
                break
            variables.append(self.variable())
        more, further = self.parts()
        functions, parameters = functions + more, parameters + further
        goal = self.expression() if self.takes("minimize") else None
        self.takes(";")
        blocks: tuple[Relation | Loop, ...] = ()
        if self.takes("constraints"):
            self.takes(";")
            blocks = self.blocks()
        elif goal is None:
            largest = self.now.text.lower() == "maximize"
            remedy = "write Minimize and the negative" if largest else "say what is asked for, after a ;"
            self.fail(f"{self.told()} stands where Minimize or Constraints should", remedy)
        else:
            self.takes("end")
        if self.now.kind != "end of file":
            self.fail(f"{shown(self.now.text)} comes after the end", "take it out")
        return File(tuple(constants), tuple(variables), tuple(functions), goal, blocks, tuple(parameters))

    def parts(self) -> tuple[list[Function], list[Symbol]]:
        """Functions and parameters, in any order."""
        functions, parameters = list[Function](), list[Symbol]()
        while True:
            if self.takes("function"):
                functions.append(self.function())
            elif self.takes("parameters"):
                parameters.append(self.constant())
                while (self.takes(";") or self.takes(",")) and self.now.kind == "name":
                    parameters.append(self.constant())
            else:
                return functions, parameters

    def constant(self) -> Symbol:
        self.takes("*")
        token, dimensions = self.named()
        if self.takes("="):
            return Symbol(token, dimensions, self.expression(), thin=True)
        self.needs("in")
        return Symbol(token, dimensions, self.expression())

    def variable(self) -> Symbol:
        token, dimensions = self.named()
        return Symbol(token, dimensions, self.expression() if self.takes("in") else None)

    def named(self) -> tuple[Token, tuple[SyntaxNode, ...]]:
        token, dimensions = self.name(), []
        while self.takes("["):
            dimensions.append(self.expression())
            self.needs("]")
        if len(dimensions) > 3:
            raise self.source.wrong(f"{token.text} has {len(dimensions)} dimensions", "give at most three", token)
        return token, tuple(dimensions)

    def function(self) -> Function:
        token = self.name()
        self.needs("(")
        inputs = [Symbol(*self.named())]
        while self.takes(","):
            inputs.append(Symbol(*self.named()))
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
        return Function(token, tuple(inputs), tuple(steps), result)

    def blocks(self) -> tuple[Relation | Loop, ...]:
        """Up to "end", which is taken."""
        out: list[Relation | Loop] = []
        while not self.takes("end"):
            out.append(self.loop() if self.takes("for") else self.relation())
            if self.now.text != "end":
                self.needs(";")
        return tuple(out)

    def loop(self) -> Loop:
        self.deeper()
        name = self.name()
        self.needs("=")
        first = self.expression()
        self.needs(":")
        last = self.expression()
        self.needs(";")
        found = Loop(name, first, last, self.blocks())
        self.depth -= 1
        return found

    def relation(self) -> Relation:
        """In brackets or not."""
        if self.now.text == "(" and self.holds_relation():
            self.take()
            self.deeper()
            found = self.relation()
            self.needs(")")
            self.depth -= 1
            return found
        if self.now.text == "integer" and self.tokens[self.at + 1].text == "(":
            sign = self.take()
            self.needs("(")
            whole = Relation(sign, self.expression())
            self.needs(")")
            return whole
        left = self.expression()
        if self.now.text not in RELATIONS:
            self.fail(f"{self.told()} stands where a relation should", "write =, <=, >= or in")
        sign = self.take()
        right = self.expression()
        if self.now.text in RELATIONS:
            self.fail("a second relation follows", "write a <= b and b <= c as two constraints")
        return Relation(sign, left, right)

    def holds_relation(self) -> bool:
        """Whether the bracket that begins here is round a relation, not round an expression."""
        depth = 0
        for before, token in pairwise(self.tokens[self.at :]):
            depth += (before.text in _OPENING) - (before.text in _CLOSING)
            after_value = before.kind in ("number", "name") or before.text in (*_CLOSING, "'")
            if depth == 1 and token.text == "integer" and before.text == "(":
                return True
            if depth == 1 and token.text in RELATIONS and (after_value or token.text not in "<>"):
                return True
            if depth == 0 or token.text == ";":
                return False
        return False
