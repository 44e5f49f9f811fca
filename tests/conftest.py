"""For all tests: no test depends on how fast the machine is, and each worker keeps to its own processor."""

from __future__ import annotations

import os
import sys

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


def pytest_configure(config: pytest.Config) -> None:
    """Where workers will run the tests, what they all need is compiled first, once."""
    if config.getoption("numprocesses", default=None):  # a worker has none itself
        compile_kernels()
