"""Minibex text cut into tokens, each with its line and column."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

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
