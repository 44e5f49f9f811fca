"""The verdict on a leg: is the model with some parameters right to within a tolerance, whatever the readings are?

Two bounds are proved (DESIGN section 6). No parameters in the box are right to within less than `lo` at every measured
pose, whatever the readings in their sets are; the recommended ones are to within `largest`, again for ALL readings.
So worse sensors make passing harder. Kinds:

    explained       pass: `largest` is within the tolerance; without one: the model fits within the reading uncertainty
    unexplained     fail: `lo` is beyond the tolerance
    bounded         no tolerance was given; the two numbers are the answer
    undecided       neither: the readings are too uncertain to say, or a limit came first
    undetermined    the parameters fit, but so would those of many another robot: the data are too poor for a verdict
    uncompared      a fit, but of constraints that the certificates of a user-defined model state themselves: no pass
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

from cpcal.common.numbers import at_least, at_most, gap_text, stated
from cpcal.models import PARAMETERS
from cpcal.questions.result import Determination, LegResult, Options, Result
from cpcal.solver.accounts import bracket_sentence
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

_FITS = "fits within the stated reading uncertainty"
SHARE = 0.5  # of its side of the box: an enclosure that fills more is wide
KNOWN = 10.0  # mm: a box of this half-width or less states the parameters by itself, and no range in it is wide

Kind = Literal["explained", "unexplained", "bounded", "undecided", "undetermined", "uncompared"]
Wide = tuple[tuple[str, float, float], ...]  # name, lo, hi


class LegVerdict(NamedTuple):
    """What `kind` it is. Proved, in mm: it fails below `lo`, some parameters fit at `hi` for SOME readings, those
    recommended are right to within `largest` for ALL, and it passes from `passes_from` (infinite: nothing is proved).

    tolerance      None: none was given
    beyond         the one error that was asked about, if it is refuted
    determination  if the measurements leave parameters open; `wide`: ranges of more than half of the box, which do not
                   show that their parameters are determined, whatever the rank is
    not_compared   a sentence on a user-defined model, whose constraints nobody compared with the campaign
    """

    kind: Kind
    lo: float
    hi: float
    tolerance: float | None
    largest: float
    passes_from: float
    beyond: float | None
    determination: Determination | None
    wide: Wide
    not_compared: str

    @property
    def passes(self) -> bool:
        return self.kind == "explained"

    @property
    def word(self) -> str:
        """For a table."""
        if self.kind == "uncompared":
            return "not compared"
        if self.tolerance is not None:
            return {"explained": "pass", "unexplained": "fail"}.get(self.kind, self.kind)
        if self.kind in ("explained", "bounded"):
            return _FITS if self.hi == 0.0 else f"fits to within {at_most(self.hi, 7)} mm"
        return "does not fit" if self.kind == "unexplained" else self.kind

    @property
    def thresholds(self) -> str:
        """Both, rounded to the proved side, and never across the tolerance."""
        if math.isinf(self.lo):
            return "no parameters fit"
        below = f"fails below {plain_side(at_least, self.lo, self.tolerance)} mm" if self.lo > 0.0 else _FITS
        if math.isinf(self.passes_from):
            return f"{below}, not shown to pass at any tolerance"
        return f"{below}, passes from {plain_side(at_most, self.passes_from, self.tolerance)} mm"

    @property
    def sentence(self) -> str:
        at = f"{stated(self.tolerance or 0.0)} mm"
        if self.kind == "undetermined":
            but = "so many very different parameters may fit" if self.wide else "which is no test of the model"
            fits = "" if math.isinf(self.hi) else f" Some parameters fit {_within(self.hi)}, {but}."
            said = self.reason + fits
        elif self.beyond is not None:
            asked = f"to within {stated(self.beyond)} mm" if self.beyond else _within(0.0)
            said = f"No parameters fit {asked}."
        elif self.tolerance is None:
            fits = "" if math.isinf(self.hi) else f"; some parameters fit {_within(self.hi)}"
            said = f"The leg {self.thresholds}{fits}."
        elif self.kind in ("explained", "uncompared"):
            right = f"to within {plain_side(at_most, self.largest, self.tolerance)} mm at every measured pose"
            said = (
                f"Pass at {at}: the recommended parameters are right {right}, whatever the readings in their sets are."
            )
        elif self.kind == "unexplained":
            said = f"Fail at {at}: no parameters in the box are right to within it, whatever the readings are."
        else:
            said = f"Undecided at {at}: it {self.thresholds}."
        return f"{said} {self.not_compared}".rstrip()

    @property
    def reason(self) -> str:
        """What the measurements leave open: by their rank, then by the ranges that are proved."""
        said = [] if self.determination is None else [self.determination.sentence]
        if self.wide:
            widths = ", ".join(f"{name} ({gap_text(lo, hi)} mm)" for name, lo, hi in self.wide)
            what = "parameters that may fill more than half of the box"
            said.append(f"The measurements are not shown to determine {what}: {widths}.")
        return " ".join(filter(None, said))

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are open, those of the rank first; none where measurements are too few."""
        rank = () if self.determination is None else self.determination.undetermined
        return tuple(dict.fromkeys((*rank, *(name for name, _, _ in self.wide))))


def _within(error: float) -> str:
    return f"to within {at_most(error, 7)} mm" if error else "within the stated reading uncertainty"


