"""The tree of a Minibex file."""

from __future__ import annotations

from dataclasses import dataclass

from cpcal.problems.tokens import Token


@dataclass(frozen=True)
class Node:
    """kind       "number", "name", "call or index", "index", "range", "row", "column", "interval", "ball", "sum",
               "negative", "transposed" or the sign of an operation
    parts      the nodes below; `token` is where it stands
    from_zero  of an index in square brackets
    """

    kind: str
    token: Token
    parts: tuple[Node, ...] = ()
    from_zero: bool = False


@dataclass(frozen=True)
class Symbol:
    """A declared constant, variable or input: its dimensions, and what it is set to or lies in."""

    token: Token
    dimensions: tuple[Node, ...]
    value: Node | None = None
    thin: bool = False  # set by "=", not by "in"


@dataclass(frozen=True)
class Function:
    token: Token
    inputs: tuple[Symbol, ...]
    steps: tuple[tuple[Token, Node], ...]
    result: Node


@dataclass(frozen=True)
class Relation:
    sign: Token
    left: Node
    right: Node


@dataclass(frozen=True)
class Loop:
    name: Token
    first: Node
    last: Node
    blocks: tuple[Relation | Loop, ...]


@dataclass(frozen=True)
class File:
    constants: tuple[Symbol, ...]
    variables: tuple[Symbol, ...]
    functions: tuple[Function, ...]
    goal: Node | None
    blocks: tuple[Relation | Loop, ...]
