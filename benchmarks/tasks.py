"""What is asked of a method. A task has a name of two parts: its kind and a number, "refute-0.9"."""

from __future__ import annotations

from dataclasses import dataclass

KINDS = {
    "minimise": "close eps* to the relative gap that is given",
    "refute": "prove that no x satisfies all equations at the given share of eps*",
    "hull": "the box around all x that satisfy them at the given multiple of eps*",
    "certify": "the whole answer about a leg, its support included, to the relative gap that is given",
    "prove": "the same, a certificate written and checked in exact arithmetic",
    "sweep": "contract that many boxes once with every equation",
}
WITH_EPS = ("refute", "hull", "sweep")  # these need to know eps*
_SWEPT = 1.1  # a sweep is about S(1.1 eps*)


class Unsupported(Exception):
    """A method was asked what it cannot answer. The message says why; the run is skipped."""


@dataclass(frozen=True)
class Task:
    """`kind` is one of KINDS; `value` its number."""

    kind: str
    value: float

    @classmethod
    def named(cls, name: str) -> Task:
        kind, _, value = name.partition("-")
        if kind not in KINDS:
            raise ValueError(f"no task is called {name!r}; there are {', '.join(KINDS)}, each followed by -NUMBER")
        return cls(kind, float(value))

    @property
    def name(self) -> str:
        return f"{self.kind}-{self.value:g}"

    def eps(self, lo: float, hi: float) -> float:
        """The tolerance to ask about, when eps* is known to lie in `[lo, hi]`."""
        if self.kind == "sweep":
            return _SWEPT * hi
        return self.value * (lo if self.value < 1.0 else hi)
