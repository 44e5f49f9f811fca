"""The lines of a .nl file, one after the other, with what each may hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

from cpcal.common.errors import InputError
from cpcal.common.errors import Problem as Wrong


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
