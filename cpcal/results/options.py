"""What a user asks of `certify` and `compare`: one frozen value that checks itself, stored in every result."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cpcal.common.errors import InputError, Problem
from cpcal.files.codec import INFORMED, checked

CENTERS = ("fit", "nominal", "plain")
SUPPORTS = ("few", "irreducible", "none")
METHODS = ("bound", "timeout")
ARITHMETICS = ("float64", "arb")
LARGEST_DELTA = 1e6  # mm: a kilometre


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of `cpcal.certify`, whose help says what they mean. Lengths in mm, times in seconds.

    Raises InputError with every problem that shows without the campaign.
    """

    legs: tuple[int, ...] | None = field(default=None, metadata=checked("the legs that are there"))
    delta: float = field(default=100.0, metadata=checked("the box of each certificate"))
    center: str = field(default="fit", metadata=INFORMED)
    gap: float = field(default=1e-6, metadata=INFORMED)
    time_limit: float | None = field(default=None, metadata=INFORMED)
    node_limit: int | None = field(default=None, metadata=INFORMED)
    contractors: tuple[str, ...] = field(default=("lifted",), metadata=INFORMED)
    arithmetic: str = field(default="float64", metadata=INFORMED)
    eps: float | None = field(default=None, metadata=checked("the box and the cap of each certificate"))
    tolerance: float | None = field(default=None, metadata=INFORMED)
    support: str = field(default="few", metadata=INFORMED)
    method: str = field(default="bound", metadata=INFORMED)
    model: str | None = field(default=None, metadata=INFORMED)
    half_widths: Mapping[str, float] = field(default_factory=dict, metadata=INFORMED)

    def __post_init__(self) -> None:
        problems = [*self._normalised(), *self._problems()]
        if problems:
            raise InputError(problems)

    def _normalised(self) -> Iterator[Problem]:
        """Sequences become tuples, numbers float64: a result that was read again equals the one that was written."""
        yield from self._set("legs", lambda legs: tuple(map(_whole, legs)))
        yield from self._set("contractors", _names)
        for name in ("delta", "gap", "time_limit", "eps", "tolerance"):
            yield from self._set(name, _number)
        yield from self._set("node_limit", _whole)
        yield from self._set("half_widths", _numbers)

    def _set(self, name: str, kind: Any) -> Iterator[Problem]:
        value = getattr(self, name)
        if value is None:
            return
        try:
            object.__setattr__(self, name, kind(value))
        except (TypeError, ValueError, OverflowError):
            object.__setattr__(self, name, getattr(Options, name, None))
            yield Problem(name, f"{value!r:.60} is not what this option takes", "see `cpcal certify --help`")

    def _problems(self) -> Iterator[Problem]:
        legs = self.legs or ()
        if self.legs == ():
            yield Problem("legs", "names no leg", "name one at least, or leave it out for all")
        if len(set(legs)) < len(legs):
            yield Problem("legs", "a leg is named twice", "name each once")
        if not _nonnegative(self.delta):
            yield Problem("delta", f"{self.delta} is no half-width", "give a number of mm, 0 or more")
        elif self.delta > LARGEST_DELTA:
            what = f"{self.delta} mm is wider than any robot"
            yield Problem("delta", what, f"give {LARGEST_DELTA} mm (a kilometre) at most")
        if not 0.0 <= self.gap < 1.0:
            yield Problem("gap", f"{self.gap} is no relative gap", "give a number from 0 to below 1, such as 1e-6")
        if self.time_limit is not None and not self.time_limit > 0.0:
            yield Problem("time_limit", f"{self.time_limit} is no time", "give a positive number of seconds")
        if self.node_limit is not None and self.node_limit < 1:
            yield Problem("node_limit", f"{self.node_limit} is no number of boxes", "give a whole number, 1 or more")
        for name in ("eps", "tolerance"):
            value = getattr(self, name)
            if value is not None and not _nonnegative(value):
                yield Problem(name, f"{value} is no tolerance", "give a number of mm, 0 or more")
        choices = {"center": CENTERS, "support": SUPPORTS, "method": METHODS, "arithmetic": ARITHMETICS}
        for name, known in choices.items():
            if getattr(self, name) not in known:
                what = f"{getattr(self, name)!r:.60} is not known"
                yield Problem(name, what, f"use one of {', '.join(known)}")
        if self.method == "timeout":
            yield from self._timeout_problems()

    def _timeout_problems(self) -> Iterator[Problem]:
        if self.eps is not None:
            yield Problem("method", "timeout seeks the smallest eps", "leave eps out")
        if self.time_limit is None:
            remedy = "give a number of seconds a leg, such as 60"
            yield Problem("time_limit", "is missing, and method timeout may go on for ever", remedy)

    def words(self) -> list[str]:
        """The options of `cpcal certify` that say the same; those that decide the answer are always named."""
        out = [] if self.legs is None else ["--legs", ",".join(map(str, self.legs))]
        out += ["--delta", repr(self.delta), "--center", self.center, "--gap", repr(self.gap)]
        out += ["--contractors", ",".join(self.contractors), "--arithmetic", self.arithmetic]
        if self.model is not None:
            out += ["--model", self.model]
        for name, width in self.half_widths.items():
            out += ["--half-width", f"{name}={width!r}"]
        for name in ("eps", "tolerance", "time_limit", "node_limit"):
            value = getattr(self, name)
            out += [] if value is None else [f"--{name.replace('_', '-')}", repr(value)]
        for name, usual in (("method", "bound"), ("support", "few")):
            out += [f"--{name}", getattr(self, name)] if getattr(self, name) != usual else []
        return out


def _nonnegative(value: float) -> bool:
    return math.isfinite(value) and value >= 0.0


def _number(value: Any) -> float:
    if isinstance(value, str | bool):
        raise TypeError
    return float(value)


def _numbers(value: Mapping[str, Any]) -> dict[str, float]:
    return {str(key): _number(number) for key, number in value.items()}


def _whole(value: Any) -> int:
    if isinstance(value, bool):
        raise TypeError
    return operator.index(value)


def _names(value: Sequence[Any]) -> tuple[str, ...]:
    if isinstance(value, str) or not all(isinstance(name, str) for name in value):
        raise TypeError
    return tuple(value)
