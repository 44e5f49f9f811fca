"""For all tests: no test depends on how fast the machine is, and each worker keeps to its own processor."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from tests.warm_up import compile_kernels

for library in ("OMP", "OPENBLAS", "MKL"):  # before numpy is loaded: threads of two workers would fight for the cores
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# without bytecode each of the hundreds of processes that tests start would translate all of cpcal anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("cpcal", deadline=None)
settings.load_profile("cpcal")

# More than five seconds of processor time each (`--durations` tells), the longest first. Begun last, one of them would
# keep a worker busy while the others have nothing left to do.
LONG = (
    *("cli/test_images.py", "benchmarks/test_mutations.py", "solver/test_planted.py", "vision/test_identify.py"),
    *("checker/malformed/test_checker_hostile.py", "handeye/test_uncertain_poses.py", "report/test_browser.py"),
    *("handeye/test_frames_proof.py", "handeye/test_wrong_images.py", "test_commands.py", "vision/test_dots.py"),
    *("benchmarks/test_runs.py", "checker/forged/test_fuzz.py", "checker/valid/test_rule.py", "test_notebook.py"),
    *("solver/test_paving_checkpoint.py", "solver/network/test_forms.py", "solver/interval/test_engines.py"),
    *("certify/test_many_campaigns.py", "certify/test_compare.py", "solver/linear/test_exact_programs.py"),
    *("calibration/test_frames.py", "solver/optimize/test_rounds.py", "certify/test_data_check.py"),
    *("calibration/test_fit.py", "solver/test_compiled.py", "solver/interval/test_sums.py", "solver/test_choice.py"),
    *("vision/test_calibrated_poses.py", "checker/forged/test_forged.py", "certify/test_resumed.py"),
)
PLACES = {Path(__file__).parent / name: place for place, name in enumerate(LONG)}


def pytest_configure(config: pytest.Config) -> None:
    """Where workers will run the tests, what they all need is compiled first, once."""
    if config.getoption("numprocesses", default=None):  # a worker has none itself
        compile_kernels()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take longest come first."""
    items.sort(key=lambda item: PLACES.get(item.path, len(PLACES)))
