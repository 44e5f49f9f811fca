"""Two files of results side by side: changes of status, nodes and programs, what is missing, the ratio of times."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from benchmarks.records import ANSWERED, SKIPPED, Key, Results, Run
from benchmarks.tables import count, seconds, table

EXACT = ("nodes", "programs")
VERSIONS = ("cpcal", "numpy", "scipy", "numba", "python-flint")  # which decide how many programs are solved


@dataclass(frozen=True)
class Difference:
    """The medians of one (problem, task, method) in both files."""

    old: Run
    new: Run

    @property
    def changes(self) -> list[str]:
        """What must not change, and did. A peer's nodes may differ from run to run: only its status counts."""
        if self.old.status != self.new.status:
            return [f"{self.old.status} became {self.new.status}"]
        return self._counts("nodes")

    @property
    def notes(self) -> list[str]:
        """What may change from one version of cpcal or of a library to the next, and did."""
        return [] if self.changes else self._counts("programs")

    def _counts(self, name: str) -> list[str]:
        if self.old.status != ANSWERED or "programs" not in self.old.figures:
            return []
        before, after = self.old.figures.get(name), self.new.figures.get(name)
        return [] if before == after else [f"{name} {count(before)} became {count(after)}"]

    @property
    def ratio(self) -> float:
        """CPU time, new over old."""
        return self.new.cpu / self.old.cpu if self.old.status == self.new.status == ANSWERED else math.nan


@dataclass(frozen=True)
class Changes:
    """`pairs`: what both files hold. `missing`: what the old one holds and the new one does not, or did not ask."""

    old: Results
    new: Results
    pairs: tuple[Difference, ...]
    missing: tuple[Key, ...]

    @property
    def passed(self) -> bool:
        return not self.missing and not any(pair.changes for pair in self.pairs)


def compared(old: Results, new: Results) -> Changes:
    """Every result of `old`, with its counterpart. What `old` could not ask is left out."""
    before = {key: run for key, run in old.medians().items() if run.status != SKIPPED}
    after = {key: run for key, run in new.medians().items() if run.status != SKIPPED}
    pairs = tuple(Difference(before[key], after[key]) for key in before if key in after)
    return Changes(old, new, pairs, tuple(key for key in before if key not in after))


def report(found: Changes) -> str:
    """Both machines, a table of Markdown, a sentence."""
    rows = [
        (*d.old.key, seconds(d.old.cpu), seconds(d.new.cpu), seconds(d.ratio), "; ".join(d.changes), "; ".join(d.notes))
        for d in found.pairs
    ] + [(*key, "", "", "", "missing", "") for key in found.missing]
    changed = sum(bool(d.changes) for d in found.pairs)
    ratios = [d.ratio for d in found.pairs if not math.isnan(d.ratio)]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios)) if ratios else math.nan
    times = f", CPU time {mean:.2f} times the old (geometric mean)" if ratios else ""
    header = ("problem", "task", "method", "old CPU s", "new CPU s", "ratio", "changed", "may change")
    sides = f"old: {_described(found.old)}\nnew: {_described(found.new)}\n"
    sentence = f"{len(found.pairs)} compared, {changed} changed, {len(found.missing)} missing{times}\n"
    return f"{sides}\n{table(header, rows)}\n{sentence}"


def _described(results: Results) -> str:
    """The machine and the versions of one side."""
    machine = results.machine
    place = [machine[name] for name in ("processor", "system", "python") if name in machine]
    versions = [f"{name} {machine[name]}" for name in VERSIONS if name in machine]
    return ", ".join([results.date, *(place or ["machine unknown"]), *(versions or ["versions unknown"])])


def expectation(results: Results) -> Results:
    """What a later session is held to: status, nodes and programs of cpcal's own methods, no times."""
    kept = [
        replace(run, seconds=math.nan, cpu=math.nan, figures={k: run.figures[k] for k in EXACT}, note="")
        for run in results.medians().values()
        if run.status == ANSWERED and all(k in run.figures for k in EXACT)
    ]
    return replace(results, repeat=1, runs=tuple(kept))
