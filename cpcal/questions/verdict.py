"""The verdict on a leg: how well its model explains the data, and whether that is good enough.

"Explains the data to within e" means: some parameters in the box satisfy every equation to within e, THERE EXISTS for
each measurement a reading in its set. Both sides of a verdict are proved. Its kinds:

    explained       within the tolerance, or without any error: a pass
    unexplained     no parameters reach the tolerance: a fail
    bounded         no tolerance was given; the smallest error is known from both sides
    undecided       a limit came first
    undetermined    the parameters fit, but so would those of many another robot: the data are too poor for a verdict
    uncompared      a fit, but of constraints that the certificates of a user-defined model state themselves: no pass
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from cpcal.common.numbers import bracket_text, gap_text, short, stated
from cpcal.questions.result import (
    NOTHING_WIDE,
    Determination,
    LegResult,
    Options,
    Result,
    Wide,
    not_compared,
    wide,
)
from cpcal.solver.accounts import bracket_sentence
from cpcal.solver.contract import Verdict

Found = Literal["explained", "unexplained", "bounded", "undecided", "undetermined"]


@dataclass(frozen=True)
class LegVerdict:
    """What was `found`. Proved: no error below `lo` explains the data, `hi` does (infinite: none is known to), in mm.

    tolerance      None: none was given
    beyond         the one error that was asked about, if it is refuted
    determination  if the measurements leave parameters open; `wide`: ranges that do
    model          a user-defined one, whose constraints nobody compared with the campaign
    """

    found: Found
    lo: float
    hi: float
    tolerance: float | None = None
    beyond: float | None = None
    determination: Determination | None = None
    wide: Wide = NOTHING_WIDE
    model: str = ""

    @property
    def kind(self) -> Found | Literal["uncompared"]:
        return "uncompared" if self.model and self.found in ("explained", "bounded") else self.found

    @property
    def passes(self) -> bool:
        return self.kind == "explained"

    @property
    def word(self) -> str:
        """For a table."""
        if self.kind == "uncompared":
            return "not compared"
        if self.found == "unexplained":
            return "does not explain" if self.tolerance is None else "fail"
        if self.found not in ("explained", "bounded"):
            return self.found
        return "pass" if self.tolerance is not None else f"explains {self.within if self.hi else 'the data'}"

    @property
    def sentence(self) -> str:
        said = self._said()
        if self.tolerance is not None and self.found != "undetermined" and math.isfinite(self.lo):
            said += f"; the tolerance is {stated(self.tolerance)} mm"
        said += "." * (self.found != "undetermined")
        return f"{said} {not_compared(self.model)}" if self.model else said

    def _said(self) -> str:
        explains = "The model explains the data"
        if self.found == "undetermined":
            but = (
                "which is no test of the model" if self.determination is not None else "and so may very different ones"
            )
            return self.reason + f" Some parameters explain the data {self.within}, {but}." * math.isfinite(self.hi)
        if self.found == "unexplained":
            if self.beyond is not None:
                return f"The model cannot explain the data {self.error}"
            if math.isinf(self.lo):
                return "The model cannot explain the data at any error that it allows"
            return f"{explains} {self.no_better}"
        known = [self.within] * math.isfinite(self.hi)
        known += [self.no_better] * (self.found == "bounded" or (self.found == "undecided" and self.lo > 0.0))
        return f"{explains} {', and '.join(known)}" if known else "Nothing is known of the error"

    @property
    def error(self) -> str:
        """The one that was asked about, if it is refuted."""
        return "" if self.beyond is None else f"to within {stated(self.beyond)} mm" if self.beyond else "exactly"

    @property
    def no_better(self) -> str:
        return f"no better than {self._bounds()[0]}"

    @property
    def within(self) -> str:
        return "exactly" if self.hi == 0.0 else f"to within {self._bounds()[1]}"

    @property
    def range(self) -> str:
        """Both bounds."""
        lo, hi = self._bounds()
        return f"{lo} to {hi}" if math.isfinite(self.hi) else f"at least {lo}"

    def _bounds(self) -> list[str]:
        return [f"{text if self.lo > 0.0 else short(text)} mm" for text in bracket_text(self.lo, self.hi)]

    @property
    def reason(self) -> str:
        """What the measurements leave open: by their rank, then by the ranges that are proved."""
        rank = "" if self.determination is None else self.determination.sentence
        return " ".join(filter(None, (rank, self.wide.sentence)))

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are open, those of the rank first; none where measurements are too few."""
        rank = () if self.determination is None else self.determination.undetermined
        return tuple(dict.fromkeys((*rank, *self.wide.names)))


def verdict_of(result: Result, leg: LegResult, tolerance: float | None = None) -> LegVerdict:
    """The verdict on a leg of a result; `tolerance` in mm (default: the one that the result was asked with)."""
    at, eps = result.options.tolerance if tolerance is None else tolerance, result.options.eps
    if eps is not None:
        found = _verdict_at(result.options, eps, leg, at)
    else:
        hi = leg.bracket.hi if leg.bracket.point is not None else math.inf
        closed, known = leg.bracket.verdict is Verdict.PROVED, _wide(result.options, leg)
        found = verdict_on(leg.bracket.lo, hi, at, closed=closed, determination=leg.determination, ranges=known)
    return found if result.model.is_ours else replace(found, model=result.model.name)


def _wide(options: Options, leg: LegResult) -> Wide:
    """Of the parameters as good as the proved point; of no search that a limit ended, nor of one at a larger error.

    The timeout method encloses nothing: what is proved of the parameters are the ranges alone, if they were asked for.
    """
    ended = leg.bracket.verdict is Verdict.PROVED or not leg.work.pending
    if leg.bracket.point is None or options.eps:
        return NOTHING_WIDE
    if options.method == "timeout":
        return NOTHING_WIDE if leg.ranges is None else wide(leg.ranges.box, options.delta)
    return wide(leg.bracket.enclosure, options.delta) if ended else NOTHING_WIDE


