"""The same answers and certificates, byte for byte, whoever does the work: ten problems, five places.

    python -m benchmarks.same_bytes [--only NAME...]

Each problem is done here, then by processes of this machine (1, 2 and 4) and by a Dask cluster of three worker
processes on this machine, whose scheduler listens on the loopback address alone. What is compared: of pavings all boxes
and the number of nodes; of minima and legs the certificates and the order of brackets. The exit status is 1 where any
differ.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import cpcal
from cpcal.solver.execution.executors import Processes

Answer = Callable[[Path, Any], Any]


def ring(order: str, width: float, contractors: list[str] | None, inner: bool) -> Answer:
    """A set in three dimensions."""

    def answer(folder: Path, executor: Any) -> Any:
        net = cpcal.Network()
        y = net.variable("y", shape=3, domain=(-2, 2))
        net.add((y[0] * y[0] + y[1] * y[1]).within((1, 2)))
        net.add((y[1] * y[2] + cpcal.sin(y[0])).within((0.1, 0.5)))
        return _boxes(net.solve(width=width, order=order, contractors=contractors, inner=inner, executor=executor))

    return answer


def roots(folder: Path, executor: Any) -> Any:
    """Points, each proved to be the only one in its box, by methods in turns."""
    net = cpcal.Network()
    x = net.variable("x", shape=4, domain=(-2, 2))
    for k in range(4):
        net.add(x[k] * x[(k + 1) % 4] + 0.5 * x[(k + 2) % 4] ** 2 - 0.3 * (k + 1) * x[k] == 0.1 * k)
    return _boxes(net.solve(executor=executor, limits=cpcal.Limits(nodes=2000)))


def _boxes(found: cpcal.Paving) -> Any:
    boxes = [*found.inside, *found.outside, *(s.box for s in found.solutions)]
    bounds = [(box.lo.tobytes(), box.hi.tobytes()) for box in boxes]
    return found.nodes, found.status, [s.verdict.value for s in found.solutions], bounds


def minimum(contractors: list[str], nodes: int) -> Answer:
    """One among many, so that boxes are divided."""

    def answer(folder: Path, executor: Any) -> Any:
        net = cpcal.Network()
        x, t = net.variable("x", shape=5, domain=(-2, 2)), net.variable("t", domain=(-50, 50))
        twisted = sum((x[k] * x[k + 1] - 0.3 * k) ** 2 + 0.1 * x[k] for k in range(4))
        net.add(twisted + x[4] * x[0] <= t)
        seen: list[Any] = []
        path = folder / "minimum.cert.jsonl" if "lifted" in contractors else None
        found = net.minimize(
            t,
            contractors=contractors,
            limits=cpcal.Limits(nodes=nodes),
            certificate=path,
            progress=lambda b: seen.append((b.lo, b.hi, b.nodes, b.pending)),
            executor=executor,
        )
        return found.lo, found.hi, found.nodes, found.pending, seen

    return answer


def legs(numbers: list[int], campaign: cpcal.Campaign, **options: Any) -> Answer:
    def answer(folder: Path, executor: Any) -> Any:
        found = cpcal.certify(campaign, legs=numbers, certificates=folder, executor=executor, **options)
        return [
            (leg.leg, leg.bracket.lo, leg.bracket.hi, leg.support.ids, leg.work.nodes, leg.bracket.point)
            for leg in found.legs
        ]

    return answer


def problems() -> dict[str, Answer]:
    few = cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)
    exact = cpcal.simulate(seed=2, joint_error=1.0, factor=0.0)
    uncertain = cpcal.simulate(seed=3, joint_error=1.0, extremal=False, random_poses=16)
    return {
        "paving, hc4": ring("depth", 0.25, ["hc4"], inner=False),
        "paving, inner boxes": ring("breadth", 0.3, ["hc4"], inner=True),
        "paving, hc4 and lifted": ring("best", 0.5, None, inner=True),
        "roots": roots,
        "minimum with splits": minimum(["lifted"], 200),
        "minimum with splits, hc4": minimum(["hc4"], 1500),
        "leg with splits": legs([6], few, delta=200.0, support="none"),
        "legs with splits": legs([2, 3, 5], few, delta=200.0),
        "legs, irreducible support": legs([1, 4], exact, support="irreducible"),
        "legs, uncertain readings": legs([1, 2], uncertain),
    }


@contextmanager
def places() -> Iterator[dict[str, Any]]:
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        pools = {f"{count} processes": Processes(count) for count in (1, 2, 4)}
        for pool in pools.values():
            stack.callback(pool.shutdown, cancel_futures=True)
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        cluster = LocalCluster(n_workers=3, threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
        client = Client(stack.enter_context(cluster))
        yield {"here": None, **pools, "Dask, 3 workers": stack.enter_context(client)}


def digest(answer: Answer, executor: Any) -> str:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        said = repr(answer(folder, executor)).encode()
        files = [path.name.encode() + path.read_bytes() for path in sorted(folder.glob("*.cert.jsonl"))]
    return hashlib.sha256(b"\0".join([said, *files])).hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[])
    given = parser.parse_args()
    differ = 0
    with places() as where:
        for name, answer in problems().items():
            if given.only and name not in given.only:
                continue
            found, began = {}, time.monotonic()
            for place, executor in where.items():
                found[place] = digest(answer, executor)
            others = [place for place in found if found[place] != found["here"]]
            differ += bool(others)
            said = f"differs: {', '.join(others)}" if others else "the same everywhere"
            print(f"{name:26}  {found['here'][:12]}  {said}  ({time.monotonic() - began:.0f} s)", flush=True)
    raise SystemExit(1 if differ else 0)


if __name__ == "__main__":
    main()
