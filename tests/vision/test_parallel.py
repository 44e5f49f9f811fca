"""Work in parallel: every piece on one thread, whoever else begins or ends; the caller's limits come back."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from threadpoolctl import threadpool_info

from cpcal.vision.batch.detect import in_parallel
from cpcal.vision.opencv import opencv

WAIT = 60.0  # seconds: only a failure takes as long


def limits():
    """The threads of OpenCV and of every library of linear algebra in this process."""
    np.ones(1) @ np.ones(1)
    blas = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
    assert blas
    return [opencv().getNumThreads(), *blas]


class Overlapping:
    """The first piece is at work until the second one, begun after it, has ended."""

    def __init__(self):
        self.begun, self.other_ended = threading.Event(), threading.Event()

    def __call__(self, names):
        if "first" in names:
            self.begun.set()
            assert self.other_ended.wait(WAIT)
        else:
            assert self.begun.wait(WAIT)
        return limits()


@pytest.fixture
def free():
    """Libraries that may use four threads, set back in the end."""
    from threadpoolctl import threadpool_limits

    before = opencv().getNumThreads()
    with threadpool_limits(limits=4):
        opencv().setNumThreads(4)
        yield limits()
    opencv().setNumThreads(before)


def test_a_worker_that_ends_does_not_set_the_others_free(free):
    work = Overlapping()
    names = ["first"] * 8 + ["second"] * 8
    with ThreadPoolExecutor(2) as pool:
        found = in_parallel(work, names, executor=pool)
        second = next(found)
        between = limits()
        work.other_ended.set()
        first = next(found)
        assert not list(found)
    assert set(second) == set(between) == set(first) == {1}
    assert limits() == free


def test_limits_come_back_after_an_error_and_after_an_abandoned_run(free):
    def fails(names):
        raise RuntimeError("on purpose")

    with pytest.raises(RuntimeError, match="on purpose"):
        list(in_parallel(fails, ["a"], workers=1))
    assert limits() == free
    running: Any = in_parallel(lambda names: limits(), ["a"] * 20, workers=1)
    assert set(next(running)) == {1}
    running.close()
    assert limits() == free
