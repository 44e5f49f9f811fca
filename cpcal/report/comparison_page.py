"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

from markupsafe import Markup

from cpcal.common.atomic import write_file
from cpcal.common.errors import printable
from cpcal.common.numbers import at_least, at_most, bracket_text, short, stated
from cpcal.report.dots import comparison_svg, legend
from cpcal.report.origin import versions
from cpcal.report.template import rendered
from cpcal.report.words import LONGER, QUANTIFIER
from cpcal.results import Comparison, Entry, Explained, Undetermined
from cpcal.solver.contract import Verdict

COMPARISON_PAGE = "compare.html"
_MOST_LINES = 8  # subjects that have a line in a terminal
_WORDS = {  # of a model at a tolerance, by the kind of the verdict
    "explained": "pass",
    "unexplained": "fail",
    "bounded": "",
    "undecided": "undecided",
    "undetermined": "undetermined",
    "uncompared": "not compared",
}


def comparison_header(comparison: Comparison) -> tuple[str, ...]:
    unit = _unit(comparison)
    at = "at the tolerance" if comparison.tolerance is None else f"at {stated(comparison.tolerance)}{unit}"
    bounds = ("eps_lo [mm]", "eps_hi [mm]") if unit else ("eps_lo", "eps_hi")
    extra = ("extra parameters",) if comparison.campaign_sha256 else ()
    return ("of", "model", *bounds, at, "certificate", *extra)


def _unit(comparison: Comparison) -> str:
    """Of eps: that of user-defined networks is known to their makers."""
    return " mm" if comparison.campaign_sha256 else ""


def comparison_row(comparison: Comparison, entry: Entry) -> tuple[str, ...]:
    """Bounds are rounded to the side on which they stay proved."""
    word = entry.word(comparison.tolerance, comparison.options)
    certificate = "none" if entry.certificate is None else entry.certificate
    extra = (_extra(entry),) if comparison.campaign_sha256 else ()
    return (entry.subject, entry.model, *bracket_text(entry.eps_lo, entry.eps_hi), word, certificate, *extra)


def _extra(entry: Entry) -> str:
    """Enclosures of a leg's parameters beyond (a, b, l), of all parameters with eps <= eps_hi."""
    box = entry.enclosure
    if box.is_empty:
        return ""
    texts = []
    for k, name in enumerate(box.names[7:], start=7):
        lo, hi = bracket_text(float(box.lo[k]), float(box.hi[k]))
        texts.append(f"{name} in [{short(lo)}, {short(hi)}]")
    return ", ".join(texts)


def said(comparison: Comparison) -> str:
    """For which readings, and of which legs, all of it is meant."""
    if comparison.campaign_sha256:
        return f"{QUANTIFIER} {LONGER}"
    return "A point satisfies a network when one value of every reading in its set satisfies all constraints."


def comparison_sentences(comparison: Comparison) -> list[str]:
    """What the comparison shows, a sentence a model; refutations first say with which proof."""
    tolerance = comparison.tolerance
    if tolerance is None:
        return []
    out, at = [], f"{stated(tolerance)}{_unit(comparison)}"
    for model in comparison.models:
        entries = [e for e in comparison.entries if e.model == model]
        refuted = [e for e in entries if e.verdict(tolerance) is Verdict.REFUTED]
        open_ones = [e for e in entries if e.verdict(tolerance) is Verdict.UNKNOWN]
        if refuted:
            names = ", ".join(f"{e.subject} ({e.certificate or 'unchecked'})" for e in refuted)
            text = f"{model} is refuted at {at} for {len(refuted)} of {len(entries)}: {names}."
        else:
            text = f"{model} is refuted at {at} for none of {len(entries)}."
        if open_ones:
            text += f" Not known for {', '.join(e.subject for e in open_ones)}."
        poor = [e for e in entries if e.leg_verdict(tolerance, comparison.options).kind == Undetermined.kind]
        if poor:
            text += f" Undetermined for {', '.join(e.subject for e in poor)}: the measurements leave parameters open."
        out.append(text)
    return out


def comparison_lines(comparison: Comparison) -> list[str]:
    """A line a subject, for a terminal: what each model reaches, and at a tolerance the first model that passes."""
    out = [f"{comparison.title}: smallest error of each model{_unit(comparison).replace(' ', ', ', 1)}"]
    subjects = list(dict.fromkeys(entry.subject for entry in comparison.entries))
    for subject in subjects[:_MOST_LINES]:
        entries = [entry for entry in comparison.entries if entry.subject == subject]
        line = f"{subject}: " + ", ".join(_short(comparison, entry) for entry in entries)
        if comparison.tolerance is not None:
            good = [
                e.model
                for e in entries
                if isinstance(e.leg_verdict(comparison.tolerance, comparison.options), Explained)
            ]
            line += f"; next: accept {good[0]}" if good else "; next: no model passes"
        out.append(printable(line))
    if len(subjects) > _MOST_LINES:
        out.append(f"and {len(subjects) - _MOST_LINES} more, which the page shows")
    return out


def _short(comparison: Comparison, entry: Entry) -> str:
    hi = at_most(entry.eps_hi) if math.isfinite(entry.eps_hi) else f"above {at_least(entry.eps_lo)}"
    word = (
        ""
        if comparison.tolerance is None
        else f" {_WORDS[entry.leg_verdict(comparison.tolerance, comparison.options).kind]}"
    )
    return f"{entry.model} {hi}{word}"


def write_comparison(comparison: Comparison, folder: str | os.PathLike[str]) -> Path:
    """Write `compare.html` into the folder; its path. The same comparison gives the same bytes."""
    return write_file(Path(folder) / COMPARISON_PAGE, rendered("compare.html.j2", _context(comparison)))


def _context(comparison: Comparison) -> dict[str, Any]:
    tolerance = comparison.tolerance
    rows = []
    for entry in comparison.entries:
        style = "" if tolerance is None else entry.leg_verdict(tolerance, comparison.options).kind
        rows.append({"cells": comparison_row(comparison, entry), "style": style})
    return {
        "title": printable(comparison.title),
        "tolerance": None if tolerance is None else f"{stated(tolerance)}{_unit(comparison)}",
        "interrupted": comparison.interrupted,
        "lines": comparison_lines(comparison)[1:],
        "sentences": comparison_sentences(comparison),
        "header": comparison_header(comparison),
        "rows": rows,
        "figure": Markup(comparison_svg(comparison)) if comparison.entries else None,  # made by us
        "legend": legend(list(comparison.models)),
        "models": comparison.models,
        "sha256": comparison.campaign_sha256,
        "said": said(comparison),
        "versions": versions(),
        "certificates": any(e.certificate for e in comparison.entries),
    }
