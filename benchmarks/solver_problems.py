"""Classic systems and optimisation problems (`benchmarks/problems`) by `solve()` and `minimize()` without options.

    python -m benchmarks.solver_problems [--limit 60] [--codac 10] [--page] [NAME ...]
    python -m benchmarks.solver_problems --contractors [--limit 5] [NAME ...]

Each line: proved solutions beside the literature's count, or the proved bracket beside the literature's optimum, nodes,
seconds of wall and of processor time. `--limit` is processor time: other work on the machine changes nothing. `--codac`
runs codac, too, so long. `--page` renews the rows of these problems in benchmarks/pages/problems.md and .json.
`--contractors` prints the table of docs/solve.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import platform
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import cpcal
from benchmarks.methods.codac import contract
from cpcal.problems.problem import StatedProblem, answer
from cpcal.problems.problem_files import load_problem
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import Reason, also_asked_by, heard
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr
from cpcal.solver.network.expression import topological
from cpcal.solver.search import clusters

HERE = Path(__file__).parent
PROBLEMS, PAGES = HERE / "problems", HERE / "pages"
_BESIDE = (
    "codac (`--codac SECONDS`, as in the cells that say not finished): one CtcInverse for each equation, depth",
    "first, the widest component halved; it has no proof of single solutions in this form (clusters of boxes",
    "narrower than 1e-6 are counted) and no minimiser. Its seconds are processor time, of 2026-11-22 12:47 unless the",
    "row was run with codac. ibex was not run: the column",
    "has what its repository, github.com/ibex-team/ibex-lib, publishes: doc/solver.rst (kin1), or the folder of",
    "benchs/optim in which it keeps the problem (easy, medium); empty where it publishes nothing.",
)
_COMBINATIONS = (
    (("hc4", "newton"), "smear-relative"),
    (("hc4", "newton"), "largest"),
    (("hc4", "cid", "newton"), "smear-relative"),
    (("hc4", "newton", "beaumont"), "smear-relative"),
    (("hc4", "newton", "lifted"), "smear-relative"),
    (("lifted", "newton"), "largest"),
)
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
    codac: str = ""  # what it leaves; empty where it was not run
    ibex: str = ""  # what its authors publish
    when: str = ""  # it was run (UTC), and beside how much other work


@contextmanager
def processor_limit(seconds: float) -> Iterator[None]:
    """Searches within are asked to stop after so much processor time."""
    until = time.process_time() + seconds
    with heard(), also_asked_by(lambda: Reason.INTERRUPTED if time.process_time() > until else None):
        yield


def run(name: str, limit: float, codac: float = 0.0) -> ProblemRow:
    """One problem without options but the limit of processor time, and another for codac (0: not at all)."""
    problem, known = load_problem(PROBLEMS / f"{name}.bch"), literature()[name]
    when = f"{time.strftime('%Y-%m-%d %H:%M', time.gmtime())}, load {os.getloadavg()[0]:.0f}"
    wall, began = time.perf_counter(), time.process_time()
    with processor_limit(limit):
        found = answer(problem)
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
    beside = _beside(problem, codac), str(known.get("ibex", "")), when
    return ProblemRow(name, size, rows, said, text, complete, found.nodes, seconds, processor, method, *beside)


def _beside(problem: StatedProblem, limit: float) -> str:
    if not limit:
        return ""
    if problem.objective is not None:
        return "no minimiser"
    found = by_codac(problem.network, limit)
    return f"{found.text}, {found.nodes} nodes, {found.processor:.2f} s"


def literature() -> dict[str, dict[str, Any]]:
    """By name the number of solutions in the domain, or the least value; and what ibex's authors publish."""
    found: dict[str, dict[str, Any]] = json.loads((PROBLEMS / "literature.json").read_text())
    return found


