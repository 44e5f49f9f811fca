"""Compiled functions, and what happens where they cannot be compiled or kept."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cpcal.solver import compiled

LOWER = "from cpcal.solver.compiled import compiled\n\n@compiled\ndef step(x):\n    return x + {step}\n"
UPPER = """from cpcal.solver.compiled import compiled
from lower import step

@compiled
def twice(x):
    return step(step(x))
"""
LONG = "    x = x + 1.0\n" * 400
SLOW = f"from cpcal.solver.compiled import compiled\n\n@compiled\ndef f(x):\n{LONG}    return x\n"
HOLD = """
import os, sys, time
from cpcal.common.files import exclusive
exclusive(os.open(sys.argv[1], os.O_RDWR | os.O_CREAT))
print(flush=True)
time.sleep(100)
"""
RUN = "from upper import twice; print(twice(1.0))"


def begun(folder: Path, code: str) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(folder), str(Path(compiled.__file__).parents[2])])
    environment = {**os.environ, "PYTHONPATH": paths}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def run(folder: Path, code: str = RUN, **environment: str) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter that finds cpcal here and the modules in `folder`."""
    root = Path(compiled.__file__).parents[2]
    paths = os.pathsep.join([str(folder), str(root)])
    return subprocess.run(
        [sys.executable, "-W", "always::RuntimeWarning", "-c", code],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        capture_output=True,
        text=True,
        check=True,
    )


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    (tmp_path / "lower.py").write_text(LOWER.format(step="1.0"))
    (tmp_path / "upper.py").write_text(UPPER)
    return tmp_path


def test_machine_code_is_kept_and_follows_the_files_that_a_function_calls_into(modules):
    first, second = run(modules), run(modules)
    assert first.stdout == second.stdout == "3.0\n"
    assert "compiling 'twice', once ... done" in first.stderr
    assert "compiling" not in second.stderr
    (modules / "lower.py").write_text(LOWER.format(step="2.0"))
    hushed = run(modules, CPCAL_QUIET="1")
    assert (hushed.stdout, hushed.stderr) == ("5.0\n", "")  # compiled anew, though upper.py did not change


def test_of_two_processes_one_compiles_and_the_other_takes_what_it_made(modules):
    (modules / "slow.py").write_text(SLOW)
    both = [begun(modules, "from slow import f; print(f(1.0))") for _ in range(2)]
    said = [one.communicate(timeout=100) for one in both]
    assert [out for out, _ in said] == ["401.0\n"] * 2
    assert sum("compiling" in told.replace("that compiles", "") for _, told in said) == 1


@contextmanager
def held(lock: Path) -> Iterator[None]:
    """While in the block another process has the lock."""
    lock.parent.mkdir(exist_ok=True)
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(lock)], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        yield
    finally:
        holder.kill()
        holder.communicate()


def test_a_lock_that_nobody_gives_back_is_waited_for_no_longer_than_is_said(modules):
    with held(modules / "__pycache__" / "upper.lock"):
        late = run(modules, f"from cpcal.solver import compiled; compiled.LONGEST = 1.0; {RUN}")
        assert late.stdout == "3.0\n"
        assert "waiting for another process that compiles 'twice'" in late.stderr
        assert run(modules).stderr == ""  # nobody waits for what is there


LATE = """
import time
from cpcal.solver.compiled import TimeUp, compiling_until
from upper import twice
try:
    with compiling_until(time.monotonic() + {seconds}):
        twice(1.0)
except TimeUp as told:
    print(told)
"""


def test_after_the_time_limit_nothing_is_compiled_or_waited_for(modules):
    said = "the time limit came before 'twice' was compiled\n"
    with held(modules / "__pycache__" / "upper.lock"):
        assert run(modules, LATE.format(seconds=0.2)).stdout == said
    assert run(modules, LATE.format(seconds=-1.0) + RUN).stdout == f"{said}3.0\n"
    assert run(modules, LATE.format(seconds=-1.0)).stdout == ""  # what is there is loaded at any time


NOT_BEGUN = """
import sys
from pathlib import Path
from cpcal.solver import compiled
compiled._folder = lambda source: Path(sys.argv[1])
import cpcal
net = cpcal.Network()
x = net.variable("x", 2, (0.5, 2.0))
net.add(x[0] * x[1] == 1.0)
paving = net.solve(time_limit=0.0)
assert not paving.complete and [s.box for s in paving.solutions] == [net.domain]
print(paving.status)
for objective in (x[0], x[0] + x[1]):
    found = net.minimize(objective, time_limit=0.0)
    assert found.verdict is cpcal.Verdict.UNKNOWN and found.enclosure == net.domain and not found.interrupted
    print(found.status)
"""


def test_a_verb_whose_time_is_over_before_its_kernels_are_compiled_says_what_was_not_begun(tmp_path):
    done = subprocess.run([sys.executable, "-c", NOT_BEGUN, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout.count("Not begun: the time limit came before '") == 3
    assert "compiling" not in done.stderr
    assert not list(tmp_path.glob("*.kernel"))


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "of length zero": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "overwritten": lambda content: bytes(len(content)),
    "one bit turned": lambda content: content[:-300] + bytes([content[-300] ^ 1]) + content[-299:],
}


def test_machine_code_that_is_damaged_is_compiled_again_and_replaced(modules):
    run(modules)
    files = list((modules / "__pycache__").glob("*.kernel"))
    assert len(files) == 2
    for damage in DAMAGES.values():
        for file in files:
            file.write_bytes(damage(file.read_bytes()))
        again = run(modules)
        assert again.stdout == "3.0\n"
        assert "compiling 'twice', once ... done" in again.stderr
    assert run(modules).stderr == ""


def test_without_room_for_machine_code_it_goes_on_and_says_so_once(modules):
    small = "import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (1000, 1000))"  # as on a full disk, writing fails
    done = run(modules, f"{small}; {RUN}")
    assert done.stdout == "3.0\n"
    assert done.stderr.count("machine code cannot be kept in") == 1
    assert not list((modules / "__pycache__").glob("*.kernel*"))


def test_without_numba_it_runs_and_says_so_once(modules):
    hidden = f"import sys; sys.modules['numba'] = None; {RUN}"
    done = run(modules, hidden)
    assert done.stdout == "3.0\n"
    assert done.stderr.count("numba is not installed") == 1


@pytest.mark.parametrize("home", [True, False])
def test_a_folder_that_can_not_be_written_is_no_error(modules, tmp_path_factory, home):
    cache = tmp_path_factory.mktemp("cache")
    shutil.rmtree(modules / "__pycache__", ignore_errors=True)
    (modules / "__pycache__").write_text("in the way")
    if not home:
        cache.rmdir()
        cache.write_text("in the way")
    first, second = (run(modules, XDG_CACHE_HOME=str(cache)) for _ in range(2))
    assert first.stdout == second.stdout == "3.0\n"
    assert ("compiling" in second.stderr) is not home
    assert second.stderr.count("machine code cannot be kept in") == (0 if home else 1)


def test_the_plain_function_is_the_compiled_one():
    @compiled.compiled
    def half(x: float) -> float:
        return x / 2.0

    assert half(3.0) == compiled.plain(half)(3.0) == 1.5


def test_with_the_compiler_switched_off_nothing_is_said(modules):
    done = run(modules, NUMBA_DISABLE_JIT="1")
    assert (done.stdout, done.stderr) == ("3.0\n", "")
