"""Classic systems and optimisation problems (`benchmarks/problems`) by `solve()` and `minimize()` without options.

    python -m benchmarks.solver_problems [--limit 60] [--page] [NAME ...]

Each line: proved solutions beside the literature's count, or the proved bracket beside the literature's optimum, nodes,
seconds of wall and of processor time. `--limit` is processor time: other work on the machine changes nothing. `--page`
renews the rows of these problems in benchmarks/pages/problems.md and .json.
"""

import json
import math
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import cpcal
from benchmarks import asked, run_by_hand
from cpcal.problems.problem import answer, load_problem
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import Reason, also_asked_by, heard

HERE = Path(__file__).parent
PROBLEMS, PAGES = HERE / "problems", HERE / "pages"
_CLOSE, _PRINTED = 2e-6, 5e-7  # relative: the literature prints seven digits; and half a unit of its sixth decimal


@dataclass(frozen=True)
class ProblemRow:
    """One problem: what the literature says, what was proved, and what it took."""

    name: str
    unknowns: int
    constraints: int
    literature: str
    found: str
    complete: bool  # all solutions proved, or the gap closed, in agreement with the literature
    nodes: int
    seconds: float
    processor: float
    method: str
    ibex: str = ""  # what its authors publish
    when: str = ""  # it was run (UTC), and beside how much other work


@contextmanager
def processor_limit(seconds: float) -> Iterator[None]:
    """Searches within are asked to stop after so much processor time."""
    until = time.process_time() + seconds
    with heard(), also_asked_by(lambda: Reason.INTERRUPTED if time.process_time() > until else None):
        yield


def run(name: str, limit: float) -> ProblemRow:
    """One problem without options but the limit of processor time."""
    problem, known = load_problem(PROBLEMS / f"{name}.bch"), literature()[name]
    when = f"{time.strftime('%Y-%m-%d %H:%M', time.gmtime())}, load {os.getloadavg()[0]:.0f}"
    wall, began = time.perf_counter(), time.process_time()
    with processor_limit(limit):
        found = answer(problem)
    seconds, processor = time.perf_counter() - wall, time.process_time() - began
    if found.objective is not None:
        (lo, hi), least = found.objective, known["least"]
        said, text = f"{least:g}", f"[{lo:.9g}, {hi:.9g}]"
        near = max(_CLOSE * abs(least), _PRINTED)
        complete = found.verdict is Verdict.PROVED and lo - near <= least <= hi + near
    else:
        solutions = () if found.paving is None else found.paving.solutions
        proved = sum(s.verdict is Verdict.PROVED for s in solutions)
        left = len(solutions) - proved
        said, text = f"{known['solutions']} solutions", f"{proved} proved" + (f", {left} boxes open" if left else "")
        complete = found.verdict is not Verdict.UNKNOWN and proved == known["solutions"] and not left
    method = getattr(found.best or found.paving, "method", "")
    rows = sum(math.prod(c.body.shape) for c in problem.network.constraints)
    size = len(problem.network.names)
    ibex = str(known.get("ibex", ""))
    return ProblemRow(name, size, rows, said, text, complete, found.nodes, seconds, processor, method, ibex, when)


def literature() -> dict[str, dict[str, Any]]:
    """By name the number of solutions in the domain, or the least value; and what ibex's authors publish."""
    found: dict[str, dict[str, Any]] = json.loads((PROBLEMS / "literature.json").read_text())
    return found


def page(rows: list[ProblemRow], limit: float) -> str:
    """The table, misses first in words."""
    missed = [row.name for row in rows if not row.complete]
    lines = [
        "# Classic problems", "",
        f"`python -m benchmarks.solver_problems --limit {limit:g} --page`: `solve()` and `minimize()` without options,",
        f"{limit:g} s of processor time each, one process, {platform.machine()}, Python {platform.python_version()}.",
        "Each row says when it was run (UTC) and the load of the machine then: with other work wall time is longer,",
        "and processor time, too, by a third or so.", "",
        f"{len(rows) - len(missed)} of {len(rows)} complete. Misses: {', '.join(missed) or 'none'}.", "",
        "ibex was not run: the column has what github.com/ibex-team/ibex-lib publishes: doc/solver.rst",
        "(kin1), or the folder of benchs/optim in which it keeps the problem; empty where it publishes nothing.", "",
        "| problem | unknowns | rows | literature | proved | complete | nodes | s | processor s | ibex | run |",
        f"|{' --- |' * 11}",
    ]  # fmt: skip
    for r in rows:
        cells = (r.name, r.unknowns, r.constraints, r.literature, r.found, "yes" if r.complete else "no", r.nodes)
        lines.append(f"| {' | '.join(map(str, cells))} | {r.seconds:.2f} | {r.processor:.2f} | {r.ibex} | {r.when} |")
    return "\n".join(lines) + "\n"


def _renew(row: ProblemRow, limit: float) -> None:
    """The page with this row, beside those of earlier runs."""
    PAGES.mkdir(exist_ok=True)
    file = PAGES / "problems.json"
    before = [ProblemRow(**known) for known in json.loads(file.read_text())] if file.exists() else []
    rows = sorted([r for r in before if r.name != row.name and r.name in literature()] + [row], key=lambda r: r.name)
    file.write_text(json.dumps([asdict(r) for r in rows], indent=1) + "\n")
    (PAGES / "problems.md").write_text(page(rows, limit))


def main(names: Annotated[list[str] | None, typer.Argument()] = None, limit: float = 60.0, page: bool = False) -> None:
    """Run the named problems, or all."""
    load = cpcal.Network("warm")
    x = load.variable("x", 2, (-2, 2))
    load.add([x[0] ** 2 + x[1] ** 2 == 1, x[0] == x[1]])
    load.solve()  # compiles and loads
    rows = []
    for name in asked(names, sorted(literature())):
        row = run(name, limit)
        rows.append(row)
        if page:
            _renew(row, limit)
        cost = f"{row.nodes:>7} {row.seconds:>7.2f} {row.processor:>7.2f}"
        print(f"{' ' if row.complete else '*'} {row.name:24} {row.literature:>16}  {row.found:36} {cost}", flush=True)
    print(f"{sum(row.complete for row in rows)} of {len(rows)} complete")


if __name__ == "__main__":
    run_by_hand(main)
