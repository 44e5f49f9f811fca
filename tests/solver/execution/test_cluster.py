"""A Dask scheduler and two workers on 127.0.0.1: the same certificates through them, whoever of them dies."""

import re
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import dask
import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.solver.execution import executors

OPTIONS = ["--legs", "1,2,3", "--delta", "0.5", "--gap", "1e-2", "--support", "none", "-q"]
pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own


class Cluster:
    """Begins what is missing of a scheduler and its workers."""

    def __init__(self, folder):
        self.folder, self.scheduler, self.workers = folder, None, []

    def complete(self, workers):
        """Its address, once so many workers are there."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self.end()
            self.scheduler = self._begun("scheduler", "--port", "0", "--no-dashboard")
            self.address = self._said("scheduler", rb"tcp://[\d.]+:\d+")
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < workers:
            self.workers.append(self._begun("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"))
            self._said("worker", rb"Registered to")
        return self.address

    def end(self):
        for process in (*self.workers, self.scheduler):
            if process is not None:
                process.kill()
                process.wait()
        self.workers, self.scheduler = [], None

    def _begun(self, what, *options):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options, "--host", "127.0.0.1"]
        with (self.folder / what).open("wb") as said:
            return subprocess.Popen(command, stdout=said, stderr=said, cwd=self.folder)

    def _said(self, what, pattern):
        for _ in range(1200):
            found = re.search(pattern, (self.folder / what).read_bytes())
            if found:
                return found[0].decode()
            time.sleep(0.05)
        pytest.fail((self.folder / what).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    few = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=8)
    folder = tmp_path_factory.mktemp("campaign") / "day"
    cpcal.save_campaign(few, folder)
    return folder


@pytest.fixture(scope="module")
def alone(campaign, tmp_path_factory):
    """The exit status and the certificates without a cluster."""
    run = tmp_path_factory.mktemp("alone") / "run"
    status = certified(run, campaign).exit_code
    assert status in (0, 1)
    return status, certificates(run)


def certified(run, campaign, *options):
    return CliRunner().invoke(app, ["certify", str(campaign), "-o", str(run), *OPTIONS, *options])


def certificates(run):
    return {str(path.relative_to(run)): path.read_bytes() for path in sorted(run.rglob("*.cert.jsonl"))}


def once_answered(run, happens):
    """Something happens as soon as the first leg is in the checkpoint of a run."""

    def watch():
        while not list(Path(run).glob("checkpoint/*.answer")):
            time.sleep(0.005)
        happens()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


def test_legs_have_the_same_certificates_and_a_worker_that_is_killed_changes_nothing(
    cluster, campaign, alone, tmp_path
):
    address = cluster.complete(workers=2)
    killed = once_answered(tmp_path, cluster.workers[0].kill)
    there = certified(tmp_path, campaign, "--scheduler", address)
    killed.join(10)
    assert cluster.workers[0].wait(10) < 0
    assert (there.exit_code, certificates(tmp_path)) == alone, there.output
    assert len(certificates(tmp_path)) >= 3


class Deserted(Executor):
    """Of a Dask client that looks for its scheduler again once the first task is done."""

    __module__ = "distributed.client"
    _client = SimpleNamespace(status="running")

    def submit(self, work, /, *given, **named):
        future = Future()
        if self._client.status == "running":
            future.set_result(work(*given, **named))
        self._client = SimpleNamespace(status="connecting")
        return future


def ends_with_what_is_proved(found, run, campaign, alone):
    assert found.exit_code == 2, found.output
    assert "the scheduler is gone" in found.stderr
    assert "go on with: cpcal" in found.stderr
    assert "Traceback" not in found.output
    proved = cpcal.load_result(run)
    assert proved.interrupted
    assert 1 <= len(proved.legs) < 3
    assert CliRunner().invoke(app, ["verify", str(run)]).exit_code == 0
    assert certified(run, campaign, "--resume").exit_code == alone[0]
    assert certificates(run) == alone[1]


def test_a_run_that_loses_its_scheduler_ends_with_what_is_proved(campaign, alone, tmp_path, monkeypatch):
    client = SimpleNamespace(get_executor=lambda pure: Deserted(), ncores=dict)
    monkeypatch.setattr(executors, "_cluster", lambda address: nullcontext(client))
    monkeypatch.setattr(executors, "DESERTED", 0.3)
    found = certified(tmp_path, campaign, "--scheduler", "tcp://127.0.0.1:1")
    ends_with_what_is_proved(found, tmp_path, campaign, alone)


def test_where_no_scheduler_answers_that_is_said(campaign, tmp_path):
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        found = certified(tmp_path, campaign, "--scheduler", "tcp://127.0.0.1:1")
    assert found.exit_code == 2
    assert "no Dask scheduler answers there" in found.stderr
