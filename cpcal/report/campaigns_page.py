"""The summary of many campaigns: a page and a table, the worst first."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from cpcal.common.atomic import write_file
from cpcal.common.numbers import bracket_text, nearest
from cpcal.files.run_folder import REPORT_NAME
from cpcal.files.tables import guarded
from cpcal.report.origin import versions
from cpcal.report.template import rendered
from cpcal.report.words import SHORT_QUANTIFIER, overall
from cpcal.results import LegResult, Result, verdict_of

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
        return sum(leg.seconds for leg in self.result.legs)


@dataclass(frozen=True)
class CampaignsSummary:
    """The page, and what is printed of it."""

    path: Path
    lines: tuple[str, ...]


def row_of(name: str, result: Result) -> CampaignRow:
    """A result with at least one leg."""
    return CampaignRow(name, result, max(result.legs, key=lambda leg: (leg.eps_lo, leg.eps_hi)))


def write_campaigns(rows: Sequence[CampaignRow], failed: Sequence[str], missing: int, folder: Path) -> CampaignsSummary:
    """Write `summary.html` and `summary.csv`, sorted by the worst leg's eps; `missing` were not begun.

    Raises InputError.
    """
    ordered = sorted(rows, key=lambda row: (-row.worst.eps_lo, row.name))
    write_file(folder / SUMMARY_TABLE, summary_table(ordered))
    context = {
        "rows": [_cells(row) for row in ordered],
        "failed": list(failed),
        "missing": missing,
        "said": SHORT_QUANTIFIER,
        "head": _counts(rows, failed, missing),
        "versions": versions(),
    }
    path = write_file(folder / SUMMARY_PAGE, rendered("campaigns.html.j2", context))
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


def _cells(row: CampaignRow) -> dict[str, str]:
    kind, word = _judged(row)
    return {
        "name": row.name,
        "link": f"{quote(row.name)}/{REPORT_NAME}",
        "robot": row.result.robot,
        "leg": str(row.worst.leg),
        "kind": kind,
        "word": word,
        "eps": _eps(row.worst),
        "legs": str(len(row.result.legs)) + (", interrupted" if row.result.interrupted else ""),
        "seconds": nearest(row.seconds, 1),
    }


def _judged(row: CampaignRow) -> tuple[str, str]:
    """Kind and word of the verdict: on all legs with a tolerance, else on the worst."""
    passed, verdict = overall(row.result), verdict_of(row.result, row.worst)
    return (verdict.kind, verdict.word) if passed is None else (passed.kind, passed.word)


def _eps(leg: LegResult) -> str:
    lo, hi = bracket_text(leg.eps_lo, leg.eps_hi)
    return f"{lo} to {hi}"


def summary_table(rows: Sequence[CampaignRow]) -> str:
    """A row a leg; campaigns in their order, the worst leg of each first. Numbers are those of result.json."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_HEADER)
    for row in rows:
        for leg in sorted(row.result.legs, key=lambda leg: (-leg.eps_lo, leg.leg)):
            word = verdict_of(row.result, leg).word
            bounds = (repr(leg.eps_lo), repr(leg.eps_hi))
            table.writerow(
                (guarded(row.name), leg.leg, word, *bounds, leg.certified, leg.nodes, nearest(leg.seconds, 3))
            )
    return text.getvalue()
