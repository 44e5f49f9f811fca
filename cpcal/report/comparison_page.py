"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from cpcal.common.errors import printable
from cpcal.common.numbers import at_least, at_most, bracket_text, short, stated
from cpcal.files.run_folder import REPORT_NAME
from cpcal.questions import LegResult, Result, verdict_of
from cpcal.report.section import Mark, Page, Section, Table, Words, origin, verdict
from cpcal.report.words import LONGER, QUANTIFIER

COMPARISON_PAGE = "compare.html"
_MOST_LINES = 8  # legs that have a line in a terminal
_WORDS = {  # of a model, by the kind of the verdict
    "explained": " pass",
    "unexplained": " fail",
    "undecided": " undecided",
    "undetermined": " undetermined",
    "uncompared": " not compared",
}

Compared = Mapping[str, Result]  # of one campaign, by the leg model; what was asked is the same in all


def _legs(found: Compared) -> dict[int, dict[str, LegResult]]:
    """The legs of all results, each with its models."""
    out: dict[int, dict[str, LegResult]] = {}
    for model, result in found.items():
        for leg in result.legs:
            out.setdefault(leg.leg, {})[model] = leg
    return dict(sorted(out.items()))


def _tolerance(found: Compared) -> float | None:
    return next(iter(found.values())).options.tolerance


def passing(found: Compared, leg: int) -> list[str]:
    """The models that pass for a leg."""
    return [model for model, one in _legs(found)[leg].items() if verdict_of(found[model], one).passes]


def comparison_table(found: Compared) -> Table:
    """A row a leg and model. Bounds are rounded to the side on which they stay proved."""
    rows: list[Sequence[Words]] = []
    for number, legs in _legs(found).items():
        for model, leg in legs.items():
            judged, bracket, ranges = verdict_of(found[model], leg), leg.bracket, []
            for name in () if bracket.enclosure.is_empty else bracket.enclosure.names[7:]:
                side = bracket.enclosure[name]
                ranges.append(f"{name} in [{', '.join(map(short, bracket_text(side.lo, side.hi)))}]")
            word, file = verdict(judged.word, judged.kind), bracket.certificate or "none"
            rows.append((f"leg {number}", model, *bracket_text(bracket.lo, bracket.hi), word, file, ", ".join(ranges)))
    at = _tolerance(found)
    asked = "verdict" if at is None else f"at {stated(at)} mm"
    head = ("of", "model", "eps_lo [mm]", "eps_hi [mm]", asked, "certificate", "extra parameters")
    return Table(head, rows, ("", "word", "", "", "word", "word", "word"), "compared")


def comparison_lines(found: Compared) -> list[str]:
    """A line a leg, for a terminal: what each model reaches, and at a tolerance the first model that passes."""
    out, every = [f"{next(iter(found.values())).campaign.robot}: smallest error of each model, mm"], _legs(found)
    for number, legs in list(every.items())[:_MOST_LINES]:
        each = []
        for model, leg in legs.items():
            lo, hi = leg.bracket.lo, leg.bracket.hi
            word = "" if _tolerance(found) is None else _WORDS[verdict_of(found[model], leg).kind]
            each.append(f"{model} {at_most(hi) if math.isfinite(hi) else f'above {at_least(lo)}'}{word}")
        line = f"leg {number}: {', '.join(each)}"
        if _tolerance(found) is not None:
            good = passing(found, number)
            line += f"; next: accept {good[0]}" if good else "; next: no model passes"
        out.append(printable(line))
    if len(every) > _MOST_LINES:
        out.append(f"and {len(every) - _MOST_LINES} more, which the page shows")
    return out


def write_comparison(
    found: Compared, folder: str | os.PathLike[str], *, stopped: bool = False, title: str | None = None
) -> Path:
    """Write `compare.html`, headed by the campaign's title, beside the runs of the models; its path. The same results
    give the same bytes."""
    first, at = next(iter(found.values())), _tolerance(found)
    answers = Section(
        "Answers",
        items=comparison_lines(found)[1:],
        parts=[
            Section(
                sentences=[Mark(f"{QUANTIFIER} {LONGER}", "quantifier")],
                tables=[comparison_table(found)],
                notes=[
                    "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than "
                    "eps_lo, and some reach eps_hi. Without a certificate both are proved in outward-rounded "
                    "arithmetic only. Extra parameters: all parameters with eps ≤ eps_hi lie there."
                ],
            )
        ],
        style="names",
    )
    same = (
        "All models look for (a, b, l) in the same box, and contain the plain one where their extra parameters vanish: "
        "none has a larger smallest eps than the plain one."
    )
    data = {
        name: Mark(f"The length of a leg is {result.model.summary}.", "names", link=f"{quote(name)}/{REPORT_NAME}")
        for name, result in found.items()
    }
    strange = [result.model.not_compared for result in found.values() if result.model.not_compared]
    about = "FOLDER: where this page is. It holds a run of each model, with its certificates and a page of its own."
    rests: dict[str, Words] = {
        "Campaign, SHA-256": Mark(first.campaign.sha256, "code"),
        "To check the proofs again": (
            Mark("cpcal verify FOLDER --campaign CAMPAIGN", "command"),
            Mark(about, "small"),
        ),
    }
    page = Page(
        f"{title or first.campaign.robot}: models compared",
        "models compared",
        title or first.campaign.robot,
        [answers, Section("The models", data=data, notes=[same, *strange]), origin(rests)],
        ["Interrupted: what is shown was proved until then; the rest is missing."] if stopped else [],
        "How small can the error of each model be?"
        if at is None
        else f"Which models do the measurements refute at {stated(at)} mm?",
    )
    return page.write(Path(folder) / COMPARISON_PAGE)
