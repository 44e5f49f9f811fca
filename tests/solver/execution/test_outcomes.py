"""The same certificates, byte for byte, wherever tasks are done; none is lost with its worker."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

import cpcal
from cpcal.cli import verify
from cpcal.common.errors import InputError
from cpcal.solver.execution import executors
from cpcal.solver.execution.executors import Here, LostWorkerError, Processes, executor_for, outcomes
from cpcal.solver.execution.stopping import Reason, also_asked_by, asked, heard


def squared(number):
    return number * number


def failing(number):
    if number == 3:
        raise ValueError("three")
    return number


def killed_once(path):
    """Dies the first time; a file tells that it was here."""
    if not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return path.name


def deadly(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def until_asked(number):
    while not asked():
        time.sleep(0.01)
    return number


def test_every_task_has_one_outcome_wherever_it_is_done():
    for executor, most in ((Here(), 1), (ThreadPoolExecutor(2), 4)):
        with executor:
            done = {task: future.result() for task, future in outcomes(executor, most, squared, range(20))}
        assert done == {k: k * k for k in range(20)}


def test_a_task_that_raises_stops_no_other():
    found = list(outcomes(Here(), 1, failing, range(5)))
    assert [task for task, future in found if future.exception()] == [3]
    assert [future.result() for _, future in found if not future.exception()] == [0, 1, 2, 4]


def test_no_task_is_begun_after_a_stop():
    done = []
    with also_asked_by(lambda: Reason.INTERRUPTED if len(done) == 2 else None):
        for task, _ in outcomes(Here(), 1, squared, range(10)):
            done.append(task)
    assert done == [0, 1]


def test_a_task_whose_worker_is_killed_is_begun_again(tmp_path):
    paths = [tmp_path / str(k) for k in range(2)]
    with executor_for(workers=2) as (pool, most):
        assert sorted(future.result() for _, future in outcomes(pool, most, killed_once, paths)) == ["0", "1"]


@pytest.mark.parametrize("task", [None, time.sleep])
def test_no_worker_outlives_its_pool(monkeypatch, task):
    """Also one that does not hear that it should stop, whose answer nobody takes any more."""
    monkeypatch.setattr("cpcal.solver.execution.executors.PATIENCE", 1.0)
    pool = Processes(1)
    pid = pool.submit(os.getpid).result(60)
    if task:
        pool.submit(task, 100.0)
    pool.shutdown()
    assert gone(pid)


def test_a_task_that_kills_its_worker_harms_no_other():
    with executor_for(workers=2) as (pool, most):
        found = dict(outcomes(pool, most, deadly, range(4)))
    assert isinstance(found[1].exception(), LostWorkerError)
    assert [found[k].result() for k in (0, 2, 3)] == [0, 2, 3]


def test_workers_hear_of_a_stop_and_what_they_answer_comes():
    began = time.monotonic()
    stop = lambda: Reason.INTERRUPTED if time.monotonic() - began > 3.0 else None  # noqa: E731 - they must be at work
    with also_asked_by(stop), executor_for(workers=2) as (pool, most):
        found = [future.result() for _, future in outcomes(pool, most, until_asked, range(100))]
    assert len(found) <= 2 + 2 + 1


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc")
@pytest.mark.parametrize("again", [False, True])
def test_a_worker_that_is_stopped_does_not_hold_up_a_stop(monkeypatch, again):
    """It never hears that it is asked to; ten seconds later, or at a second signal, it is killed."""
    monkeypatch.setattr("cpcal.solver.execution.executors.PATIENCE", 600.0 if again else 1.0)
    with heard(), executor_for(workers=2) as (pool, most):
        pid = pool.submit(os.getpid).result(60)
        pool.submit(os.kill, pid, signal.SIGSTOP)
        while state(pid) != "T":
            time.sleep(0.01)
        monkeypatch.setattr("cpcal.solver.execution.stopping._note.insisted", again)
        began = time.monotonic()
        with also_asked_by(lambda: Reason.INTERRUPTED if time.monotonic() > began + 0.5 else None):
            assert [future.result() for _, future in outcomes(pool, most, until_asked, range(2))] in ([], [0], [1])
    assert gone(pid)


def test_a_fork_server_that_is_killed_while_it_begins_costs_no_task(monkeypatch):
    begun = []
    start = multiprocessing.context.ForkServerProcess.start

    def killed_first(process):
        begun.append(process)
        if len(begun) == 1:
            raise EOFError("unexpected EOF")  # what multiprocessing says of it
        start(process)

    monkeypatch.setattr(multiprocessing.context.ForkServerProcess, "start", killed_first)
    with executor_for(workers=2) as (pool, most):
        assert sorted(future.result() for _, future in outcomes(pool, most, squared, range(3))) == [0, 1, 4]
    assert len(begun) >= 2


@pytest.mark.parametrize("unpicklable", [lambda: 0, threading.Lock()])
def test_what_cannot_travel_is_its_tasks_error_alone(unpicklable):
    with executor_for(workers=2) as (pool, most):
        found = {str(task): future for task, future in outcomes(pool, most, str, [1, unpicklable, 2])}
    assert re.search("pickle", str(found.pop(str(unpicklable)).exception()), re.IGNORECASE)
    assert sorted(future.result() for future in found.values()) == ["1", "2"]


_ORPHANS = """
import os, signal, sys, time
from cpcal.solver.execution.executors import (Processes)

if __name__ == "__main__":
    pool = Processes(2)
    print(*{pool.submit(os.getpid).result() for _ in range(8)}, flush=True)
    pool.submit(time.sleep, 600)
    time.sleep(600)
"""


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_no_worker_outlives_the_process_that_began_it(tmp_path, name):
    script = tmp_path / "orphans.py"
    script.write_text(_ORPHANS, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    workers = [int(text) for text in process.stdout.readline().split()]
    assert workers
    process.send_signal(getattr(signal, name))
    process.wait(60)
    process.stdout.close()
    assert all(map(gone, workers))


def state(pid):
    """Of a process, as the system has it ("S" it sleeps, "T" it is stopped); "" where it has ended."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0].replace("Z", "")
    except OSError:
        return ""


def gone(pid):
    """Whether a process ends, within half a minute."""
    until = time.monotonic() + 30.0
    while state(pid) and time.monotonic() < until:
        time.sleep(0.05)
    return not state(pid)


def test_processes_are_not_signalled_with_us():
    with executor_for(workers=1 + 1) as (pool, _):
        assert isinstance(pool, Processes)
        pid = pool.submit(os.getpid).result()
        os.kill(pid, signal.SIGINT)
        os.kill(pid, signal.SIGTERM)
        assert pool.submit(squared, 3).result() == 9


def test_two_places_are_refused():
    with pytest.raises(InputError, match="both given"), executor_for(workers=2, scheduler="tcp://127.0.0.1:1"):
        pass


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


def test_legs_that_a_killed_worker_did_not_check_are_checked_here():
    checks = [partial(dies, os.getpid(), "here"), *(partial(pow, 3, n) for n in range(4))]
    with verify._beside(checks) as legs:
        assert legs() == ["here", 1, 3, 9, 27]
    with verify._beside([*checks, partial(int, "x")]) as legs, pytest.raises(ValueError, match="invalid literal"):
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
