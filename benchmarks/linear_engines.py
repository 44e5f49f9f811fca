"""Linear engines side by side: a leg's eps*, its refutation and its hull, interleaved in one process.

    python -m benchmarks.linear_engines                     the legs of the demo's kind, 64 measurements
    python -m benchmarks.linear_engines leg1-e1-n7744-d100  other problems

Processor time with one thread, from the measurements to the answer (the network is built anew), medians; both engines
must say the same.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

from benchmarks.methods.hull import hull
from benchmarks.problems import Leg
from contractors import Lifted
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.limits import Limits
from cpcal.solver.linear import Dense, LinearEngine
from cpcal.solver.linear.glop import Glop
from cpcal.solver.optimize import Minimum, minimize, run

ENGINES: dict[str, Callable[[], LinearEngine]] = {"dense": Dense, "glop": Glop}
LEGS = [f"leg{leg}-e{error}-n64-d100{kind}" for kind in ("", "-u") for error in (0, 1, 10) for leg in (1, 5)]
_ENGINE = get_arithmetic("float64")


def bracket(leg: Leg, engine: Callable[[], LinearEngine], eps: float | None = None) -> Minimum:
    network = leg.network(eps)
    lifted = Lifted(network, objective="eps", engine=engine)
    return run(minimize(network, "eps", lifted, engine=_ENGINE, limits=Limits(), start=leg.start), None)


def timed(work: Callable[[], object], repeat: int) -> float:
    """Median of milliseconds of processor time."""
    times = []
    for _ in range(repeat):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return 1e3 * median(times)


def compared(name: str, repeat: int) -> str:
    leg = Leg.named(name)
    if leg is None:
        raise SystemExit(f"{name}: legs are named like leg1-e1-n64-d100")
    found = {engine: bracket(leg, ENGINES[engine]) for engine in ENGINES}
    dense, glop = found["dense"], found["glop"]
    assert dense.verdict is glop.verdict
    assert max(dense.lo, glop.lo) <= min(dense.hi, glop.hi)
    cells = [f"{name:<22} {dense.lo:.7f} {dense.nodes:3d} {dense.programs:4d}"]
    questions: list[float | None] = [None] if leg.uncertain else [None, 0.9 * dense.lo]
    for eps in questions:
        if eps is not None:
            assert bracket(leg, Dense, eps).verdict is Verdict.REFUTED
        times = dict.fromkeys(ENGINES, 0.0)
        for engine in ENGINES:
            times[engine] = timed(lambda engine=engine, eps=eps: bracket(leg, ENGINES[engine], eps), repeat)  # type: ignore[misc]
        cells.append(f"{times['dense']:8.1f} {times['glop']:8.1f} {times['dense'] / times['glop']:6.2f}")
    if not leg.uncertain:
        answer = hull(leg, ("lifted",), 1.1 * dense.hi, 60.0)
        cells.append(f"{timed(lambda: hull(leg, ('lifted',), 1.1 * dense.hi, 60.0), 1):8.0f}  {answer.note}")
    return " |".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", nargs="*", default=LEGS)
    parser.add_argument("--repeat", type=int, default=5)
    asked = parser.parse_args()
    head = "eps_lo, nodes, programs | eps*: dense ms, glop ms, ratio | refuted at 0.9 eps*: the same | hull at 1.1 eps*"
    print(f"{'problem':<22} {head}")
    for name in asked.problems:
        print(compared(name, asked.repeat), flush=True)


if __name__ == "__main__":
    main()
