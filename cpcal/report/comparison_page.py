"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from cpcal.common.errors import printable
from cpcal.common.files import write_file
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, short, stated
from cpcal.files import load_campaign_json
from cpcal.files.run_folder import REPORT_NAME
from cpcal.files.tables import csv_table
from cpcal.questions import LegResult, Result, verdict_of
from cpcal.report.section import Mark, Page, Section, Table, Words, origin, verdict
from cpcal.report.words import LONGER, QUANTIFIER, SHORT_QUANTIFIER, overall

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


def comparison_sentences(found: Compared) -> list[str]:
    """What the comparison shows, a sentence a model; refutations first say with which proof."""
    tolerance, out = _tolerance(found), list[str]()
    if tolerance is None:
        return out
    for model, result in found.items():
        legs = result.legs
        refuted = [leg for leg in legs if leg.bracket.lo > tolerance]
        names = ", ".join(f"leg {leg.leg} ({leg.bracket.certificate or 'unchecked'})" for leg in refuted)
        count = f"{len(refuted)} of {len(legs)}: {names}" if refuted else f"none of {len(legs)}"
        text = f"{model} is refuted at {stated(tolerance)} mm for {count}."
        unknown = [f"leg {leg.leg}" for leg in legs if leg.bracket.lo <= tolerance < leg.bracket.hi]
        poor = [f"leg {leg.leg}" for leg in legs if verdict_of(result, leg).kind == "undetermined"]
        if unknown:
            text += f" Not known for {', '.join(unknown)}."
        if poor:
            text += f" Undetermined for {', '.join(poor)}: the measurements leave parameters open."
        out.append(text)
    return out


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
    """Write `compare.html`, headed by the campaign's title, and `summary.csv` beside the runs of the models; the page's
    path. The same results give the same bytes."""
    first, at = next(iter(found.values())), _tolerance(found)
    rows = (CampaignRow(name, result) for name, result in found.items() if result.legs)
    write_file(Path(folder) / SUMMARY_TABLE, summary_table(rows))
    answers = Section(
        "Answers",
        items=[*comparison_lines(found)[1:], *comparison_sentences(found)],
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


# ------------------------------------------------------------------------------------------------------------------
# The summary of many campaigns: a page and a table, the worst first.

SUMMARY_PAGE = "summary.html"
SUMMARY_TABLE = "summary.csv"
_LINES = 5  # campaigns that are printed
_HEADER = ("run", "leg", "verdict", "eps_lo_mm", "eps_hi_mm", "certified", "nodes", "seconds")


@dataclass(frozen=True)
class CampaignRow:
    """A campaign, or a model, by the name of its folder, and what was found: at least one leg."""

    name: str
    result: Result

    @property
    def worst(self) -> LegResult:
        return max(self.result.legs, key=lambda leg: (leg.bracket.lo, leg.bracket.hi))

    @property
    def seconds(self) -> float:
        return sum(leg.work.seconds for leg in self.result.legs)


def write_campaigns(rows: Sequence[CampaignRow], failed: Sequence[str], missing: int, folder: Path) -> list[str]:
    """Write `summary.html` and `summary.csv`, sorted by the worst leg's eps; `missing` were not begun. What is printed.

    Raises InputError.
    """
    ordered = worst_first(rows)
    write_file(folder / SUMMARY_TABLE, summary_table(rows))
    counts = f"{len(rows):,} campaigns certified, the worst first"
    counts += f"; {len(failed):,} could not be used" if failed else ""
    counts += f"; {missing:,} not begun" if missing else ""
    cells, lines = list[Sequence[Words]](), [counts]
    for row in ordered:
        judged = overall(row.result) or verdict_of(row.result, row.worst)
        eps = " to ".join(bracket_text(row.worst.bracket.lo, row.worst.bracket.hi))
        link = Mark(row.name, link=f"{quote(row.name)}/{REPORT_NAME}")
        answered = str(len(row.result.legs)) + (", interrupted" if row.result.interrupted else "")
        word = verdict(judged.word, judged.kind)
        title = load_campaign_json(folder / row.name).title  # which says whether it is simulated
        cells.append((link, title, word, str(row.worst.leg), eps, answered, nearest(row.seconds, 1)))
        lines.append(f"  {row.name}: {judged.word}, leg {row.worst.leg}, eps {eps} mm")
    head = ("campaign", "robot", "verdict", "worst leg", "its eps [mm]", "legs answered", "time [s]")
    table = Table(head, cells, ("names word", "names word", "word"), "cards")
    both = f"{SHORT_QUANTIFIER} Both bounds are proved; each campaign's page says by which certificates."
    answer = Section("The smallest error of the worst leg", [Mark(both, "quantifier")], tables=[table])
    unusable = [Section("Could not be used", items=failed, style="names")] if failed else []
    stopped = "Stopped before all campaigns were begun. The same command with --resume does the rest."
    notices, sections = [stopped] if missing else [], [answer, *unusable, origin({})]
    page = Page("Campaigns certified", "many campaigns", "Campaigns certified", sections, notices, f"{counts}.")
    if len(ordered) > _LINES:
        lines[_LINES + 1 :] = [f"  and {len(ordered) - _LINES:,} with smaller errors"]
    return [*lines, f"Summary: {page.write(folder / SUMMARY_PAGE)}"]


def worst_first(rows: Iterable[CampaignRow]) -> list[CampaignRow]:
    return sorted(rows, key=lambda row: (-row.worst.bracket.lo, row.name))


def summary_table(rows: Iterable[CampaignRow]) -> bytes:
    """A row a leg; the worst campaign, or model, first, and of each the worst leg. Numbers are those of result.json."""
    cells: list[list[str | float | None]] = []
    for row in worst_first(rows):
        for leg in sorted(row.result.legs, key=lambda leg: (-leg.bracket.lo, leg.leg)):
            word, done = verdict_of(row.result, leg).word, (leg.work.nodes, nearest(leg.work.seconds, 3))
            cells.append([row.name, leg.leg, word, leg.bracket.lo, leg.bracket.hi, leg.certified, *done])
    return csv_table(_HEADER, cells)
