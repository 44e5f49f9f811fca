"""`python -m benchmarks`: list, run, page. Suites are named lists of what to run; pages are Markdown."""

import math
import signal
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from benchmarks import problems as problems_
from benchmarks.methods import PEERS, method
from benchmarks.runs import ANSWERED, KINDS, MINIMISE, REFERENCE, SKIPPED, Entry, Results, Run, execute, load, save
from cpcal.common.numbers import bracket_text
from cpcal.solver import plugins

OURS = ("lifted", "hc4,lifted")
SIZES = (64, 704, 7744)


@dataclass(frozen=True)
class Suite:
    """`entries`: (problem, task, methods) in order; `limit` in seconds for each run."""

    purpose: str
    limit: float
    repeat: int
    entries: tuple[Entry, ...]


def leg(number: int = 1, error: float = 1, count: int = 64, delta: float = 100, uncertain: bool = False) -> str:
    """The name of a problem."""
    return f"leg{number}-e{error:g}-n{count}-d{delta:g}{'-u' if uncertain else ''}"


_PEERS = (*OURS, "gurobi", "scip", "codac", "least-squares")
_LEGS = [leg(k, count=n, uncertain=uncertain) for uncertain, n, k in product((False, True), SIZES, (1, 5))]
_KINDS = [leg(delta=d) for d in (1, 10, 100, 1000)] + [leg(error=0), leg(error=10), leg(5, error=10), leg(count=704)]
_WHOLE = ("certify-1e-06", "prove-1e-06")
_QUICK = [(name, MINIMISE, OURS) for name in (*_KINDS, leg(count=7744))]
_QUICK += [(leg(), task, OURS) for task in ("refute-0.5", "refute-0.9")]
_TWO = (leg(), leg(5, error=10))
_SCALING = [leg(error=e, count=n) for e, n in product((0, 1, 10), SIZES)]
_SPINE = [(name, task, ("lifted",)) for task in _WHOLE for name in _LEGS]
_SPINE += [(name, MINIMISE, ("lifted",)) for name in problems_.CABLES]
SUITES = {
    "quick": Suite(
        "cpcal on every kind of problem, in minutes", 60.0, 3,
        (*_QUICK, *((leg(), task, ("lifted",)) for task in _WHOLE))),
    "peers": Suite(
        "everything that can be asked", 60.0, 3,
        tuple((name, task, _PEERS) for name in _TWO for task in (MINIMISE, "refute-0.9", "refute-0.5"))),
    "scaling": Suite(
        "64 to 7,744 measurements, joint errors of 0 to 10 mm", 120.0, 3,
        tuple((name, MINIMISE, (*OURS, "gurobi", "scip")) for name in _SCALING)),
    "spine": Suite(
        "the main job: legs, readings exact and uncertain; certificates; cables", 300.0, 3, tuple(_SPINE)),
}  # fmt: skip

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
Names = list[str] | None


@app.command("list")
def list_() -> None:
    """Suites, tasks, methods, and which of them can run here."""
    print("suites")
    for name, suite in SUITES.items():
        print(f"  {name:10} {suite.purpose} ({len(suite.entries)} tasks, limit {suite.limit:g} s)")
    print("\ntasks, followed by -NUMBER")
    for kind, meaning in KINDS.items():
        print(f"  {kind:10} {meaning}")
    print("\nproblems, named by what they are: see benchmarks/problems.py")
    print(f"  of other packages: {', '.join(plugins.found(problems_.GROUP)) or 'none'}")
    print("\nmethods")
    print(f"  {'contractors joined by commas':29} cpcal; registered: {', '.join(plugins.found())}")
    for name in PEERS:
        asked = method(name)
        print(f"  {name:29} {asked.missing() or asked.guarantee}")


@app.command()
def run(
    suite: Annotated[str, typer.Argument(help="A suite, see `list`.")] = "quick",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the results to this JSON file.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the real measurements (for cables).")] = None,
    repeat: Annotated[int | None, typer.Option(min=1, help="Repetitions (default: the suite's).")] = None,
    limit: Annotated[float | None, typer.Option(min=0.01, help="Seconds for each run (default: the suite's).")] = None,
    methods: Annotated[Names, typer.Option("--method", "-m", help="Ask only these methods, also others.")] = None,
    problems: Annotated[Names, typer.Option("--problem", "-p", help="Ask only about these, also others.")] = None,
    tasks: Annotated[Names, typer.Option("--task", "-t", help="Ask only these tasks, also others.")] = None,
) -> None:
    """Run a suite, or a part of it. The output is written after every task: little is lost when it is stopped."""
    if suite not in SUITES:
        raise typer.BadParameter(f"there is no suite {suite!r}; choose from {', '.join(SUITES)}")
    chosen = SUITES[suite]
    medians = execute(
        suite,
        selected(chosen.entries, methods, problems, tasks),
        limit=limit or chosen.limit,
        repeat=repeat or chosen.repeat,
        data=None if data is None else str(data.resolve()),
        tell=lambda done: print(_line(done), flush=True),
        keep=lambda results: None if output is None else save(results, output),
    ).medians()
    print(f"\n{sum(run.status == ANSWERED for run in medians.values())} of {len(medians)} answered")


