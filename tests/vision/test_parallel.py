"""Work in parallel: every piece on one thread, whoever else begins or ends; the caller's limits come back."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from threadpoolctl import threadpool_info

from cpcal.vision.batch.detect import in_parallel
from cpcal.vision.opencv import opencv


def limits():
    """The threads of OpenCV and of every library of linear algebra in this process."""
    np.ones(1) @ np.ones(1)
    blas = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
    assert blas
    return [opencv().getNumThreads(), *blas]


@pytest.fixture
def free():
    """Libraries that may use four threads, set back in the end."""
    from threadpoolctl import threadpool_limits

    before = opencv().getNumThreads()
    with threadpool_limits(limits=4):
        opencv().setNumThreads(4)
        yield limits()
    opencv().setNumThreads(before)


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
