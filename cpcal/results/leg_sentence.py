"""What was proved of a leg, in a sentence that is made of the numbers whenever it is shown: none is stored."""

from __future__ import annotations

import math

from cpcal.common.numbers import gap_text, stated
from cpcal.results.options import Options
from cpcal.results.result import LegResult, Result
from cpcal.solver.accounts import Found, bracket_sentence
from cpcal.solver.contract import Verdict

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
    for use in leg.contractors_used:
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
        return _at(stated(options.eps), leg.verdict)
    if leg.not_refuted:
        how = "proved in exact arithmetic" if leg.certified else "proved"
        return f"Some x in the box satisfies every equation exactly for some readings: {how}."
    hi = leg.eps_hi if leg.point is not None else math.inf
    if options.method == "timeout":
        closed = leg.verdict is Verdict.PROVED
        return calls_sentence(len(leg.trials), leg.eps_lo, hi, options.gap, closed=closed)
    return bracket_sentence(leg.verdict, leg.eps_lo, hi, floor=leg.floor, undecided=leg.pending)


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
    if leg.found_lo is None and leg.found_enclosure is None:
        return ""
    lo = leg.eps_lo if leg.found_lo is None else leg.found_lo
    none_at_eps = options.eps is not None and leg.found_lo is not None
    enclosure = leg.enclosure if leg.found_enclosure is None else leg.found_enclosure
    return Found(math.inf if none_at_eps else lo, enclosure).sentence(leg.eps_lo)


def _count(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'' if number == 1 else 's'}"
