"""How true certificates are changed by hand; each change is known by its name, in `FORGERIES`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

# the true certificates: header, (constraints,) claims, split, exclude, pass, halve (a split of what is left)
Lines = list[dict[str, Any]]
Forgery = Callable[[Lines, Any], str | int]  # changes the lines; the line that must be refused, by name or index
FORGERIES: dict[str, tuple[Forgery, tuple[str, ...]]] = {}
LEG, NETWORK, BOTH, GAIN = ("leg",), ("network",), ("leg", "network"), ("gain",)
PROOFS = {"leg": "split_proof", "network": "network_split_proof", "gain": "gain_proof"}


def forgery(*kinds: str) -> Callable[[Forgery], Forgery]:
    def known(change: Forgery) -> Forgery:
        FORGERIES[change.__name__] = change, kinds or BOTH
        return change

    return known


def place(
    name: str, line: str, *path: Any, value: Any, refused: str | None = None, kinds: tuple[str, ...] = BOTH
) -> None:
    """The forgery that puts `value` (or what it makes of the old one) at a path of a line."""

    def change(lines: Lines, proof: Any) -> str:
        target: Any = lines[1] if line == "constraint" else lines[proof.index(line)]
        first = target["bounds"][0][3]["rows"][0][0] if "first" in path else None
        *keys, end = (first if key == "first" else key for key in path)
        for key in keys:
            target = target[key]
        target[end] = value(target[end]) if callable(value) else value
        return line if refused is None else refused

    assert name not in FORGERIES, name
    FORGERIES[name] = change, kinds


def valued(text: str) -> float:
    return float.fromhex(text)


def moved(text: str, towards: float, ulps: int = 1) -> str:
    value = valued(text)
    for _ in range(ulps):
        value = math.nextafter(value, towards)
    return value.hex()


def negated(text: str) -> str:
    return (-valued(text)).hex()


UP, DOWN = math.inf, -math.inf
WEIGHTS = ("bounds", 0, 3)
ROW = ("rows", "first")  # the row of the step that the first bound has the first weight on
