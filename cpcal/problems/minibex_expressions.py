"""Expressions of Minibex: tokens to a tree.

expression  = sums of products of powers: + -, then * /, then ^ and ' (which bind a minus sign to what follows them)
"""

from __future__ import annotations

from typing import NoReturn

from cpcal.common.errors import shown
from cpcal.problems.minibex_tree import SyntaxNode
from cpcal.problems.tokens import Source, Token

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
