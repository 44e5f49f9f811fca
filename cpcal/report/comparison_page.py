"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from cpcal.common.numbers import at_least, at_most, bracket_text, short, stated
from cpcal.files.run_folder import REPORT_NAME
from cpcal.questions import LegResult, Result, verdict_of
from cpcal.report.section import Mark, Page, Section, Table, Words, origin, verdict
from cpcal.report.words import LONGER, QUANTIFIER

COMPARISON_PAGE = "compare.html"

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


def comparison_section(found: Compared) -> Section:
    """A line a leg: what each model reaches, and at a tolerance the first model that passes. The proved bounds are a
    part of it."""
    items = []
    for number, legs in _legs(found).items():
        each = []
        for model, leg in legs.items():
            lo, hi, word = leg.bracket.lo, leg.bracket.hi, verdict_of(found[model], leg).word
            reached = at_most(hi) if math.isfinite(hi) else f"above {at_least(lo)}"
            each.append(f"{model} {reached}" + f" {word}" * (_tolerance(found) is not None))
        line = f"leg {number}: {', '.join(each)}"
        if _tolerance(found) is not None:
            good = passing(found, number)
            line += f"; next: accept {good[0]}" if good else "; next: no model passes"
        items.append(line)
    bounds = Section(
        sentences=[Mark(f"{QUANTIFIER} {LONGER}", "quantifier")],
        tables=[comparison_table(found)],
        notes=[
            "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than eps_lo, and "
            "some reach eps_hi. Without a certificate both are proved in outward-rounded arithmetic only. Extra "
            "parameters: all parameters with eps ≤ eps_hi lie there."
        ],
    )
    return Section("Smallest error of each model, mm", items=items, parts=[bounds], style="names")


def write_comparison(
    found: Compared, folder: str | os.PathLike[str], *, stopped: bool = False, title: str | None = None
) -> Path:
    """Write `compare.html`, headed by the campaign's title, beside the runs of the models; its path. The same results
    give the same bytes."""
    first, at = next(iter(found.values())), _tolerance(found)
    models = Section(
        "The models",
        data={
            name: Mark(f"The length of a leg is {result.model.summary}.", "names", link=f"{quote(name)}/{REPORT_NAME}")
            for name, result in found.items()
        },
        notes=[
            "All models look for (a, b, l) in the same box, and contain the plain one where their extra parameters "
            "vanish: none has a larger smallest eps than the plain one.",
            *(result.model.not_compared for result in found.values()),
        ],
    )
    about = "FOLDER: where this page is. It holds a run of each model, with its certificates and a page of its own."
    rests: dict[str, Words] = {
        "Campaign, SHA-256": Mark(first.campaign.sha256, "code"),
        "To check the proofs again": (Mark("cpcal verify FOLDER --campaign CAMPAIGN", "command"), Mark(about, "small")),
    }
    page = Page(
        f"{title or first.campaign.robot}: models compared",
        "models compared",
        title or first.campaign.robot,
        [comparison_section(found), models, origin(rests)],
        ["Interrupted: what is shown was proved until then; the rest is missing."] if stopped else [],
        "" if at is None else f"Which models do the measurements refute at {stated(at)} mm?",
    )
    return page.write(Path(folder) / COMPARISON_PAGE)
