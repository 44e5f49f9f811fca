"""A comparison of models for people: a table for terminal and page, sentences, one self-contained HTML page."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from cpcal.common.errors import printable
from cpcal.common.files import write_file
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, short, stated
from cpcal.files.run_folder import REPORT_NAME
from cpcal.files.tables import guarded
from cpcal.questions import Comparison, Entry, Explained, LegResult, Result, Undetermined, verdict_of
from cpcal.report.section import Mark, Page, Section, Table, Words, origin, verdict
from cpcal.report.words import LONGER, QUANTIFIER, SHORT_QUANTIFIER, overall
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


def _unit(comparison: Comparison) -> str:
    """Of eps: that of user-defined networks is known to their makers."""
    return " mm" if comparison.campaign_sha256 else ""


def comparison_table(comparison: Comparison) -> Table:
    """A row an entry. Bounds are rounded to the side on which they stay proved."""
    of_legs, tolerance = bool(comparison.campaign_sha256), comparison.tolerance
    at = "at the tolerance" if tolerance is None else f"at {stated(tolerance)}{_unit(comparison)}"
    bounds = ("eps_lo [mm]", "eps_hi [mm]") if of_legs else ("eps_lo", "eps_hi")
    rows: list[Sequence[Words]] = []
    for entry in comparison.entries:
        word: Words = entry.word(tolerance, comparison.options)
        if tolerance is not None:
            word = verdict(word, entry.leg_verdict(tolerance, comparison.options).kind)
        between = bracket_text(entry.eps_lo, entry.eps_hi)
        extra = (_extra(entry),) * of_legs
        rows.append((entry.subject, entry.model, *between, word, entry.certificate or "none", *extra))
    head = ("of", "model", *bounds, at, "certificate", *(("extra parameters",) * of_legs))
    return Table(head, rows, ("", "word", "", "", "word", "word", "word"), "compared")


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
    at = None if comparison.tolerance is None else f"{stated(comparison.tolerance)}{_unit(comparison)}"
    stopped = "Interrupted: what is shown was proved until then; the rest is missing."
    page = Page(
        f"Models compared: {comparison.title}",
        "models compared",
        comparison.title,
        [_answers(comparison), _models(comparison), _origin(comparison)],
        [stopped] if comparison.interrupted else [],
        f"Which models do the measurements refute at {at}?" if at else "How small can the error of each model be?",
    )
    return page.write(Path(folder) / COMPARISON_PAGE)


def _answers(comparison: Comparison) -> Section:
    note = (
        "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than eps_lo, and "
        "some reach eps_hi. “Refuted”: eps_lo lies above the tolerance. “Not refuted”: some parameters are proved to "
        "reach it. “Unchecked”: proved in outward-rounded arithmetic, without a certificate."
    )
    extra = " Extra parameters: all parameters with eps ≤ eps_hi lie there."
    return Section(
        "Answers",
        items=[*comparison_lines(comparison)[1:], *comparison_sentences(comparison)],
        parts=[
            Section(
                sentences=[Mark(said(comparison), "quantifier")],
                tables=[comparison_table(comparison)],
                notes=[note + (extra if comparison.campaign_sha256 else "")],
            ),
        ],
        style="names",
    )


def _models(comparison: Comparison) -> Section:
    of_legs = bool(comparison.campaign_sha256)
    same = (
        "All models look for (a, b, l) in the same box, and contain the plain one where their extra parameters vanish: "
        "none has a larger smallest eps than the plain one."
    )
    what = "The length of a leg is " * of_legs
    data = {name: Mark(f"{what}{summary}.", "names") for name, summary in comparison.models.items()}
    return Section("The models", data=data, notes=[same] * of_legs)


def _origin(comparison: Comparison) -> Section:
    sha256 = comparison.campaign_sha256
    data: dict[str, Words] = {} if sha256 is None else {"Campaign, SHA-256": Mark(sha256, "code")}
    if any(entry.certificate for entry in comparison.entries):
        about = (
            "FOLDER: where this page is. Certificates speak of the campaign; those of a user-defined model state their "
            "constraints themselves, which were not compared with the campaign."
        )
        data["To check the proofs again"] = (
            Mark(f"cpcal verify FOLDER{' --campaign CAMPAIGN' if sha256 else ''}", "command"),
            Mark(about if sha256 else "FOLDER: where this page is.", "small"),
        )
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
        row.result.robot,
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
