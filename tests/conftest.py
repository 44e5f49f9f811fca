"""For all tests: no test depends on how fast the machine is, and each worker keeps to its own processor."""

import fcntl
import gc
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.warm_up import compile_kernels

for library in ("OMP", "OPENBLAS", "MKL"):  # before numpy is loaded: threads of two workers would fight for the cores
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# without bytecode each of the hundreds of processes that tests start would translate all of cpcal anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Python looks for garbage each 700 objects, which took 8 % of the tests' time
gc.set_threshold(50_000)

settings.register_profile("cpcal", deadline=None)
settings.load_profile("cpcal")

# More than five seconds of processor time each (`--durations` tells), the longest first. Begun last, one of them would
# keep a worker busy while the others have nothing left to do.
LONG = """
    models/test_hand_eye_runs.py checker/malformed/test_checker_hostile.py contractors/test_conformance.py
    test_commands.py questions/test_compare.py models/test_pose_set_forgeries.py models/test_pose_set.py
    cli/test_images.py benchmarks/test_damaged_runs.py questions/test_certify_robust.py questions/test_resumed.py
    questions/test_data_check.py checker/forged/test_fuzz.py models/test_robot_study.py
    questions/test_study_calibration.py solver/test_checkpoints.py checker/valid/test_rule.py
    report/test_browser.py solver/execution/test_cluster.py questions/test_many_campaigns.py cli/test_every_key.py
    cli/test_process.py vision/test_world.py solver/test_compiled.py checker/forged/test_checker_run.py
    solver/execution/test_outcomes.py checker/forged/test_forged.py vision/test_identify.py cli/test_verbs.py
    solver/network/test_forms.py cli/test_tampering.py solver/network/test_operations.py checker/test_platform.py
    problems/test_minibex.py benchmarks/test_mutants_of_code.py calibration/test_frames.py
    solver/optimize/test_rounds.py cli/test_demo.py cli/test_verify.py solver/test_choice.py cli/test_leaving.py
    solver/search/test_pavings.py cli/test_calibrate.py calibration/test_fit.py cli/test_killed.py
    solver/interval/test_elementary.py
""".split()  # noqa: SIM905
PLACES = {Path(__file__).parent / name: place for place, name in enumerate(LONG)}


def pytest_configure(config: pytest.Config) -> None:
    """Where workers will run the tests, what they all need is compiled first, once."""
    if config.getoption("numprocesses", default=None):  # a worker has none itself
        compile_kernels()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take longest come first."""
    items.sort(key=lambda item: PLACES.get(item.path, len(PLACES)))


def pytest_collection_finish() -> None:
    """Thousands of tests and all that they import stay to the end: the garbage collector need not look through them."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def genuine_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Path], None]:
    """Copies a run of a kind (`benchmarks.damaged_runs`) into a folder; each is made once, for all workers."""
    from benchmarks.damaged_runs import RUNS  # which loads everything

    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "genuine"
    shared.mkdir(exist_ok=True)

    def copied(kind: str, folder: Path) -> None:
        made, draft = shared / kind, shared / f"{kind}.draft"
        with (shared / f"{kind}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not made.exists():
                shutil.rmtree(draft, ignore_errors=True)
                draft.mkdir()
                RUNS[kind](draft)
                draft.rename(made)
        shutil.copytree(made, folder, dirs_exist_ok=True)

    return copied


def _missing(report: pytest.TestReport | pytest.CollectReport) -> tuple[str, bool]:
    """Why something was skipped, and whether it may be missing: a browser, and measurements that are not ours."""
    reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
    return reason.removeprefix("Skipped: "), "chromium" in reason or "real_data" in report.keywords


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """What was skipped, and why."""
    reasons = Counter(map(_missing, terminalreporter.stats.get("skipped", [])))
    for (reason, allowed), count in sorted(reasons.items()):
        terminalreporter.write_line(f"skipped {count}: {reason}{'' if allowed else ' -- WHICH MAY NOT BE MISSING'}")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A test that nobody ran has not passed: the run fails where something else is missing than what may be."""
    reporter: Any = session.config.pluginmanager.get_plugin("terminalreporter")
    skipped = reporter.stats.get("skipped", []) if reporter is not None else []
    if sys.platform == "linux" and session.exitstatus == 0 and not all(_missing(one)[1] for one in skipped):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
