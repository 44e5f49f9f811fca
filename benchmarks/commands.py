"""`python -m benchmarks`: list, run, page, compare, micro."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from benchmarks import changes, chart, tables
from benchmarks import problems as problems_
from benchmarks.methods import PEERS, method
from benchmarks.records import ANSWERED, Results, Run, load, save
from benchmarks.runner import execute
from benchmarks.suites import SUITES, Entry
from benchmarks.tasks import KINDS
from cpcal.solver import plugins

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)

Output = Annotated[Path | None, typer.Option("--output", "-o", help="Write the results to this JSON file.")]
Data = Annotated[Path | None, typer.Option("--data", help="Folder of the real measurements (for cables).")]
Repeat = Annotated[int | None, typer.Option("--repeat", min=1, help="Repetitions (default: the suite's).")]
Limit = Annotated[float | None, typer.Option("--limit", min=0.01, help="Seconds for each run (default: the suite's).")]
Methods = Annotated[list[str] | None, typer.Option("--method", "-m", help="Ask only these methods, also others.")]
Problems = Annotated[
    list[str] | None, typer.Option("--problem", "-p", help="Ask about only these problems, also others.")
]
Tasks = Annotated[list[str] | None, typer.Option("--task", "-t", help="Ask only these tasks, also others.")]


@app.command("list")
def list_() -> None:
    """Suites, tasks, methods, and which of them can run here."""
    print("suites")
    for suite in SUITES.values():
        print(f"  {suite.name:10} {suite.purpose} ({len(suite.entries)} tasks, limit {suite.limit:g} s)")
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
    output: Output = None,
    data: Data = None,
    repeat: Repeat = None,
    limit: Limit = None,
    methods: Methods = None,
    problems: Problems = None,
    tasks: Tasks = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what the output file holds.")] = False,
) -> None:
    """Run a suite, or a part of it. The output is written after every task: little is lost when it is stopped."""
    if suite not in SUITES:
        raise typer.BadParameter(f"there is no suite {suite!r}; choose from {', '.join(SUITES)}")
    chosen = SUITES[suite]
    entries = selected(chosen.entries, methods, problems, tasks)
    before = load(output).runs if resume and output is not None and output.exists() else ()
    results = execute(
        suite,
        entries,
        limit=limit or chosen.limit,
        repeat=repeat or chosen.repeat,
        data=None if data is None else str(data.resolve()),
        tell=lambda done: print(_line(done), flush=True),
        keep=lambda results: None if output is None else save(results, output),
        before=before,
    )
    print(f"\n{_summary(results)}")


def selected(
    entries: tuple[Entry, ...], methods: list[str] | None, problems: list[str] | None, tasks: list[str] | None
) -> list[Entry]:
    """The entries with only those methods, problems and tasks; names that no entry has are put in their place."""
    out: dict[tuple[str, str], tuple[str, ...]] = {}
    for problem, task, asked in entries:
        for p in [problem] if not problems or problem in problems else [n for n in problems if _new(n, entries, 0)]:
            for t in [task] if not tasks or task in tasks else [n for n in tasks if _new(n, entries, 1)]:
                out.setdefault((p, t), tuple(methods) if methods else asked)
    return [(problem, task, asked) for (problem, task), asked in out.items()]


def _new(name: str, entries: tuple[Entry, ...], position: int) -> bool:
    return all(entry[position] != name for entry in entries)


@app.command()
def micro(output: Output = None, repeat: Repeat = None) -> None:
    """Run the suite of that name: one sweep over every equation, boxes alone and in batches."""
    run("micro", output=output, repeat=repeat)


@app.command()
def page(
    files: Annotated[list[Path], typer.Argument(help="JSON files of results.")],
) -> None:
    """Write a Markdown page and an SVG picture beside each file of results."""
    for path in files:
        results = load(path)
        picture = chart.draw(results, path.with_suffix(".svg"))
        path.with_suffix(".md").write_text(tables.page(results, picture), encoding="utf-8")
        print(path.with_suffix(".md"))


@app.command()
def compare(old: Path, new: Path) -> None:
    """Compare two files of results.

    Exit status 1 when a result is missing, or a status or cpcal's nodes differ. How many programs were solved, which
    changes with versions, is told and is no failure.
    """
    found = changes.compared(load(old), load(new))
    print(changes.report(found))
    raise typer.Exit(int(not found.passed))


@app.command()
def baseline(results: Path, output: Path) -> None:
    """Keep of a file of results what must stay: status, nodes and programs, for `compare`."""
    save(changes.expectation(load(results)), output)


def _line(done: Run) -> str:
    seconds = "" if math.isnan(done.cpu) else f"{done.cpu:9.3f}"
    nodes = tables.count(done.figures.get("nodes"))
    return f"{done.problem:24} {done.task:15} {done.method:22} {done.status:9} {seconds:>9} {nodes:>6}  {done.note}"


def _summary(results: Results) -> str:
    medians = results.medians().values()
    answered = sum(run.status == ANSWERED for run in medians)
    return f"{answered} of {len(medians)} answered"
