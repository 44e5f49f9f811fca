"""Classic systems and optimisation problems (`benchmarks/problems`) by `solve()` and `minimize()` without options.

    python -m benchmarks.solver_problems [--limit 60] [--page] [NAME ...]

Each line: proved solutions beside the literature's count, or the proved bracket beside the literature's optimum, nodes,
seconds of wall and of processor time. `--page` writes benchmarks/pages/problems.md and .json.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import cpcal
from cpcal.problems.answer import answer
from cpcal.problems.problem_files import load_problem
from cpcal.solver.contract import Verdict

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


def run(name: str, limit: float) -> ProblemRow:
    """One problem without options but the time limit."""
    problem, known = load_problem(PROBLEMS / f"{name}.bch"), literature()[name]
    wall, began = time.perf_counter(), time.process_time()
    found = answer(problem, limits=cpcal.Limits(seconds=limit))
    seconds, processor = time.perf_counter() - wall, time.process_time() - began
    if found.objective is not None:
        lo, hi = found.objective
        least = known["least"]
        said, text = f"{least:g}", f"[{lo:.9g}, {hi:.9g}]"
        near = max(_CLOSE * abs(least), _PRINTED)
        complete = found.verdict is Verdict.PROVED and lo - near <= least <= hi + near
    else:
        solutions = () if found.paving is None else found.paving.solutions
        proved = sum(s.verdict is Verdict.PROVED for s in solutions)
        left = len(solutions) - proved
        said, text = f"{known['solutions']} solutions", f"{proved} proved" + (f", {left} boxes open" if left else "")
        complete = found.verdict is not Verdict.UNKNOWN and proved == known["solutions"] and not left
    source = found.best or found.paving
    method = "" if source is None else source.method
    rows = sum(math.prod(c.body.shape) for c in problem.network.constraints)
    size = len(problem.network.names)
    return ProblemRow(name, size, rows, said, text, complete, found.nodes, seconds, processor, method)


def literature() -> dict[str, dict[str, float]]:
    """By name the number of solutions in the domain, or the least value."""
    found: dict[str, dict[str, float]] = json.loads((PROBLEMS / "literature.json").read_text())
    return found


def page(rows: list[ProblemRow], limit: float) -> str:
    """The table, misses first in words."""
    missed = [row.name for row in rows if not row.complete]
    done = f"{len(rows) - len(missed)} of {len(rows)} complete"
    lines = [
        "# Classic problems",
        "",
        f"`python -m benchmarks.solver_problems --limit {limit:g} --page`: `solve()` and `minimize()` without options,",
        f"{limit:g} s of wall time each, one process, {platform.machine()}, Python {platform.python_version()}, on a",
        "machine with other work.",
        "",
        f"{done}. Misses: {', '.join(missed) or 'none'}.",
        "",
        "| problem | unknowns | rows | literature | proved | complete | nodes | s | processor s |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in rows:
        word = "yes" if r.complete else "no"
        cells = (r.name, r.unknowns, r.constraints, r.literature, r.found, word, r.nodes)
        lines.append(f"| {' | '.join(map(str, cells))} | {r.seconds:.2f} | {r.processor:.2f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the named problems, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    load = cpcal.Network("warm")
    x = load.variable("x", 2, (-2, 2))
    load.add([x[0] ** 2 + x[1] ** 2 == 1, x[0] == x[1]])
    load.solve()  # compiles and loads
    rows = []
    for name in given.names or sorted(literature()):
        row = run(name, given.limit)
        rows.append(row)
        cost = f"{row.nodes:>7} {row.seconds:>7.2f} {row.processor:>7.2f}"
        print(f"{' ' if row.complete else '*'} {row.name:24} {row.literature:>16}  {row.found:36} {cost}", flush=True)
    print(f"{sum(row.complete for row in rows)} of {len(rows)} complete")
    if given.page:
        PAGES.mkdir(exist_ok=True)
        (PAGES / "problems.md").write_text(page(rows, given.limit))
        (PAGES / "problems.json").write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")


if __name__ == "__main__":
    main()
