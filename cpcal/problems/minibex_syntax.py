"""The grammar of Minibex: text to a tree. What it means stands in `minibex_meaning`.

file        = [ "constants" { constant ";" } ] "variables" variable { (";" | ",") variable } ";"
              { function } [ "minimize" expression [";"] ] [ "constraints" block { ";" block } [";"] "end" ]
constant    = name dimensions ("=" | "in") expression
variable    = name dimensions [ "in" expression ]
dimensions  = { "[" expression "]" }     at most three
function    = "function" name "(" name dimensions { "," name dimensions } ")"
              { name "=" expression ";" } "return" expression [";"] "end"
block       = "for" name "=" expression ":" expression ";" block { ";" block } [";"] "end"
            | expression ("=" | "<=" | ">=" | "<" | ">") expression | "(" block ")"
expression  = sums of products of powers: + -, then * /, then ^ and ' (which bind a minus sign to what follows them)
"""

from __future__ import annotations

from itertools import pairwise
from typing import NoReturn

from cpcal.common.errors import shown
from cpcal.problems.minibex_tree import File, Function, Loop, Relation, Symbol, SyntaxNode
from cpcal.problems.tokens import Source, Token

RELATIONS = ("=", "<=", ">=", "<", ">")
DEEPEST = 60  # of nested brackets, functions and loops

_OPENING, _CLOSING = ("(", "["), (")", "]")


class Parser:
    """Recursive descent, one token ahead. Raises InputError at the first token that has no place."""

    def __init__(self, source: Source) -> None:
        self.source, self.tokens, self.at, self.depth = source, source.tokens(), 0, 0

    # the file ---------------------------------------------------------------------------------

    def file(self) -> File:
        constants: list[Symbol] = []
        if self.takes("constants"):
            while self.now.kind == "name":
                constants.append(self.constant())
                self.needs(";")
        self.needs("variables")
        variables = [self.variable()]
        while self.takes(";") or self.takes(","):
            if self.now.kind != "name":
                break
            variables.append(self.variable())
        if self.now.text == "parameters":
            self.fail("parameters are not understood", "make them constants or variables")
        functions: list[Function] = []
        while self.takes("function"):
            functions.append(self.function())
        goal = self.expression() if self.takes("minimize") else None
        self.takes(";")
        blocks: tuple[Relation | Loop, ...] = ()
        if self.takes("constraints"):
            blocks = self.blocks()
        elif goal is None:
            self.fail("neither Minimize nor Constraints comes", "say what is asked for")
        if self.now.kind != "end of file":
            self.fail(f"{shown(self.now.text)} comes after the end", "take it out")
        return File(tuple(constants), tuple(variables), tuple(functions), goal, blocks)

    def constant(self) -> Symbol:
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
        left = self.expression()
        if self.now.text not in RELATIONS:
            self.fail(f"{self.told()} stands where a relation should", "write =, <= or >=")
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
            if depth == 1 and token.text in RELATIONS and (after_value or token.text not in "<>"):
                return True
            if depth == 0 or token.text == ";":
                return False
        return False

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
        return self.fail(
            f"{self.told()} stands where an expression should begin", "write a number, a name or a bracket"
        )

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
