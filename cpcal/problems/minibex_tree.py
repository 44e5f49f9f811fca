"""The tree of a Minibex file."""

from __future__ import annotations

from dataclasses import dataclass

from cpcal.problems.tokens import Token


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