def verdict_of(result: Result, leg: LegResult, tolerance: float | None = None) -> LegVerdict:
    """The verdict on a leg of a result; `tolerance` in mm (default: the one that the result was asked with)."""
    options, bracket = result.options, leg.bracket
    at, eps = options.tolerance if tolerance is None else tolerance, options.eps
    closed, refuted = bracket.verdict is Verdict.PROVED, eps is not None and bracket.verdict is Verdict.REFUTED
    lo, hi = bracket.lo, bracket.hi
    largest = leg.recommended.largest
    passes_from = math.inf if leg.passes_from is None else leg.passes_from.eps
    poor, wide, beyond = leg.determination, _wide(options, leg), None
    if poor is not None and not poor.sentence:
        poor = None
    if eps is not None:  # nothing is known of smaller errors unless it is refuted
        lo, hi = eps if refuted else 0.0, eps if closed else math.inf
        beyond = eps if refuted and (at is None or eps >= at) else None
    kind: Kind = "undecided"
    if beyond is not None or math.isinf(lo) or (at is not None and lo > at):
        kind = "unexplained"
    elif not refuted and (poor is not None or wide):
        kind = "undetermined"
    elif not refuted and (hi == 0.0 if at is None else largest <= at):
        kind = "explained"
    elif at is None and closed and math.isfinite(hi):
        kind = "bounded"
    if kind != "undetermined":
        poor, wide = None, ()
    if result.model.not_compared and kind in ("explained", "bounded"):
        kind = "uncompared"
    return LegVerdict(kind, lo, hi, at, largest, passes_from, beyond, poor, wide, result.model.not_compared)


def recommendation(result: Result, leg: LegResult) -> str:
    """What the recommended parameters are, and whether they conform, in a few words."""
    kind, at, conforms = verdict_of(result, leg).kind, result.options.tolerance, ""
    if at is not None:
        conforms = "; not shown to conform"
        if kind == "unexplained":
            conforms = "; not recommended: fails"
        elif leg.recommended.largest <= at:
            conforms = f"; conforms to {stated(at)} mm" + "; undetermined" * (kind == "undetermined")
    return leg.recommended.why + conforms


def _wide(options: Options, leg: LegResult) -> Wide:
    """Of the parameters as good as the proved point; of no search that a limit ended, nor of one at a larger error.

    The timeout method, and a search with outliers, enclose nothing: what is proved of the parameters are the ranges
    alone, if they were asked for.
    """
    box = leg.bracket.enclosure
    if options.method == "timeout" or options.outliers:
        box = Box.empty(box.names) if leg.ranges is None else leg.ranges.box
    elif leg.bracket.verdict is not Verdict.PROVED and leg.work.pending:
        return ()
    if leg.bracket.point is None or options.eps or box.is_empty or options.delta <= KNOWN:
        return ()
    sides = zip(PARAMETERS, box.lo.tolist(), box.hi.tolist(), strict=False)
    return tuple((name, lo, hi) for name, lo, hi in sides if hi - lo > SHARE * 2.0 * options.delta)


def plain_side(rounded: Callable[[float, int], str], value: float, tolerance: float | None) -> str:
    """Two digits, or as many as leave it on its side of the tolerance."""
    texts = [rounded(value, digits) for digits in range(2, 18)]
    right = (text for text in texts if tolerance is None or (float(text) > tolerance) == (value > tolerance))
    return next(right, texts[-1])


# ------------------------------------------------------------------------------------------------------------------
# What was proved of a leg, in a sentence that is made of the numbers whenever it is shown: none is stored.

INFORMATION = (
    "Information only, proved by no certificate: times, counts, which measurements are the support, second-order "
    "effects, and calls of the solver."
)


def status_of(result: Result, leg: LegResult) -> str:
    """What was proved of a leg of a result, in a sentence."""
    options, bracket, eps = result.options, leg.bracket, stated(result.options.eps or 0.0)
    lo, hi = bracket.lo, bracket.hi
    if options.eps is not None:
        if bracket.verdict is Verdict.PROVED:
            return f"Some x in the box satisfies all equations to within {eps} mm for some readings: proved."
        if bracket.verdict is Verdict.REFUTED:
            what = f"No x in the box, with legs longer than {eps} mm, satisfies all equations to within {eps} mm"
            return f"{what} for any readings: proved."
        return f"Stopped before it was known if any x satisfies the equations to within {eps} mm."
    if hi == 0.0:
        how = "proved in exact arithmetic" if leg.certified else "proved"
        return f"Some x in the box fits within the stated reading uncertainty (for some readings): {how}."
    if options.method == "bound":
        return bracket_sentence(bracket.verdict, lo, hi, floor=leg.work.floor, undecided=leg.work.pending)
    how = f"both bounds are proved; the gap of {gap_text(lo, hi)} is open."
    if bracket.point is None:
        how = "no point was proved to satisfy the constraints; the lower bound is proved."
    elif bracket.verdict is Verdict.PROVED:
        asked = f"the relative gap of {stated(options.gap)} that was asked for"
        how = f"both bounds are proved, {gap_text(lo, hi)} apart, which is within {asked}."
    return f"{len(leg.work.trials)} calls of the solver; {how}"
