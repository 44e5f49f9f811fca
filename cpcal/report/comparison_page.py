"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from cpcal.common.errors import printable
from cpcal.common.files import write_file
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, short, stated
from cpcal.files.run_folder import REPORT_NAME
from cpcal.files.tables import guarded
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

Compared = Mapping[str, Result]  # of one campaign, by the leg model


def _legs(found: Compared) -> dict[int, dict[str, LegResult]]:
    """The legs of all results, each with its models."""
    out: dict[int, dict[str, LegResult]] = {}
    for model, result in found.items():
        for leg in result.legs:
            out.setdefault(leg.leg, {})[model] = leg
    return dict(sorted(out.items()))


def _asked(found: Compared) -> Result:
    """The first result: the campaign and the tolerance are the same in all."""
    return next(iter(found.values()))


def _at(found: Compared) -> str | None:
    tolerance = _asked(found).options.tolerance
    return None if tolerance is None else f"{stated(tolerance)} mm"


def passing(found: Compared, leg: int) -> list[str]:
    """The models that pass for a leg."""
    legs = _legs(found)[leg]
    return [model for model, one in legs.items() if verdict_of(found[model], one).passes]


def comparison_table(found: Compared) -> Table:
    """A row a leg and model. Bounds are rounded to the side on which they stay proved."""
    rows: list[Sequence[Words]] = []
    for number, legs in _legs(found).items():
        for model, leg in legs.items():
            judged, bracket = verdict_of(found[model], leg), leg.bracket
            extra = [] if bracket.enclosure.is_empty else bracket.enclosure.names[7:]
            ranges = (
                f"{name} in [{', '.join(map(short, bracket_text(side.lo, side.hi)))}]"
                for name, side in ((name, bracket.enclosure[name]) for name in extra)
            )
            between = bracket_text(bracket.lo, bracket.hi)
            word = verdict(judged.word, judged.kind)
            file = bracket.certificate or "none"
            rows.append((f"leg {number}", model, *between, word, file, ", ".join(ranges)))
    at = "verdict" if (asked := _at(found)) is None else f"at {asked}"
    head = ("of", "model", "eps_lo [mm]", "eps_hi [mm]", at, "certificate", "extra parameters")
    return Table(head, rows, ("", "word", "", "", "word", "word", "word"), "compared")


def comparison_sentences(found: Compared) -> list[str]:
    """What the comparison shows, a sentence a model; refutations first say with which proof."""
    tolerance, out = _asked(found).options.tolerance, list[str]()
    if tolerance is None:
        return out
    for model, result in found.items():
        legs, poor, unknown = result.legs, [], []
        refuted = [leg for leg in legs if leg.bracket.lo > tolerance]
        for leg in legs:
            kind = verdict_of(result, leg).kind
            poor += [f"leg {leg.leg}"] * (kind == "undetermined")
            unknown += [f"leg {leg.leg}"] * (leg.bracket.lo <= tolerance < leg.bracket.hi)
        names = ", ".join(f"leg {leg.leg} ({leg.bracket.certificate or 'unchecked'})" for leg in refuted)
        count = f"{len(refuted)} of {len(legs)}: {names}" if refuted else f"none of {len(legs)}"
        text = f"{model} is refuted at {_at(found)} for {count}."
        if unknown:
            text += f" Not known for {', '.join(unknown)}."
        if poor:
            text += f" Undetermined for {', '.join(poor)}: the measurements leave parameters open."
        out.append(text)
    return out


def comparison_lines(found: Compared) -> list[str]:
    """A line a leg, for a terminal: what each model reaches, and at a tolerance the first model that passes."""
    out, every = [f"{_asked(found).campaign.robot}: smallest error of each model, mm"], _legs(found)
    for number, legs in list(every.items())[:_MOST_LINES]:
        line = f"leg {number}: " + ", ".join(_short(found[model], leg) for model, leg in legs.items())
        if _at(found) is not None:
            good = passing(found, number)
            line += f"; next: accept {good[0]}" if good else "; next: no model passes"
        out.append(printable(line))
    if len(every) > _MOST_LINES:
        out.append(f"and {len(every) - _MOST_LINES} more, which the page shows")
    return out


def _short(result: Result, leg: LegResult) -> str:
    hi = at_most(leg.bracket.hi) if math.isfinite(leg.bracket.hi) else f"above {at_least(leg.bracket.lo)}"
    word = "" if result.options.tolerance is None else _WORDS[verdict_of(result, leg).kind]
    return f"{result.model.name} {hi}{word}"


def write_comparison(found: Compared, folder: str | os.PathLike[str], *, stopped: bool = False) -> Path:
    """Write `compare.html` beside the runs of the models; its path. The same results give the same bytes."""
    at, robot = _at(found), _asked(found).campaign.robot
    notice = "Interrupted: what is shown was proved until then; the rest is missing."
    page = Page(
        f"Models compared: {robot}",
        "models compared",
        robot,
        [_answers(found), _models(found), _origin(found)],
        [notice] if stopped else [],
        f"Which models do the measurements refute at {at}?" if at else "How small can the error of each model be?",
    )
    return page.write(Path(folder) / COMPARISON_PAGE)


def _answers(found: Compared) -> Section:
    note = (
        "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than eps_lo, and "
        "some reach eps_hi. Without a certificate both are proved in outward-rounded arithmetic only. Extra "
        "parameters: all parameters with eps ≤ eps_hi lie there."
    )
    quantifier = Mark(f"{QUANTIFIER} {LONGER}", "quantifier")
    return Section(
        "Answers",
        items=[*comparison_lines(found)[1:], *comparison_sentences(found)],
        parts=[Section(sentences=[quantifier], tables=[comparison_table(found)], notes=[note])],
        style="names",
    )


