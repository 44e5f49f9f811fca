"""Systems with a solution that was put there: no search may lose it. `python -m benchmarks.planted_solutions`

Random polynomial and elementary equations in two to four unknowns, whose constants are enclosures of the values at a
random point. The search runs with each list of contractors, in both arithmetics, deciding 1 and 64 boxes at a time;
the point must lie in a box that is left, and batches of either size must leave the same boxes. Exits with status 1 and
names the seed where not.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from cpcal.common.values import Floats
from cpcal.solver import plugins
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork, Expr, evaluate, sqr, sqrt
from cpcal.solver.search import Divide, LargestFirst, Search

CONTRACTORS = (("hc4",), ("hc4", "newton"), ("lifted",), ("hc4", "shaving"), ("cid",), ("box",), ("krawczyk",))
NODES = {"float64": 12, "arb": 4}  # of a search: what is still pending counts as left


def planted(seed: int) -> tuple[ConstraintNetwork, Floats]:
    """A network and a solution of it."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    net, point = ConstraintNetwork(), rng.uniform(-2.0, 2.0, n)
    x = net.variable("x", n, (np.full(n, -3.0), np.full(n, 3.0)))
    at = Box(net.names, point, point)
    for _ in range(n):
        body = _expression(rng, x, n)
        value = evaluate(net, body, at, arithmetic="arb")
        net.add(body.within((value.lo, value.hi)))
    return net, point


def _expression(rng: np.random.Generator, x: Expr, n: int) -> Expr:
    body = 0.0 * x[0]
    for _ in range(int(rng.integers(2, 5))):
        i, j = (int(k) for k in rng.integers(0, n, 2))
        c = float(rng.uniform(-3.0, 3.0))
        term = [x[i], x[i] * x[j], sqr(x[i]), sqrt(sqr(x[i]) + sqr(x[j]) + 0.5)][int(rng.integers(0, 4))]
        body = body + c * term
    return body


def kept(network: ConstraintNetwork, contractors: Sequence[str], arithmetic: str, batch: int) -> list[Box]:
    """All boxes that a search leaves which decides so many boxes at a time."""
    process = Divide(plugins.build(network, contractors, arithmetic=arithmetic), LargestFirst(1e-3))
    search = Search([network.domain], process, abreast=64, batch=batch)
    for event in search:
        if event.node.serial > NODES[arithmetic]:
            break
    return [*(node.box for node in search.pending), *(piece.box for piece in search.kept)]


def lost(seed: int, arithmetics: Sequence[str]) -> list[str]:
    """What went wrong with one system."""
    network, point = planted(seed)
    wrong = []
    for contractors in CONTRACTORS:
        for arithmetic in arithmetics:
            answers = [kept(network, contractors, arithmetic, batch) for batch in (1, 64)]
            name = f"seed {seed}, {'+'.join(contractors)}, {arithmetic}"
            for batch, boxes in zip((1, 64), answers, strict=True):
                if not any(bool(np.all((box.lo <= point) & (point <= box.hi))) for box in boxes):
                    wrong.append(f"{name}, batches of {batch}: the solution {point} is lost")
            if len(answers[0]) != len(answers[1]) or any(a != b for a, b in zip(*answers, strict=True)):
                wrong.append(f"{name}: batches of 1 and of 64 keep different boxes")
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systems", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first system")
    parser.add_argument("--arithmetic", nargs="*", default=["float64", "arb"])
    asked = parser.parse_args()
    wrong = [one for seed in range(asked.seed, asked.seed + asked.systems) for one in lost(seed, asked.arithmetic)]
    print("\n".join(wrong))
    runs = asked.systems * len(CONTRACTORS) * len(asked.arithmetic) * 2
    print(f"{asked.systems} systems, {runs} searches: {len(wrong)} failures")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
