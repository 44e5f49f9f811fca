"""Does the memory of a long search stay flat, and does a limit of memory end one with what is proved?

    python -m benchmarks.soak [--minutes 20] [--in-memory 20000] [--memory-limit MB] [--certificate] [--page]

A minimum in six dimensions is sought by hc4 alone, best first, so that hundreds of thousands of boxes wait; more than
`--in-memory` of them do so on disk. With `--certificate` lifted works too, and every step is proved by weights and kept
for the certificate. Every ten seconds the memory of the process is printed with the bracket. At the end: how much it
grew over the second half of the time, in MB an hour. `--page` keeps it all in benchmarks/pages/soak*.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
import time
from pathlib import Path

import numpy as np

import cpcal
from benchmarks.machine import machine
from cpcal.solver.certificate.recording import UncertifiedError
from cpcal.solver.execution.stopping import resident_bytes, within_memory
from cpcal.solver.optimize.minimum import Bracket
from cpcal.solver.search import search

_EVERY = 10.0  # seconds
_PAGES = Path(__file__).parent / "pages"
_COLUMNS = ("seconds", "MB", "boxes", "waiting", "lo", "hi")

Sample = tuple[float, float, int, int, float, float]  # of these columns


def problem() -> tuple[cpcal.Network, cpcal.Expr]:
    """Many local minima, and boxes that interval arithmetic alone hardly closes."""
    net = cpcal.Network()
    x, t = net.variable("x", shape=6, domain=(-3, 3)), net.variable("t", domain=(-1000, 1000))
    total = sum((x[k] * x[k + 1] - 0.3 * k) ** 2 + 0.1 * x[k] for k in range(5))
    net.add(total + x[5] * x[0] * x[2] <= t)
    return net, t


class Curve:
    """Memory over time, printed now and then."""

    def __init__(self) -> None:
        self.began = self.last = time.monotonic()
        self.seen: list[Sample] = []

    def __call__(self, bracket: Bracket) -> None:
        now = time.monotonic()
        if now - self.last < _EVERY:
            return
        self.last = now
        memory = resident_bytes() / 1e6
        self.seen.append((now - self.began, memory, bracket.nodes, bracket.pending, bracket.lo, bracket.hi))
        said = f"{bracket.nodes:,} boxes, {bracket.pending:,} wait, [{bracket.lo:.4g}, {bracket.hi:.4g}]"
        print(f"{now - self.began:6.0f} s  {memory:7.1f} MB  {said}", flush=True)

    def growth(self) -> float:
        """MB an hour, of the second half."""
        half = np.array(self.seen[len(self.seen) // 2 :])
        if len(half) < 2:
            return float("nan")
        return float(3600.0 * np.polyfit(half[:, 0], half[:, 1], 1)[0])


def keep(curve: Curve, stem: str, command: str, sentence: str) -> None:
    """The samples as a table, a curve, and a page that shows one sample a minute."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    with (_PAGES / f"{stem}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([_COLUMNS, *([round(s, 1), round(m, 1), *rest] for s, m, *rest in curve.seen)])
    minutes = np.array([sample[0] for sample in curve.seen]) / 60.0
    with pyplot.rc_context({"svg.hashsalt": "cpcal", "svg.fonttype": "none", "font.family": "sans-serif"}):
        figure, axes = pyplot.subplots(2, 1, figsize=(8.0, 5.0), sharex=True, layout="constrained")
        for axis, column, label in ((axes[0], 1, "memory, MB"), (axes[1], 3, "boxes that wait")):
            axis.plot(minutes, [sample[column] for sample in curve.seen], color="C0")
            axis.set_ylim(bottom=0)
            axis.set_ylabel(label)
            axis.grid(color="0.85")
        axes[1].set_xlabel("minutes")
        figure.savefig(_PAGES / f"{stem}.svg", metadata={"Date": None})
        pyplot.close(figure)
    rows = [f"| {s / 60:.0f} | {m:.1f} | {boxes:,} | {wait:,} |" for s, m, boxes, wait, *_ in curve.seen[5::6]]
    stated = "; ".join(f"{key} {value}" for key, value in machine().items())
    date = time.strftime("%Y-%m-%d", time.gmtime())
    lines = [
        "# A long search under a limit of memory",
        "",
        f"`{command}`, {date}; {stated}; load {os.getloadavg()[0]:.1f} at the end.",
        "",
        sentence,
        "",
        f"![Memory and boxes that wait]({stem}.svg)",
        "",
        f"Every ten seconds in [{stem}.csv]({stem}.csv); once a minute:",
        "",
        "| minute | memory, MB | boxes done | boxes that wait |",
        "| --- | --- | --- | --- |",
        *rows,
        "",
    ]
    (_PAGES / f"{stem}.md").write_text("\n".join(lines), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--in-memory", type=int, default=20_000)
    parser.add_argument("--memory-limit", type=int, default=1000)
    parser.add_argument("--certificate", action="store_true")
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    search.IN_MEMORY = given.in_memory
    net, t = problem()
    curve = Curve()
    with tempfile.TemporaryDirectory() as folder, within_memory(given.memory_limit * 10**6):
        try:
            found = net.minimize(
                t,
                contractors=["hc4", "lifted"] if given.certificate else ["hc4"],
                limits=cpcal.Limits(seconds=60.0 * given.minutes, gap=1e-12),
                progress=curve,
                certificate=Path(folder) / "minimum.cert.jsonl" if given.certificate else None,
            )
        except UncertifiedError as error:  # so many boxes are left that checking would be too much work
            found = error.answer
            print(error, flush=True)
    ended = f"{found.nodes:,} boxes, {found.pending:,} pending, [{found.lo:.6g}, {found.hi:.6g}]"
    growth = f"memory of the second half grew by {curve.growth():.1f} MB an hour; limit {given.memory_limit} MB"
    print(f"{found.status} {ended}\n{growth}")
    if given.page:
        options = f"--minutes {given.minutes:g} --in-memory {given.in_memory} --memory-limit {given.memory_limit}"
        options += " --certificate" if given.certificate else ""
        first, last = curve.seen[len(curve.seen) // 2], curve.seen[-1]
        sentence = (
            f"{ended}. From minute {first[0] / 60:.0f} to the end memory went from {first[1]:.1f} to {last[1]:.1f} MB "
            f"while the boxes that wait went from {first[3]:,} to {last[3]:,}; {growth}."
        )
        stem = "soak_certificate" if given.certificate else "soak"
        keep(curve, stem, f"python -m benchmarks.soak {options} --page", sentence)


if __name__ == "__main__":
    main()
