"""Outlines of spots as ellipses: ours beside OpenCV's, on an image of the study's kind and one full of specks.

    python -m benchmarks.outline_methods [--repeats 200]

Milliseconds, the best of the repeats, for all outlines of an image that `findContours` tells: ours, compiled, all at
once; `cv2.moments`, one Python call an outline, of the outlines that ours keeps the shape of (a test compares the
numbers); `cv2.fitEllipse`, of all points of the outlines; and for the size of these, `findContours` itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.vision_conditions import CONDITIONS, poses_for
from benchmarks.vision_scenes import one
from benchmarks.vision_world import photograph
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.dots.outlines import ellipses
from cpcal.vision.opencv import opencv
from cpcal.vision.target import DELTALAB_TARGET

_NAMES = ("plain", "clutter: texture")
_SIDE, _LEAST = 43, 20.0  # pixels of the neighbourhood, and grey levels above its mean


def ours(outlines: Sequence[Any], width: int, height: int) -> int:
    count = len(outlines)
    center, spread, keep = np.empty((count, 2)), np.empty((count, 2, 2)), np.empty(count, dtype=bool)
    ends = np.cumsum(np.fromiter(map(len, outlines), dtype=np.int64, count=count))
    ellipses(np.concatenate(outlines)[:, 0], ends, width, height, center, spread, keep)
    return int(keep.sum())


def moments(outlines: Sequence[Any]) -> int:
    """Centres and second moments, as OpenCV has them, without the tests of shape and border."""
    found = [m for m in map(opencv().moments, outlines) if m["m00"] > 0.0]
    names = ("m10", "m01", "mu20", "mu11", "mu02")
    return len(np.array([[m[name] / m["m00"] for name in names] for m in found]))


def fits(outlines: Sequence[Any]) -> int:
    return len([opencv().fitEllipse(outline) for outline in outlines if len(outline) >= 5])


def best(work: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return 1e3 * min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=200)
    repeats = parser.parse_args().repeats
    cv2 = opencv()
    cv2.setNumThreads(1)
    print(f"{'image':18}{'outlines':>9}{'findContours':>14}{'ours':>8}{'moments':>9}{'fitEllipse':>12}")
    for name in _NAMES:
        rng = np.random.default_rng(0)
        pose = one(poses_for(CONDITIONS[name], rng, 1), 0)
        image = photograph(DELTALAB_TARGET, DELTALAB_CAMERA, pose, CONDITIONS[name], rng)
        excess = cv2.subtract(image, cv2.blur(image, (_SIDE, _SIDE)))
        mask = cv2.threshold(excess, _LEAST, 255.0, cv2.THRESH_BINARY)[1]
        simple = cv2.CHAIN_APPROX_SIMPLE
        corners, every = (cv2.findContours(mask, cv2.RETR_LIST, how)[0] for how in (simple, cv2.CHAIN_APPROX_NONE))
        height, width = mask.shape
        times = (
            best(partial(cv2.findContours, mask, cv2.RETR_LIST, simple), repeats),
            best(partial(ours, corners, width, height), repeats),
            best(partial(moments, corners), max(repeats // 4, 1)),
            best(partial(fits, every), max(repeats // 10, 1)),
        )
        print(f"{name:18}{len(corners):>9}{times[0]:>14.2f}{times[1]:>8.2f}{times[2]:>9.2f}{times[3]:>12.2f}")


if __name__ == "__main__":
    main()
