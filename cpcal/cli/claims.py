"""What an accepted certificate proves, in sentences; every number rounded to the side that stays proved."""

from __future__ import annotations

from fractions import Fraction as F

from cpcal.checker import Accepted, Point
from cpcal.cli.talk import Talk
from cpcal.common.errors import printable
from cpcal.common.numbers import bracket_text, inner_text, nearest, plain_gap, short

Hull = tuple[tuple[F, ...], tuple[F, ...]]


def tell(talk: Talk, name: str, accepted: Accepted, seconds: float | None = None) -> None:
    """Say what a certificate proves, and how much work the check was."""
    work = f"{accepted.steps} steps" + ("" if seconds is None else f", {nearest(seconds, 1)} s")
    for sentence in sentences(accepted):
        talk.say(f"{name}: {sentence}: PROVED, {work}")


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
        out.append(words.verified(claims.point))
    if claims.enclosure is not None:
        out.append(words.enclosed(claims.cap, claims.enclosure))
    return out


class _NetworkWords:
    """Absence is stated of a part of the box at most, existence of all of it, whatever the rounding."""

    thing = every = "point of the box"
    for_any = for_some = longer = ""

    def __init__(self, accepted: Accepted) -> None:
        self.accepted = accepted
        self.all = f"all {accepted.count} constraints"
        objective = accepted.objective
        self.name = "" if objective is None else printable(accepted.unknowns[objective])
        self.unit = ""

    def down(self, sign: str, value: F | None) -> str:
        """A goal that none reaches, or that all who reach it share something."""
        if value is None:
            return ""
        hi = self.accepted.claims.eps_hi  # the digits are those of the bracket, as in the table of a result
        text = short(bracket_text(value, value)[0]) if hi is None else bracket_text(value, hi)[0]
        return self._goal(sign, text)

    def up(self, value: F | None) -> str:
        """A goal that is reached."""
        return "" if value is None else self._goal("<=", bracket_text(value, value)[1])

    def _goal(self, sign: str, text: str) -> str:
        return f" with {self.name} {sign} {text}{self.unit}" if self.name else ""

    def infeasible(self, cap: F | None) -> str:
        return f"No {self.thing} satisfies {self.all}{self.down('<=', cap)}{self.for_any}"

    def none_below(self, lo: F) -> str:
        return f"No {self.thing} satisfies {self.all}{self.down('<', lo)}{self.for_any}"

    def attained(self, hi: F) -> str:
        return f"Some {self.every} satisfies {self.all}{self.up(hi)}{self.for_some}"

    def verified(self, point: Point) -> str:
        objective = self.accepted.objective
        eps = None if objective is None else point.at[objective]
        if point.holds == self.accepted.chosen:
            return f"The point given satisfies {self.all}{self.up(eps)}{self.for_some}"
        return (
            f"Of {self.all} the point given satisfies {len(point.holds)}{self.up(eps)}{self.for_some}, "
            f"and it fails {len(point.fails)}{self.down('<=', eps)}{self.for_any}"
        )

    def enclosed(self, cap: F | None, hull: Hull) -> str:
        shared = cap is not None and cap == self.accepted.claims.eps_hi
        goal = " as well as that one" if shared else self.down("<=", cap)
        lo, hi = max(self.sides(hull), key=lambda side: side[1] - side[0], default=(F(0), F(0)))
        return (
            f"Every {self.every} that satisfies them{goal}{self.for_some}{self.longer} lies in the enclosure, "
            f"whose sides are at most {plain_gap(lo, hi)}{self.unit} long{self.others(hull)}"
        )

    def sides(self, hull: Hull) -> list[tuple[F, F]]:
        """Of the enclosure, but for the objective."""
        return [side for k, side in enumerate(zip(*hull, strict=True)) if k != self.accepted.objective]

    def others(self, hull: Hull) -> str:
        """The ranges of unknowns that are no lengths."""
        return ""


class _LegWords(_NetworkWords):
    for_any = " for any readings in their sets, with legs longer than that"
    for_some = " for some readings in their sets"
    longer = ", with legs longer than that,"
    every = "x of the certificate's box"

    def __init__(self, accepted: Accepted) -> None:
        super().__init__(accepted)
        self.name, self.unit = "|g|", " mm"
        count, chosen = accepted.count, accepted.chosen
        leg = f"of leg {accepted.leg}"
        if accepted.model not in (None, "plain"):
            leg += f" in the {printable(str(accepted.model))} model"
        self.all = (
            f"all {count} equations {leg}"
            if len(chosen) == count
            else f"the equations {leg} for measurements {', '.join(map(str, chosen))} (from 0)"
        )
        self.thing = self._ranges() or self.every

    def _ranges(self) -> str | None:
        """The box of all unknowns but the objective, rounded inward; None where nothing would be left of a side."""
        of = self.accepted
        inner = [inner_text(lo, hi) for lo, hi in zip(of.lo[:-1], of.hi[:-1], strict=True)]
        if any(F(lo) > F(hi) for lo, hi in inner):
            return None
        names = map(printable, of.unknowns[:-1])
        return f"x with {', '.join(f'{name} in {_range(side)}' for name, side in zip(names, inner, strict=True))}"

    def sides(self, hull: Hull) -> list[tuple[F, F]]:
        return super().sides(hull)[:7]

    def others(self, hull: Hull) -> str:
        extra = [printable(name) for name in self.accepted.unknowns[7:-1]]
        return "".join(
            f", {name} in {_range(bracket_text(*side))}"
            for name, side in zip(extra, super().sides(hull)[7:], strict=True)
        )


def _range(texts: tuple[str, str]) -> str:
    return f"[{', '.join(map(short, texts))}]"