def _verdict_at(options: Options, eps: float, leg: LegResult, tolerance: float | None) -> LegVerdict:
    """Where one error was asked about, nothing is known of smaller ones unless it is refuted."""
    if leg.bracket.verdict is Verdict.REFUTED:
        if tolerance is None or eps >= tolerance:
            return LegVerdict("unexplained", eps, math.inf, tolerance, beyond=eps)
        return LegVerdict("undecided", eps, math.inf, tolerance)
    hi, at = eps if leg.bracket.verdict is Verdict.PROVED else math.inf, eps if tolerance is None else tolerance
    found = verdict_on(0.0, hi, at, determination=leg.determination, ranges=_wide(options, leg))
    return replace(found, tolerance=tolerance)


def verdict_on(
    lo: float,
    hi: float,
    tolerance: float | None,
    *,
    closed: bool = False,
    determination: Determination | None = None,
    ranges: Wide = NOTHING_WIDE,
) -> LegVerdict:
    """The verdict on a proved bracket; `closed`: it is as narrow as was asked for. `ranges`: those that are wide."""
    if math.isinf(lo) or (tolerance is not None and lo > tolerance):
        return LegVerdict("unexplained", lo, hi, tolerance)
    poor = determination if determination is not None and not determination.tests_the_model else None
    if poor is not None or ranges.names:
        return LegVerdict("undetermined", lo, hi, tolerance, determination=poor, wide=ranges)
    if hi == 0.0 or (tolerance is not None and hi <= tolerance):
        return LegVerdict("explained", lo, hi, tolerance)
    if tolerance is None and closed and math.isfinite(hi):
        return LegVerdict("bounded", lo, hi)
    return LegVerdict("undecided", lo, hi, tolerance)


# ------------------------------------------------------------------------------------------------------------------
# What was proved of a leg, in a sentence that is made of the numbers whenever it is shown: none is stored.

INFORMATION = (
    "Information only, proved by no certificate: times, counts, which measurements are the support (unless it has a "
    "certificate of its own), what is said of the center as a solution, polygons, second-order effects, calls of the "
    "solver, and what was found beyond the certificates."
)


def proved_sentence(options: Options, leg: LegResult) -> str:
    """What was proved, and what all contractors found beyond the certificate."""
    return _proved(options, leg) + _beyond(options, leg)


def status_of(result: Result, leg: LegResult) -> str:
    """What was proved of a leg of a result, in a sentence."""
    return proved_sentence(result.options, leg)


def calls_sentence(calls: int, lo: float, hi: float, gap: float, *, closed: bool) -> str:
    """Of the paper's script: so many calls of the solver led to the bracket [lo, hi]; `gap`: the relative one asked."""
    if not math.isfinite(hi):
        how = "no point was proved to satisfy the constraints; the lower bound is proved."
    elif closed:
        asked = f"the relative gap of {stated(gap)} that was asked for"
        how = f"both bounds are proved, {gap_text(lo, hi)} apart, which is within {asked}."
    else:
        how = f"both bounds are proved; the gap of {gap_text(lo, hi)} is open."
    return f"{calls} calls of the solver; {how}"


def contractors_sentences(leg: LegResult) -> list[str]:
    """For each contractor that was asked for how much it took part. Counts are information, nobody proves them."""
    out = []
    for use in leg.work.contractors_used:
        held = f", {use.certified_steps:,} of them in the certificate" if leg.certified else ""
        out.append(f"{use.name}: {_count(use.calls, 'call')}, {_count(use.steps, 'step')}{held}")
    return out


def information(options: Options, leg: LegResult) -> list[str]:
    """What `verify` says of a leg besides what is proved: the parts of the contractors, what was found beyond."""
    beyond = _beyond(options, leg).strip()
    found = [f"found, but not certified: {beyond}"] if beyond else []
    uses = contractors_sentences(leg)
    return found + ([f"contractors: {'; '.join(uses)}"] if uses else [])


def _proved(options: Options, leg: LegResult) -> str:
    if options.eps is not None:
        return _at(stated(options.eps), leg.bracket.verdict)
    if leg.not_refuted:
        how = "proved in exact arithmetic" if leg.certified else "proved"
        return f"Some x in the box satisfies every equation exactly for some readings: {how}."
    hi = leg.bracket.hi if leg.bracket.point is not None else math.inf
    if options.method == "timeout":
        closed = leg.bracket.verdict is Verdict.PROVED
        return calls_sentence(len(leg.work.trials), leg.bracket.lo, hi, options.gap, closed=closed)
    return bracket_sentence(leg.bracket.verdict, leg.bracket.lo, hi, floor=leg.work.floor, undecided=leg.work.pending)


def _at(eps: str, verdict: Verdict) -> str:
    if verdict is Verdict.PROVED:
        return f"Some x in the box satisfies all equations to within {eps} mm for some readings: proved."
    if verdict is Verdict.REFUTED:
        return (
            f"No x in the box, with legs longer than {eps} mm, satisfies all equations to within {eps} mm for any "
            "readings: proved."
        )
    return f"Stopped before it was known if any x satisfies the equations to within {eps} mm."


def _beyond(options: Options, leg: LegResult) -> str:
    if leg.found is None:
        return ""
    none_at_eps = options.eps is not None and leg.found.lo > leg.bracket.lo
    return (replace(leg.found, lo=math.inf) if none_at_eps else leg.found).sentence(leg.bracket.lo)


def _count(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'' if number == 1 else 's'}"
