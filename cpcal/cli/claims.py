"""What an accepted certificate proves, in sentences; every number rounded to the side that stays proved."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction as F

from cpcal.checker.claims import Accepted
from cpcal.report import clean
from cpcal.solver.interval import Interval

Hull = tuple[tuple[F, ...], tuple[F, ...]]


def sentences(accepted: Accepted) -> list[str]:
    """One for each claim."""
    claims = accepted.claims
    words = _LegWords(accepted) if accepted.leg is not None else _NetworkWords(accepted)
    out = []
    if claims.infeasible:
        out.append(words.infeasible(claims.cap))
    elif claims.eps_lo is not None:
        out.append(words.none_below(claims.eps_lo))
    if claims.eps_hi is not None:
        out.append(words.attained(claims.eps_hi))
    elif claims.point is not None:
        out.append(words.judged())
    if claims.enclosure is not None:
        out.append(words.enclosed(claims.cap))
    return out


class _NetworkWords:
    thing = one = every = "point of the box"
    for_any = for_some = ""

    def __init__(self, accepted: Accepted) -> None:
        self.accepted = accepted
        self.all = f"all {accepted.count} constraints"

    def goal(self, sign: str, value: F | None, down: bool) -> str:
        if value is None or self.accepted.objective is None:
            return ""
        return f" with {self.name} {sign} {_text(value, down)}"

    @property
    def name(self) -> str:
        return "" if self.accepted.objective is None else clean(self.accepted.unknowns[self.accepted.objective])

    def infeasible(self, cap: F | None) -> str:
        return f"No {self.thing} satisfies {self.all}{self.goal('<=', cap, True)}{self.for_any}"

    def none_below(self, lo: F) -> str:
        return f"No {self.thing} satisfies {self.all}{self.goal('<', lo, True)}{self.for_any}"

    def attained(self, hi: F) -> str:
        return f"One {self.one} satisfies them{self.goal('<=', hi, False)}{self.for_some}"

    def judged(self) -> str:
        point = self.accepted.claims.point
        assert point is not None
        if point.holds == self.accepted.chosen:
            return f"The point given satisfies {self.all}{self.goal('<=', self._eps(point.at), False)}{self.for_some}"
        return (
            f"The given point satisfies {len(point.holds)}{self.for_some}, and fails {len(point.fails)}{self.for_any}, "
            f"of {self.all}{self.goal('=', self._eps(point.at), False)}"
        )

    def _eps(self, at: tuple[F, ...]) -> F | None:
        return None if self.accepted.objective is None else at[self.accepted.objective]

    def enclosed(self, cap: F | None) -> str:
        hull = self.accepted.claims.enclosure
        assert hull is not None
        widths, others = self.widths(hull)
        return (
            f"Every {self.every} that satisfies them{self.goal('<=', cap, True)}{self.for_some} lies in the enclosure, "
            f"whose sides are at most {max(map(float, widths)):.3g} long{others}"
        )

    def widths(self, hull: Hull) -> tuple[list[F], str]:
        """Of the enclosure, but for the objective; and the ranges of unknowns that are no lengths, in words."""
        o = self.accepted.objective
        return [b - a for k, (a, b) in enumerate(zip(*hull, strict=True)) if k != o] or [F(0)], ""


class _LegWords(_NetworkWords):
    for_any = " for any readings in their sets"
    for_some = " for some readings in their sets"
    name = "|g|"
    one = every = "such x"

    def __init__(self, accepted: Accepted) -> None:
        self.accepted = accepted
        count, chosen = accepted.count, accepted.chosen
        numbers = ", ".join(map(str, chosen))
        leg = f"of leg {accepted.leg}" + ("" if accepted.model == "plain" else f" in the {accepted.model} model")
        self.all = (
            f"all {count} equations {leg}"
            if len(chosen) == count
            else f"the equations {leg} for measurements {numbers} (from 0)"
        )
        box = list(zip(accepted.lo, accepted.hi, strict=True))
        center = ", ".join(f"{float(a + b) / 2:.6g}" for a, b in box[:7])
        widest = max(float(b - a) / 2 for a, b in box[:7])
        self.thing = f"x within {widest:.6g} mm of ({center})" + self._ranges(accepted.lo, accepted.hi, inward=True)

    def _ranges(self, lo: Sequence[F], hi: Sequence[F], *, inward: bool) -> str:
        """Of the model's extra parameters."""
        extra = enumerate(self.accepted.unknowns[7:-1], 7)
        return "".join(f", {name} in [{_short(lo[i], not inward)}, {_short(hi[i], inward)}]" for i, name in extra)

    def widths(self, hull: Hull) -> tuple[list[F], str]:
        lo, hi = hull
        return [b - a for a, b in zip(lo[:7], hi[:7], strict=True)], self._ranges(lo, hi, inward=False)

    def goal(self, sign: str, value: F | None, down: bool) -> str:
        return "" if value is None else f" with |g| {sign} {_text(value, down)} mm"


def _text(value: F, down: bool) -> str:
    low, high = f"{Interval(value, value):.9f}".strip("[]").split(", ")
    return low if down else high


def _short(value: F, down: bool) -> str:
    return _text(value, down).rstrip("0").rstrip(".")