def page(rows: list[ProblemRow], limit: float) -> str:
    """The table, misses first in words."""
    missed = [row.name for row in rows if not row.complete]
    done = f"{len(rows) - len(missed)} of {len(rows)} complete"
    lines = [
        "# Classic problems",
        "",
        f"`python -m benchmarks.solver_problems --limit {limit:g} --page`: `solve()` and `minimize()` without options,",
        f"{limit:g} s of processor time each, one process, {platform.machine()}, Python {platform.python_version()}.",
        "Each row says when it was run (UTC) and the load of the machine then: with other work wall time is longer,",
        "and processor time, too, by a third or so.",
        "",
        f"{done}. Misses: {', '.join(missed) or 'none'}.",
        "",
        *_BESIDE,
        "",
        "| problem | unknowns | rows | literature | proved | complete | nodes | s | processor s | codac | ibex | run |",
        f"|{' --- |' * 12}",
    ]
    for r in rows:
        word = "yes" if r.complete else "no"
        cells = (r.name, r.unknowns, r.constraints, r.literature, r.found, word, r.nodes)
        lines.append(
            f"| {' | '.join(map(str, cells))} | {r.seconds:.2f} | {r.processor:.2f} | {r.codac} | {r.ibex} | {r.when} |"
        )
    return "\n".join(lines) + "\n"


def by_contractors(names: list[str], limit: float) -> Iterator[str]:
    """The lines of a table: each combination alone on each system, proved solutions and nodes, or how far it got."""
    yield "| system | " + " | ".join(f"`{', '.join(c)}` by {by}" for c, by in _COMBINATIONS) + " |"
    yield "| --- " * (1 + len(_COMBINATIONS)) + "|"
    for name in names:
        network, known = load_problem(PROBLEMS / f"{name}.bch").network, literature()[name]["solutions"]
        cells = []
        for contractors, strategy in _COMBINATIONS:
            with processor_limit(limit):
                paving = network.solve(contractors=contractors, strategy=strategy)
            proved = sum(s.verdict is Verdict.PROVED for s in paving.solutions)
            whole = paving.complete and proved == known == len(paving.solutions)
            cells.append(f"{proved} of {known} ({paving.nodes:,})" if whole else f"{proved}, not finished")
        yield f"| {name} | {' | '.join(cells)} |"


def _renew(row: ProblemRow, limit: float) -> None:
    """The page with this row, beside those of earlier runs; codac's cell stays where codac was not run."""
    PAGES.mkdir(exist_ok=True)
    file = PAGES / "problems.json"
    before = [ProblemRow(**known) for known in json.loads(file.read_text())] if file.exists() else []
    row = replace(row, codac=row.codac or next((r.codac for r in before if r.name == row.name), ""))
    rows = sorted([r for r in before if r.name != row.name and r.name in literature()] + [row], key=lambda r: r.name)
    file.write_text(json.dumps([asdict(r) for r in rows], indent=1) + "\n")
    (PAGES / "problems.md").write_text(page(rows, limit))


def main() -> None:
    """Run the named problems, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--limit", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--codac", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--contractors", action="store_true")
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    load = cpcal.Network("warm")
    x = load.variable("x", 2, (-2, 2))
    load.add([x[0] ** 2 + x[1] ** 2 == 1, x[0] == x[1]])
    load.solve()  # compiles and loads
    if given.contractors:
        systems = [name for name, known in literature().items() if "solutions" in known]
        for line in by_contractors(given.names or systems, given.limit):
            print(line, flush=True)
        return
    rows = []
    for name in given.names or sorted(literature()):
        row = run(name, given.limit, given.codac)
        rows.append(row)
        if given.page:
            _renew(row, given.limit)
        cost = f"{row.nodes:>7} {row.seconds:>7.2f} {row.processor:>7.2f}"
        print(f"{' ' if row.complete else '*'} {row.name:24} {row.literature:>16}  {row.found:36} {cost}", flush=True)
    print(f"{sum(row.complete for row in rows)} of {len(rows)} complete")


if __name__ == "__main__":
    main()


# --------------------------------------------------------------------------------------------------------------------
# The systems of `benchmarks/problems` by codac: one CtcInverse for each equation, boxes divided where they are widest.
#
# codac has no proof of single solutions in this form: what it leaves are clusters of boxes narrower than 1e-6. It
# has no minimiser.

_WIDTH = 1e-6
_UNARY = ("sqr", "sqrt", "sin", "cos", "tan", "exp", "log", "abs", "atan", "asin", "acos")
_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
}


@dataclass(frozen=True)
class CodacResult:
    """`clusters` of boxes that are left; `complete` where none of them is wider than 1e-6; processor seconds."""

    clusters: int
    complete: bool
    nodes: int
    processor: float

    @property
    def text(self) -> str:
        """For a cell of a table."""
        return f"{self.clusters} clusters" if self.complete else "not finished"


def by_codac(network: ConstraintNetwork, limit: float) -> CodacResult:
    """Depth first, for so many seconds of processor time. Raises KeyError for an operation that is not written here.

    In a process of its own: codac switches the processor's rounding, which cpcal refuses to compute with.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_searched, network, limit).result()


