"""Linear algebra on one thread: also in libraries that are loaded later."""

import os
import subprocess
import sys

import pytest

BEFORE = """
with one():
    numpy_only = threads()
import scipy.linalg
with one():
    print(numpy_only, threads())
"""
WITHIN = """
with one():
    numpy_only = threads()
    import scipy.linalg
    print(numpy_only, threads())
print("environment", [name for name in os.environ if "THREADS" in name])
"""


@pytest.mark.parametrize(("loaded", "end"), [(BEFORE, ""), (WITHIN, "environment []\n")])
def test_a_library_loaded_later_keeps_to_one_thread(loaded, end):
    code = (
        "import os, numpy\n"
        "from threadpoolctl import threadpool_info\n"
        "from cpcal.solver.execution.executors import linear_algebra_on_one_thread as one\n"
        "def threads():\n"
        "    return sorted(one['num_threads'] for one in threadpool_info() if one['user_api'] == 'blas')\n"
    )
    free = {name: value for name, value in os.environ.items() if "THREADS" not in name}
    done = subprocess.run([sys.executable, "-c", code + loaded], env=free, capture_output=True, text=True, check=True)
    assert done.stdout == "[1] [1, 1]\n" + end