def _models(found: Compared) -> Section:
    same = (
        "All models look for (a, b, l) in the same box, and contain the plain one where their extra parameters vanish: "
        "none has a larger smallest eps than the plain one."
    )
    data = {
        name: Mark(f"The length of a leg is {result.model.summary}.", "names", link=f"{quote(name)}/{REPORT_NAME}")
        for name, result in found.items()
    }
    strange = [result.model.not_compared for result in found.values() if result.model.not_compared]
    return Section("The models", data=data, notes=[same, *strange])


def _origin(found: Compared) -> Section:
    about = "FOLDER: where this page is. It holds a run of each model, with its certificates and a page of its own."
    command = Mark("cpcal verify FOLDER --campaign CAMPAIGN", "command")
    data: dict[str, Words] = {
        "Campaign, SHA-256": Mark(_asked(found).campaign.sha256, "code"),
        "To check the proofs again": (command, Mark(about, "small")),
    }
    return origin(data)


# ------------------------------------------------------------------------------------------------------------------
# The summary of many campaigns: a page and a table, the worst first.

SUMMARY_PAGE = "summary.html"
SUMMARY_TABLE = "summary.csv"
_LINES = 5  # campaigns that are printed
_HEADER = ("campaign", "leg", "verdict", "eps_lo_mm", "eps_hi_mm", "certified", "nodes", "seconds")


@dataclass(frozen=True)
class CampaignRow:
    """A campaign by the name of its folder, and what was found."""

    name: str
    result: Result
    worst: LegResult

    @property
    def seconds(self) -> float:
        return sum(leg.work.seconds for leg in self.result.legs)


@dataclass(frozen=True)
class CampaignsSummary:
    """The page, and what is printed of it."""

    path: Path
    lines: tuple[str, ...]


def row_of(name: str, result: Result) -> CampaignRow:
    """A result with at least one leg."""
    return CampaignRow(name, result, max(result.legs, key=lambda leg: (leg.bracket.lo, leg.bracket.hi)))


def write_campaigns(rows: Sequence[CampaignRow], failed: Sequence[str], missing: int, folder: Path) -> CampaignsSummary:
    """Write `summary.html` and `summary.csv`, sorted by the worst leg's eps; `missing` were not begun.

    Raises InputError.
    """
    ordered = sorted(rows, key=lambda row: (-row.worst.bracket.lo, row.name))
    write_file(folder / SUMMARY_TABLE, summary_table(ordered))
    head = ("campaign", "robot", "verdict", "worst leg", "its eps [mm]", "legs answered", "time [s]")
    table = Table(head, [_cells(row) for row in ordered], ("names word", "names word", "word"), "cards")
    both = f"{SHORT_QUANTIFIER} Both bounds are proved; each campaign's page says by which certificates."
    answer = Section("The smallest error of the worst leg", [Mark(both, "quantifier")], tables=[table])
    unusable = [Section("Could not be used", items=failed, style="names")] if failed else []
    stopped = "Stopped before all campaigns were begun. The same command with --resume does the rest."
    page = Page(
        "Campaigns certified",
        "many campaigns",
        "Campaigns certified",
        [answer, *unusable, origin({})],
        [stopped] if missing else [],
        f"{_counts(rows, failed, missing)}.",
    )
    path = page.write(folder / SUMMARY_PAGE)
    lines = [_counts(rows, failed, missing)]
    lines += [
        f"  {row.name}: {_judged(row)[1]}, leg {row.worst.leg}, eps {_eps(row.worst)} mm" for row in ordered[:_LINES]
    ]
    if len(ordered) > _LINES:
        lines.append(f"  and {len(ordered) - _LINES:,} with smaller errors")
    return CampaignsSummary(path, tuple(lines))


def _counts(rows: Sequence[CampaignRow], failed: Sequence[str], missing: int) -> str:
    parts = [f"{len(rows):,} campaigns certified, the worst first"]
    parts += [f"{len(failed):,} could not be used"] if failed else []
    parts += [f"{missing:,} not begun"] if missing else []
    return "; ".join(parts)


def _cells(row: CampaignRow) -> tuple[Words, ...]:
    kind, word = _judged(row)
    return (
        Mark(row.name, link=f"{quote(row.name)}/{REPORT_NAME}"),
        row.result.campaign.robot,
        verdict(word, kind),
        str(row.worst.leg),
        _eps(row.worst),
        str(len(row.result.legs)) + (", interrupted" if row.result.interrupted else ""),
        nearest(row.seconds, 1),
    )


def _judged(row: CampaignRow) -> tuple[str, str]:
    """Kind and word of the verdict: on all legs with a tolerance, else on the worst."""
    passed, worst = overall(row.result), verdict_of(row.result, row.worst)
    return (worst.kind, worst.word) if passed is None else (passed.kind, passed.word)


def _eps(leg: LegResult) -> str:
    lo, hi = bracket_text(leg.bracket.lo, leg.bracket.hi)
    return f"{lo} to {hi}"


def summary_table(rows: Sequence[CampaignRow]) -> str:
    """A row a leg; campaigns in their order, the worst leg of each first. Numbers are those of result.json."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_HEADER)
    for row in rows:
        for leg in sorted(row.result.legs, key=lambda leg: (-leg.bracket.lo, leg.leg)):
            word = verdict_of(row.result, leg).word
            bounds = (repr(leg.bracket.lo), repr(leg.bracket.hi))
            table.writerow(
                (guarded(row.name), leg.leg, word, *bounds, leg.certified, leg.work.nodes, nearest(leg.work.seconds, 3))
            )
    return text.getvalue()
