"""The same certificates, byte for byte, wherever the work is done on this machine, on one thread each."""

import multiprocessing
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

import cpcal
from cpcal.cli import verify
from cpcal.common.errors import InputError
from cpcal.solver.execution import executors
from cpcal.solver.execution.executors import executor_for

OPTIONS = {"legs": [2, 3], "delta": 200.0, "support": "none"}


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)


@pytest.fixture(scope="module")
def here(campaign, tmp_path_factory):
    return certified(campaign, tmp_path_factory.mktemp("here"))


def certified(campaign, run, **place):
    result = cpcal.certify(campaign, certificates=run, **OPTIONS, **place)
    brackets = [
        (leg.leg, leg.bracket.lo, leg.bracket.hi, leg.support, leg.work.nodes, leg.bracket.certificate)
        for leg in result.legs
    ]
    return brackets, {path.name: path.read_bytes() for path in sorted(run.glob("*.cert.jsonl"))}


@pytest.mark.parametrize("workers", [2, pytest.param(4, marks=pytest.mark.nightly)])
def test_processes_give_the_same_certificates(campaign, here, tmp_path, workers):
    assert certified(campaign, tmp_path, workers=workers) == here


def test_a_model_that_cannot_travel_is_refused_before_the_work(campaign):
    model = cpcal.LegModel("mine", "L + l + 0 x", (cpcal.Parameter("x", "mm", 1.0),), lambda measured, x: 0.0 * x["x"])
    with pytest.raises(InputError, match="cannot be sent to other processes"):
        cpcal.certify(campaign, model=model, workers=2, **OPTIONS)


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc")
def test_signals_of_the_terminal_are_for_the_process_that_began_the_workers():
    script = (
        "import os, signal\n"
        "from cpcal.solver.execution.executors import Processes\n"
        "if __name__ == '__main__':\n"
        "    pool = Processes(1)\n"
        "    server = pool.submit(os.getppid).result()\n"
        "    for pid in ('self', server):\n"
        "        lines = dict(line.split(':') for line in open(f'/proc/{pid}/status'))\n"
        "        blocked = int(lines['SigBlk'], 16)\n"
        "        print(*(bool(blocked >> number - 1 & 1) for number in (signal.SIGINT, signal.SIGTERM)))\n"
        "    pool.shutdown()\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert run.stdout.split("\n")[:2] == ["False False", "True True"], run.stderr


def dies(parent, answer):
    if os.getpid() != parent:
        os._exit(9)
    return answer


def test_legs_that_a_killed_worker_did_not_check_are_checked_here(monkeypatch):
    checks = [partial(dies, os.getpid(), "here"), *(partial(pow, 3, n) for n in range(4))]
    monkeypatch.setattr(verify, "leg_checks", lambda run: checks)
    with verify.legs_beside(Path("run")) as legs:
        assert legs() == ["here", 1, 3, 9, 27]
    monkeypatch.setattr(verify, "leg_checks", lambda run: [*checks, partial(int, "x")])
    with verify.legs_beside(Path("run")) as legs, pytest.raises(ValueError, match="invalid literal"):
        legs()


def test_a_worker_that_is_asked_to_stop_while_its_pipe_is_closed_takes_no_harm(monkeypatch):
    """A thread ends its worker while another asks it to stop: the pipe's number is gone between test and use."""
    here, there = multiprocessing.Pipe(duplex=False)
    worker = object.__new__(executors._Worker)
    worker._life = there
    monkeypatch.setattr(type(there), "_check_closed", lambda self: None)
    there.close()
    worker.ask_to_stop()
    here.close()


def test_a_cluster_that_is_not_there_is_an_error_that_says_what_to_start(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'cpcal\[distributed\]'"), executor_for(scheduler="tcp://x:1"):
        pass


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
