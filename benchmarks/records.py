"""What a run gave, and the file that many of them are kept in (JSON, "cpcal-benchmark/1")."""

from __future__ import annotations

import json
import math
import statistics
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

FORMAT = "cpcal-benchmark/1"

ANSWERED, UNDECIDED, TIMEOUT, FAILED, SKIPPED = "answered", "undecided", "timeout", "failed", "skipped"
Key = tuple[str, str, str]  # problem, task, method


@dataclass(frozen=True)
class MethodAnswer:
    """What a method says: `answered` means that it claims to have done all of the task.

    `figures`: "lo" and "hi" of eps in mm, "nodes", "programs", "width" (largest, mm), "steps", where there are such.
    """

    answered: bool
    figures: dict[str, float] = field(default_factory=dict)
    note: str = ""
    cpu: float | None = None  # seconds of one time, where the task was repeated in order to measure it


@dataclass(frozen=True)
class Run:
    """One run of a method, in a process of its own; what did not succeed is a result, too.

    `seconds` and `cpu` are of the task alone, without imports and without making the problem.
    """

    problem: str
    task: str
    method: str
    status: str
    seconds: float = math.nan
    cpu: float = math.nan
    figures: dict[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def key(self) -> Key:
        return self.problem, self.task, self.method


@dataclass(frozen=True)
class Results:
    """All runs of a session, and what they ran on."""

    suite: str
    date: str
    limit: float
    repeat: int
    machine: dict[str, str]
    runs: tuple[Run, ...]

    def grouped(self) -> dict[Key, list[Run]]:
        """The repetitions of each (problem, task, method), in order of first appearance."""
        groups: dict[Key, list[Run]] = {}
        for run in self.runs:
            groups.setdefault(run.key, []).append(run)
        return groups

    def medians(self) -> dict[Key, Run]:
        """One run for each group: the worst status with its note, and the medians of times and figures."""
        return {key: median(runs) for key, runs in self.grouped().items()}


def median(runs: list[Run]) -> Run:
    """One line for repetitions of the same. The last one that did not succeed speaks for all."""
    bad = [run for run in runs if run.status != ANSWERED]
    if bad:
        return bad[-1]
    first = runs[0]
    shared = [name for name in first.figures if all(name in run.figures for run in runs)]
    figures = {name: statistics.median(run.figures[name] for run in runs) for name in shared}
    seconds, cpu = (statistics.median(values) for values in ([r.seconds for r in runs], [r.cpu for r in runs]))
    return Run(*first.key, ANSWERED, seconds, cpu, figures, first.note)


def save(results: Results, path: Path) -> None:
    data = {"format": FORMAT, **asdict(results)}
    data["runs"] = [_compact(run) for run in data["runs"]]
    lines = json.dumps({**data, "runs": []}, indent=1, allow_nan=False)[: -len("[]\n}")]
    runs = ",\n  ".join(json.dumps(run, allow_nan=False) for run in data["runs"])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{lines}[\n  {runs}\n ]\n}}\n", encoding="utf-8")


def load(path: Path) -> Results:
    """Raises ValueError for a file that is no result file."""
    data = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT:
        raise ValueError(f"{path} is not of format {FORMAT}")
    try:
        runs = tuple(Run(**_expanded(run)) for run in data.pop("runs"))
        return Results(**data, runs=runs)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} lacks or garbles a field: {error}") from None


def _compact(run: dict[str, Any]) -> dict[str, Any]:
    """JSON knows no infinities and no NaN: the former are strings, the latter left out; times to the microsecond."""
    figures = {k: v if math.isfinite(v) else str(v) for k, v in run["figures"].items() if not math.isnan(v)}
    times = {k: round(run[k], 6) for k in ("seconds", "cpu") if not math.isnan(run[k])}
    return (
        {k: run[k] for k in ("problem", "task", "method", "status")}
        | times
        | {"figures": figures}
        | ({"note": run["note"]} if run["note"] else {})
    )


def _expanded(run: dict[str, Any]) -> dict[str, Any]:
    return {**run, "figures": {k: float(v) for k, v in run.get("figures", {}).items()}}
