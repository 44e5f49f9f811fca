"""Results as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from benchmarks.methods import method
from benchmarks.records import ANSWERED, SKIPPED, Results, Run
from benchmarks.suites import REFERENCE, SUITES
from benchmarks.tasks import KINDS, Task
from cpcal.common.numbers import bracket_text

_SEPARATE = ("lo", "hi", "nodes", "programs", "linear", "eps")  # have a place of their own
_UNITS = {"width": "mm", "mean width": "mm", "check": "s", "size": "kB"}
_TINY = 1e-9  # mm, below which no relative difference is sensible
_HEADER = ("method", "result", "CPU s", "ratio", "wall s", "nodes", "LPs", "in LPs", "figures")


def page(results: Results, picture: Path | None) -> str:
    """One file of results as a page."""
    parts = [_head(results), _worth(dict.fromkeys(run.method for run in results.runs))]
    if picture is not None:
        parts.append(f"![CPU seconds of every method]({picture.name})\n")
    medians = contradictions(list(results.medians().values()))
    for problem, task in dict.fromkeys((run.problem, run.task) for run in medians):
        here = [run for run in medians if (run.problem, run.task) == (problem, task)]
        parts.append(f"## {problem}: {task}\n\n{_asked(here, task)}\n\n{_table(here)}")
    return "\n".join(parts)


def _head(results: Results) -> str:
    purpose = SUITES[results.suite].purpose if results.suite in SUITES else "runs chosen by hand"
    facts = ", ".join(f"{name} {value}" for name, value in results.machine.items())
    return f"""# Suite `{results.suite}`: {purpose}

Made by `python -m benchmarks run {results.suite}` and `python -m benchmarks page`, {results.date}.
{facts}.

Every run is a process of its own with one thread and a limit of {results.limit:g} s of wall time; what did not end in
time, failed or could not be asked is listed as such. Medians of {results.repeat}, the methods' repetitions interleaved.
Times are those of the task, from data in memory to the answer, building the model included. "ratio" compares CPU time
with that of the first method in the table that answered, in the same session. Where wall time is well above CPU time,
the machine had other work, too.
"""


def _worth(methods: Iterable[str]) -> str:
    """What the answers of each method are worth."""
    known = [name for name in methods if ":" not in name]
    return "".join(f"- `{name}`: {method(name).guarantee}\n" for name in known)


def _asked(here: list[Run], task: str) -> str:
    named = Task.named(task)
    eps = next((run.figures["eps"] for run in here if "eps" in run.figures), None)
    return f"{KINDS[named.kind]} ({named.value:g})" + (f"; eps = {eps:.7g} mm." if eps is not None else ".")


def _table(here: list[Run]) -> str:
    shown = [run for run in here if run.status != SKIPPED]
    base = next((run.cpu for run in shown if run.status == ANSWERED), math.nan)
    text = table(_HEADER, [_row(run, base) for run in shown]) if shown else ""
    skipped = "".join(f"- `{run.method}` was not asked: {run.note}\n" for run in here if run.status == SKIPPED)
    return "\n".join(part for part in (text, skipped) if part)


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    names = list(header)
    lines = [names, ["---"] * len(names), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _row(run: Run, base: float) -> tuple[str, ...]:
    ratio = seconds(run.cpu / base) if run.status == ANSWERED else ""
    linear = run.figures.get("linear", math.nan) / run.seconds
    return (
        f"`{run.method}`",
        run.status + (f": {run.note}" if run.note else ""),
        seconds(run.cpu),
        ratio,
        seconds(run.seconds),
        count(run.figures.get("nodes")),
        count(run.figures.get("programs")),
        "" if math.isnan(linear) else f"{linear:.0%}",
        "; ".join(_figures(run.figures)),
    )


def _figures(figures: dict[str, float]) -> list[str]:
    lo, hi = figures.get("lo", -math.inf), figures.get("hi", math.inf)
    out = []
    if math.isfinite(lo) or math.isfinite(hi):
        least, most = bracket_text(lo, hi, 9)
        out.append(f"[{least}, {most}] mm")
    for name, value in figures.items():
        if name not in _SEPARATE:
            shown = f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
            out.append(f"{name} {shown} {_UNITS.get(name, '')}".strip())
    return out


def seconds(value: float) -> str:
    """Three digits; nothing for what was not measured."""
    return "" if math.isnan(value) else f"{value:#.3g}".rstrip(".")


def count(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"


def contradictions(runs: list[Run]) -> list[Run]:
    """A lower bound of eps* above a point that cpcal proved is wrong, a point below its lower bound, too: say so."""
    proved: dict[str, tuple[float, float]] = {}
    for run in runs:
        if run.method == REFERENCE and "hi" in run.figures:
            lo, hi = proved.get(run.problem, (-math.inf, math.inf))
            proved[run.problem] = max(lo, run.figures["lo"]), min(hi, run.figures["hi"])

    def examined(run: Run) -> Run:
        if run.problem not in proved:
            return run
        lo, hi = proved[run.problem]
        over = (run.figures.get("lo", -math.inf) - hi) / max(hi, _TINY)
        under = (lo - run.figures.get("hi", math.inf)) / max(lo, _TINY)
        wrong = [
            f"{what} wrong by {by:.0e} (relative)" for what, by in (("lower bound", over), ("point", under)) if by > 0
        ]
        return replace(run, note="; ".join([*wrong, run.note])) if wrong else run

    return [examined(run) for run in runs]
