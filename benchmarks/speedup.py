"""How much sooner two workers are done than one: a paving, images, many campaigns; what workers cost a small leg.

    python -m benchmarks.speedup [--workers 2] [--campaigns 200] [--images 1000] [--repeats 3]
        [--only leg paving images campaigns]

Each is done with one process and with workers, in turns, so that other work on the machine slows both; ratios are of
medians of wall time, start of the workers included, and mean something on an idle machine only: the load is printed.
What is compiled or cached is so before. Answers, tables and certificates are compared, too. The leg is certified by
itself: no worker has anything to do, and the ratio says what the road costs; it is done ten times as often. Images are
rendered first, which is not counted; `--folder` keeps them. On two idle cores leg, paving and images take some eight
minutes in all, campaigns a quarter of an hour with `--repeats 1`.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cpcal
from benchmarks.throughput import rendered
from cpcal.cli.certify import CampaignWork, certified_all
from cpcal.cli.options import Talk
from cpcal.solver.execution.executors import executor_for
from cpcal.vision.batch.detect import ImageFolder, detect
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.detection import detections_bytes
from cpcal.vision.target import DELTALAB_TARGET

_KINDS = ("leg", "paving", "images", "campaigns")
_OFTEN = 10  # times more, since it is short


def paving(workers: int) -> Any:
    """A set in three dimensions, with boxes inside."""
    net = cpcal.Network()
    y = net.variable("y", shape=3, domain=(-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((1, 2)))
    net.add((y[1] * y[2] + cpcal.sin(y[0])).within((0.1, 0.5)))
    found = net.solve(width=0.1, inner=True, workers=None if workers == 1 else workers)
    return found.nodes, found.inside, [s.box for s in found.solutions]


def leg(workers: int) -> Any:
    """A small one, which closes in its first boxes, with certificates."""
    campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0)
    with tempfile.TemporaryDirectory() as name:
        found = cpcal.certify(campaign, legs=[1], certificates=name, workers=None if workers == 1 else workers)
        files = {path.name: path.read_bytes() for path in Path(name).glob("*.cert.jsonl")}
    return found.legs[0].eps_lo, found.legs[0].eps_hi, files


def images(count: int, folder: Path) -> Callable[[int], Any]:
    """The study's, as PNG files."""
    rendered(count, folder)
    size = (DELTALAB_CAMERA.width, DELTALAB_CAMERA.height)

    def detected(workers: int) -> Any:
        found = detect(ImageFolder(folder, size), DELTALAB_TARGET, DELTALAB_CAMERA, workers=workers)
        return detections_bytes(found.rows)

    return detected


def campaigns(count: int) -> Callable[[int], Any]:
    """Many small ones, certified with ranges, projections and pages."""
    keep = tempfile.TemporaryDirectory()
    folder = Path(keep.name)
    folders = [folder / f"campaign{seed}" for seed in range(count)]
    for seed, path in enumerate(folders):
        cpcal.save_campaign(cpcal.simulate(seed=seed, joint_error=1.0, factor=0.0), path)

    def certified(workers: int) -> Any:
        assert keep
        runs = folder / f"runs{workers}"
        with executor_for(workers) as place:
            certified_all(folders, runs, CampaignWork({}, checker=True), place, talk=Talk(quiet=True))
        return {path.relative_to(runs): path.read_bytes() for path in sorted(runs.rglob("*.cert.jsonl"))}

    return certified


def measured(name: str, work: Callable[[int], Any], workers: int, repeats: int) -> None:
    times: dict[int, list[float]] = {1: [], workers: []}
    answers = []
    for _ in range(repeats):
        for count, spent in times.items():
            began = time.monotonic()
            answers.append(work(count))
            spent.append(time.monotonic() - began)
    same = all(answer == answers[0] for answer in answers)
    alone, together = statistics.median(times[1]), statistics.median(times[workers])
    load = os.getloadavg()[0]
    said = f"{alone:.2f} s with 1, {together:.2f} s with {workers}: {alone / together:.2f} times as fast"
    print(f"{name}, {repeats} times: {said}; the same answers: {same}; load {load:.1f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--images", type=int, default=1000)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", nargs="+", default=list(_KINDS), choices=_KINDS)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        begin: dict[str, Callable[[], Callable[[int], Any]]] = {
            "leg": lambda: leg,
            "paving": lambda: paving,
            "images": lambda: images(given.images, given.folder or Path(name)),
            "campaigns": lambda: campaigns(given.campaigns),
        }
        for kind in given.only:
            leg(1)  # now all is compiled
            repeats = given.repeats * (_OFTEN if kind == "leg" else 1)
            measured(kind, begin[kind](), given.workers, repeats)


if __name__ == "__main__":
    main()