def _searched(network: ConstraintNetwork, limit: float) -> CodacResult:
    import codac

    contractors = _contractors(network)
    domain = network.domain
    stack = [codac.IntervalVector(np.stack([domain.lo, domain.hi], axis=1).tolist())]
    kept, nodes, began = [], 0, time.process_time()
    while stack and time.process_time() - began < limit:
        box = stack.pop()
        nodes += 1
        contract(contractors, box)
        if box.is_empty():
            continue
        widths = np.asarray(box.diam()).ravel()
        if widths.max() <= _WIDTH:
            kept.append(box)
        else:
            stack += box.bisect(int(np.argmax(widths)))
    spent = time.process_time() - began
    left = [Box(network.names, np.asarray(b.lb()).ravel(), np.asarray(b.ub()).ravel()) for b in kept]
    count = int(clusters(left).max(initial=-1)) + 1
    return CodacResult(count, not stack, nodes, spent)


def _contractors(network: ConstraintNetwork) -> list[Any]:
    import codac

    x = codac.VectorVar(len(network.names))
    start, count = {}, itertools.count()
    for leaf in network.variables:
        start[leaf.digest] = [x[next(count)] for _ in range(math.prod(leaf.shape))]
    out = []
    for constraint in network.constraints:
        body = _elements(constraint.body, start)
        lower = np.broadcast_to(_constant(constraint.lower), constraint.body.shape).ravel()
        upper = np.broadcast_to(_constant(constraint.upper), constraint.body.shape).ravel()
        for element, low, high in zip(body.flat, lower, upper, strict=True):
            function = codac.AnalyticFunction([x], element)
            out.append(codac.CtcInverse(function, codac.Interval(low[0], high[1])))
    return out


def _constant(expr: Expr) -> Any:
    assert isinstance(expr.data, IntervalArray)
    out = np.empty(expr.shape, object)
    for index in np.ndindex(expr.shape):
        out[index] = (float(expr.data.lo[index]), float(expr.data.hi[index]))
    return out


def _elements(root: Expr, start: dict[bytes, list[Any]]) -> Any:
    """codac's expressions for the elements of one of ours, an array of its shape."""
    import codac

    done: dict[bytes, Any] = {}
    for node in topological((root,)):
        args = [done[arg.digest] for arg in node.args]
        if node.op == "variable":
            out = _shaped(start[node.digest], node.shape)
        elif node.op == "constant":
            pairs = _constant(node)
            out = np.empty(node.shape, object)
            for index in np.ndindex(node.shape):
                low, high = pairs[index]
                out[index] = low if low == high else codac.ScalarExpr(codac.Interval(low, high))
        elif node.op == "index":
            assert isinstance(node.data, np.ndarray)
            flat = list(args[0].flat)
            out = _shaped([flat[k] for k in node.data.ravel().tolist()], node.shape)
        elif node.op == "sum":
            total = np.sum(args[0], axis=node.parameter)
            out = _shaped(list(total.flat) if isinstance(total, np.ndarray) else [total], node.shape)
        elif node.op == "neg":
            out = _each(lambda a: -a, args, node.shape)
        elif node.op == "power":
            out = _each(lambda a, p=node.parameter: codac.pow(a, p), args, node.shape)
        elif node.op in _UNARY:
            out = _each(getattr(codac, node.op), args, node.shape)
        else:
            out = _each(_BINARY[node.op], args, node.shape)
        done[node.digest] = out
    return done[root.digest]


def _shaped(values: list[Any], shape: tuple[int, ...]) -> Any:
    out = np.empty(shape, object)
    for index, value in zip(np.ndindex(shape), values, strict=True):
        out[index] = value
    return out


def _each(function: Callable[..., Any], args: list[Any], shape: tuple[int, ...]) -> Any:
    out = np.empty(shape, object)
    full = [np.broadcast_to(arg, shape) for arg in args]
    for index in np.ndindex(shape):
        out[index] = function(*(arg[index] for arg in full))
    return out