def selected(entries: tuple[Entry, ...], methods: Names, problems: Names, tasks: Names) -> list[Entry]:
    """The entries with only those methods, problems and tasks; names that no entry has are put in their place."""
    out: dict[tuple[str, str], tuple[str, ...]] = {}
    for problem, task, asked in entries:
        new = [
            [n for n in names or () if all(entry[k] != n for entry in entries)]
            for k, names in enumerate((problems, tasks))
        ]
        for p in [problem] if not problems or problem in problems else new[0]:
            for t in [task] if not tasks or task in tasks else new[1]:
                out.setdefault((p, t), tuple(methods) if methods else asked)
    return [(problem, task, asked) for (problem, task), asked in out.items()]


def _line(done: Run) -> str:
    cost = f"{_seconds(done.cpu):>9} {_count(done.figures.get('nodes')):>6}"
    return f"{done.problem:24} {done.task:15} {done.method:22} {done.status:9} {cost}  {done.note}"


@app.command()
def page(files: Annotated[list[Path], typer.Argument(help="JSON files of results.")]) -> None:
    """Write a Markdown page beside each file of results."""
    for path in files:
        path.with_suffix(".md").write_text(page_of(load(path)), encoding="utf-8")
        print(path.with_suffix(".md"))


_HEADER = ("method", "result", "CPU s", "ratio", "wall s", "nodes", "LPs", "figures")
_UNITS = {"check": "s", "size": "kB"}
_TINY = 1e-9  # mm, below which no relative difference is sensible


def page_of(results: Results) -> str:
    """One file of results as a page."""
    purpose = SUITES[results.suite].purpose if results.suite in SUITES else "runs chosen by hand"
    facts = ", ".join(f"{name} {value}" for name, value in results.machine.items())
    known = dict.fromkeys(run.method for run in results.runs if ":" not in run.method)
    parts = [
        f"""# Suite `{results.suite}`: {purpose}

Made by `python -m benchmarks run {results.suite}` and `python -m benchmarks page`, {results.date}.
{facts}.

Every run is a process of its own with one thread and a limit of {results.limit:g} s of wall time; what did not end in
time, failed or could not be asked is listed as such. Medians of {results.repeat}, the methods' repetitions interleaved.
Times are those of the task, from data in memory to the answer, building the model included. "ratio" compares CPU time
with that of the first method in the table that answered. Where wall time is well above CPU time, the machine had other
work, too.
""",
        "".join(f"- `{name}`: {method(name).guarantee}\n" for name in known),
    ]
    medians = contradictions(list(results.medians().values()))
    for problem, task in dict.fromkeys((run.problem, run.task) for run in medians):
        here = [run for run in medians if (run.problem, run.task) == (problem, task)]
        kind, _, value = task.partition("-")
        eps = next((f"; eps = {run.figures['eps']:.7g} mm" for run in here if "eps" in run.figures), "")
        shown = [run for run in here if run.status != SKIPPED]
        base = next((run.cpu for run in shown if run.status == ANSWERED), math.nan)
        skipped = "".join(f"- `{run.method}` was not asked: {run.note}\n" for run in here if run.status == SKIPPED)
        cells = (tuple(cell.replace("|", "\\|") for cell in _row(run, base)) for run in shown)
        rows = [_HEADER, ("---",) * len(_HEADER), *cells]
        text = "".join(f"| {' | '.join(row)} |\n" for row in rows) if shown else ""
        below = "\n".join(filter(None, (text, skipped)))
        parts.append(f"## {problem}: {task}\n\n{KINDS[kind]} ({value}){eps}.\n\n{below}")
    return "\n".join(parts)


def _row(run: Run, base: float) -> tuple[str, ...]:
    lo, hi = run.figures.get("lo", -math.inf), run.figures.get("hi", math.inf)
    said = ["[{}, {}] mm".format(*bracket_text(lo, hi, 9))] if math.isfinite(lo) or math.isfinite(hi) else []
    others = {k: v for k, v in run.figures.items() if k not in ("lo", "hi", "nodes", "programs", "eps", "linear")}
    said += [
        f"{k} {f'{v:,.0f}' if abs(v) >= 100.0 else f'{v:.3g}'} {_UNITS.get(k, '')}".strip() for k, v in others.items()
    ]
    return (
        f"`{run.method}`",
        run.status + (f": {run.note}" if run.note else ""),
        _seconds(run.cpu), _seconds(run.cpu / base) if run.status == ANSWERED else "", _seconds(run.seconds),
        _count(run.figures.get("nodes")), _count(run.figures.get("programs")), "; ".join(said),
    )  # fmt: skip


def _seconds(value: float) -> str:
    """Three digits; nothing for what was not measured."""
    return "" if math.isnan(value) else f"{value:#.3g}".rstrip(".")


def _count(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"


def contradictions(runs: list[Run]) -> list[Run]:
    """A lower bound of eps* above a point that cpcal proved is wrong, a point below its lower bound, too: say so."""
    proved: dict[str, tuple[float, float]] = {}
    for run in runs:
        if run.method == REFERENCE and "hi" in run.figures:
            lo, hi = proved.get(run.problem, (-math.inf, math.inf))
            proved[run.problem] = max(lo, run.figures["lo"]), min(hi, run.figures["hi"])

    def examined(run: Run) -> Run:
        lo, hi = proved.get(run.problem, (-math.inf, math.inf))
        over = (run.figures.get("lo", -math.inf) - hi) / max(hi, _TINY)
        under = (lo - run.figures.get("hi", math.inf)) / max(lo, _TINY)
        sides = (("lower bound", over), ("point", under))
        wrong = [f"{what} wrong by {by:.0e} (relative)" for what, by in sides if by > 0]
        return replace(run, note="; ".join([*wrong, run.note])) if wrong else run

    return [examined(run) for run in runs]


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the process of a run is ended, too
    app(prog_name="python -m benchmarks")
