"""Two files of results side by side: what changed in status, nodes and programs, and the ratio of the times."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from benchmarks.records import ANSWERED, SKIPPED, Results, Run
from benchmarks.tables import count, seconds, table

EXACT = ("nodes", "programs")  # equal on every machine, or the search has changed


@dataclass(frozen=True)
class Difference:
    """The medians of one (problem, task, method) in both files."""

    old: Run
    new: Run

    @property
    def changes(self) -> list[str]:
        """What is not as it was, times apart. A peer's nodes may differ from run to run: only status counts."""
        out = []
        if self.old.status != self.new.status:
            out.append(f"{self.old.status} became {self.new.status}")
        elif self.old.status == ANSWERED and "programs" in self.old.figures:
            for name in EXACT:
                before, after = self.old.figures.get(name), self.new.figures.get(name)
                if before != after:
                    out.append(f"{name} {count(before)} became {count(after)}")
        return out

    @property
    def ratio(self) -> float:
        """CPU time, new over old."""
        return self.new.cpu / self.old.cpu if self.old.status == self.new.status == ANSWERED else math.nan


def differences(old: Results, new: Results) -> list[Difference]:
    """What both files hold; what one of them could not ask is left out."""
    before, after = old.medians(), new.medians()
    pairs = [Difference(before[key], after[key]) for key in before if key in after]
    return [pair for pair in pairs if SKIPPED not in (pair.old.status, pair.new.status)]


def report(found: list[Difference]) -> str:
    """A table of Markdown and a sentence."""
    rows = [(*d.old.key, seconds(d.old.cpu), seconds(d.new.cpu), seconds(d.ratio), "; ".join(d.changes)) for d in found]
    changed = sum(bool(d.changes) for d in found)
    ratios = [d.ratio for d in found if not math.isnan(d.ratio)]
    middle = (
        f", CPU time {math.exp(sum(map(math.log, ratios)) / len(ratios)):.2f} times the old (geometric mean)"
        if ratios
        else ""
    )
    header = ("problem", "task", "method", "old CPU s", "new CPU s", "ratio", "changed")
    return f"{table(header, rows)}\n{len(found)} compared, {changed} changed{middle}\n"


def expectation(results: Results) -> Results:
    """What a later session is held to: status, nodes and programs of cpcal's own methods, no times."""
    kept = [
        replace(run, seconds=math.nan, cpu=math.nan, figures={k: run.figures[k] for k in EXACT}, note="")
        for run in results.medians().values()
        if run.status == ANSWERED and all(k in run.figures for k in EXACT)
    ]
    return replace(results, repeat=1, machine={}, runs=tuple(kept))
