"""The verdict on a leg: how well its model explains the data, and whether that is good enough.

"Explains the data to within e" means: some parameters in the box satisfy every equation to within e, THERE EXISTS for
each measurement a reading in its set. Both sides of a verdict are proved; what is not known is of a type of its own.

    Explained       within the tolerance, or without any error: a pass
    Unexplained     no parameters reach the tolerance: a fail
    Bounded         no tolerance was given; the smallest error is known from both sides
    Undecided       a limit came first
    Undetermined    the parameters fit, but the data are too poor to say that the model does
    Uncompared      a fit, but of constraints that the certificates of a user-defined model state themselves: no pass
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from cpcal.common.numbers import bracket_text, gap_text, short, stated
from cpcal.questions.result import (
    NOTHING_WIDE,
    Determination,
    LegResult,
    ModelNote,
    Options,
    Result,
    Wide,
    not_compared,
    wide,
)
from cpcal.solver.accounts import bracket_sentence
from cpcal.solver.contract import Verdict


@dataclass(frozen=True)
class EpsBracket:
    """Proved: no error below `lo` explains the data, `hi` does (infinite: none is known to). `unit`: "mm", or none."""

    lo: float
    hi: float
    unit: str = "mm"

    @property
    def no_better(self) -> str:
        return f"no better than {self._text(0)}"

    @property
    def within(self) -> str:
        return "exactly" if self.hi == 0.0 else f"to within {self._text(1)}"

    @property
    def range(self) -> str:
        """Both bounds."""
        return f"{self._text(0)} to {self._text(1)}" if math.isfinite(self.hi) else f"at least {self._text(0)}"

    def _text(self, side: int) -> str:
        text = bracket_text(self.lo, self.hi)[side]
        return f"{text if self.lo > 0.0 else short(text)} {self.unit}".strip()


@dataclass(frozen=True)
class Explained:
    """Pass. `tolerance` None: none was given, and the data are explained without any error, or to the one asked."""

    bracket: EpsBracket
    tolerance: float | None
    kind: ClassVar[str] = "explained"

    @property
    def word(self) -> str:
        if self.tolerance is not None:
            return "pass"
        return "explains the data" if self.bracket.hi == 0.0 else f"explains {self.bracket.within}"

    @property
    def sentence(self) -> str:
        return f"The model explains the data {self.bracket.within}{_asked(self.tolerance, self.bracket)}."


@dataclass(frozen=True)
class Unexplained:
    """Fail. `beyond`: the error asked about, which is refuted; None when `bracket.lo` is what is proved."""

    bracket: EpsBracket
    tolerance: float | None
    beyond: float | None = None
    kind: ClassVar[str] = "unexplained"

    @property
    def word(self) -> str:
        return "does not explain" if self.tolerance is None else "fail"

    @property
    def sentence(self) -> str:
        if self.beyond is not None:
            error = "exactly" if self.beyond == 0.0 else f"to within {stated(self.beyond)} {self.bracket.unit}"
            return f"The model cannot explain the data {error}{_asked(self.tolerance, self.bracket)}."
        if math.isinf(self.bracket.lo):
            return "The model cannot explain the data at any error that it allows."
        asked = _asked(self.tolerance, self.bracket)
        return f"The model explains the data {self.bracket.no_better}{asked}."


@dataclass(frozen=True)
class Bounded:
    """Neither pass nor fail: no tolerance was given."""

    bracket: EpsBracket
    kind: ClassVar[str] = "bounded"

    @property
    def word(self) -> str:
        return f"explains {self.bracket.within}"

    @property
    def sentence(self) -> str:
        return f"The model explains the data {self.bracket.within}, and {self.bracket.no_better}."


@dataclass(frozen=True)
class Undecided:
    bracket: EpsBracket
    tolerance: float | None
    kind: ClassVar[str] = "undecided"
    word: ClassVar[str] = "undecided"

    @property
    def sentence(self) -> str:
        known = []
        if math.isfinite(self.bracket.hi):
            known.append(self.bracket.within)
        if self.bracket.lo > 0.0:
            known.append(self.bracket.no_better)
        said = f"The model explains the data {', and '.join(known)}" if known else "Nothing is known of the error"
        return f"{said}{_asked(self.tolerance, self.bracket)}."


@dataclass(frozen=True)
class Undetermined:
    """Some parameters fit, but so would those of many another robot. No pass, whatever the tolerance.

    `determination`: None where only the ranges are `wide`.
    """

    bracket: EpsBracket
    determination: Determination | None
    tolerance: float | None
    wide: Wide = NOTHING_WIDE
    kind: ClassVar[str] = "undetermined"
    word: ClassVar[str] = "undetermined"

    @property
    def sentence(self) -> str:
        if math.isinf(self.bracket.hi):
            return self.reason
        but = "which is no test of the model" if self.determination is not None else "and so may very different ones"
        return f"{self.reason} Some parameters explain the data {self.bracket.within}, {but}."

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


@dataclass(frozen=True)
class Uncompared:
    """Whatever was found with a user-defined `model`: nobody compared its constraints with the campaign. No pass."""

    found: Explained | Unexplained | Bounded | Undecided | Undetermined
    model: str

    @property
    def bracket(self) -> EpsBracket:
        return self.found.bracket

    @property
    def fits(self) -> bool:
        """Whether it would be a pass, or a fit, of a model of cpcal."""
        return isinstance(self.found, Explained | Bounded)

    @property
    def kind(self) -> str:
        return "uncompared" if self.fits else self.found.kind

    @property
    def word(self) -> str:
        return "not compared" if self.fits else self.found.word

    @property
    def sentence(self) -> str:
        return f"{self.found.sentence} {not_compared(self.model)}"


LegVerdict = Explained | Unexplained | Bounded | Undecided | Undetermined | Uncompared


def verdict_of(result: Result, leg: LegResult, tolerance: float | None = None) -> LegVerdict:
    """The verdict on a leg of a result; `tolerance` in mm (default: the one that the result was asked with)."""
    return compared(_verdict(result, leg, tolerance), result.model.name)


def compared(verdict: LegVerdict, model: str) -> LegVerdict:
    """The verdict; of a user-defined model as one on constraints that were not compared with the campaign."""
    return verdict if ModelNote(model).is_ours or isinstance(verdict, Uncompared) else Uncompared(verdict, model)


def _verdict(result: Result, leg: LegResult, tolerance: float | None) -> LegVerdict:
    at = result.options.tolerance if tolerance is None else tolerance
    eps = result.options.eps
    if eps is not None:
        return _verdict_at(result.options, eps, leg, at)
    hi = leg.bracket.hi if leg.bracket.point is not None else math.inf
    closed = leg.bracket.verdict is Verdict.PROVED
    bracket, known = EpsBracket(leg.bracket.lo, hi), _wide(result.options, leg)
    return verdict_on(bracket, at, closed=closed, determination=leg.determination, ranges=known)


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
        bracket = EpsBracket(eps, math.inf)
        failed = tolerance is None or eps >= tolerance
        return Unexplained(bracket, tolerance, beyond=eps) if failed else Undecided(bracket, tolerance)
    bracket = EpsBracket(0.0, eps if leg.bracket.verdict is Verdict.PROVED else math.inf)
    at = eps if tolerance is None else tolerance
    found = verdict_on(bracket, at, determination=leg.determination, ranges=_wide(options, leg))
    return replace(found, tolerance=tolerance) if isinstance(found, Explained | Undecided | Undetermined) else found


def verdict_on(
    bracket: EpsBracket,
    tolerance: float | None,
    *,
    closed: bool = False,
    determination: Determination | None = None,
    ranges: Wide | None = None,
) -> LegVerdict:
    """The verdict on a proved bracket; `closed`: it is as narrow as was asked for. `ranges`: those that are wide."""
    if math.isinf(bracket.lo) or (tolerance is not None and bracket.lo > tolerance):
        return Unexplained(bracket, tolerance)
    poor = determination is not None and not determination.tests_the_model
    if poor or (ranges is not None and ranges.names):
        return Undetermined(bracket, determination if poor else None, tolerance, ranges or NOTHING_WIDE)
    if bracket.hi == 0.0 or (tolerance is not None and bracket.hi <= tolerance):
        return Explained(bracket, tolerance)
    if tolerance is None and closed and math.isfinite(bracket.hi):
        return Bounded(bracket)
    return Undecided(bracket, tolerance)


def _asked(tolerance: float | None, bracket: EpsBracket) -> str:
    if tolerance is None:
        return ""
    return f"; the tolerance is {f'{stated(tolerance)} {bracket.unit}'.strip()}"


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
