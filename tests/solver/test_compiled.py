"""Compiled functions, and what happens where they cannot be compiled or kept."""

import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from cpcal.solver import compiled
from cpcal.solver.compiled import TimeUp, compiling_until

LOWER = "from cpcal.solver.compiled import compiled\n\n@compiled\ndef step(x):\n    return x + {step}\n"
UPPER = """from cpcal.solver.compiled import compiled
from lower import step

@compiled
def twice(x):
    return step(step(x))
"""
LONG = "    x = x + 1.0\n" * 100
SLOW = f"from cpcal.solver.compiled import compiled\n\n@compiled\ndef f(x):\n{LONG}    return x\n"
HOLD = """
import os, sys, time
from cpcal.common.files import exclusive
exclusive(os.open(sys.argv[1], os.O_RDWR | os.O_CREAT))
print(flush=True)
time.sleep(100)
"""
AHEAD = """
from cpcal.solver.compiled import ahead

@ahead
def call():
    return f(1.0)
"""
BESIDE = """
import time, slow
from cpcal.solver import compiled
from pathlib import Path
from upper import twice
twice(1.0)
while not list(Path(slow.__file__).parent.glob("__pycache__/slow.f-*.kernel")):
    time.sleep(0.1)
print(slow.f(1.0), compiled._compiling)
"""
A_LEG = """
import cpcal
from cpcal.solver import compiled, linear
from cpcal.solver.network import coefficient
longest = [linear._solved.made(False), coefficient.products.made(False)]
for call in compiled._ahead:
    call()
cpcal.certify(cpcal.simulate(seed=1), legs=[1])
print([len(one.signatures) for one in longest])
"""
RUN = "from upper import twice; print(twice(1.0))"
ROOT = Path(compiled.__file__).parents[2]


def begun(folder: Path, code: str, **environment: str) -> subprocess.Popen[str]:
    """A fresh interpreter that finds cpcal here and the modules in `folder`."""
    paths = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.Popen(
        [sys.executable, "-W", "always::RuntimeWarning", "-c", code],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@compiled.compiled
def put(target: npt.NDArray[np.float64], source: npt.NDArray[np.float64]) -> None:
    target[:] = source


def test_arrays_of_another_shape_are_refused_without_what_takes_seconds_to_compile() -> None:
    with pytest.raises(ValueError, match="shapes differ"):
        put(np.zeros(3), np.ones(2))


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lower.py").write_text(LOWER.format(step="1.0"))
    (tmp_path / "upper.py").write_text(UPPER)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    compiled._say_once.cache_clear()
    monkeypatch.delenv("CPCAL_QUIET", raising=False)
    monkeypatch.setattr(compiled, "_begin_ahead", lambda: None)
    return tmp_path


@pytest.fixture
def run(modules: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[[], tuple[float, str]]]:
    """What `twice(1.0)` gives in modules that are imported anew, and what is told."""

    def forget() -> None:
        for name in ("upper", "lower"):
            sys.modules.pop(name, None)
            compiled._stamps.pop(name, None)
        compiled._compiling = 0
        importlib.invalidate_caches()

    def again() -> tuple[float, str]:
        forget()
        value = importlib.import_module("upper").twice(1.0)
        return value, capsys.readouterr().err

    yield again
    forget()


def test_machine_code_is_kept_and_follows_the_files_that_a_function_calls_into(modules, run, monkeypatch):
    first, second = run(), run()
    assert first[0] == second[0] == 3.0
    assert first[1] == "cpcal: compiling its kernels, once; each takes a few seconds\n"
    assert second[1] == ""
    (modules / "lower.py").write_text(LOWER.format(step="2.0"))
    monkeypatch.setenv("CPCAL_QUIET", "1")
    assert run() == (5.0, "")  # compiled anew, though upper.py did not change


def test_of_two_processes_one_compiles_and_the_other_takes_what_it_made(modules):
    (modules / "slow.py").write_text(SLOW)
    both = [begun(modules, "from slow import f; print(f(1.0))") for _ in range(2)]
    said = [one.communicate(timeout=100) for one in both]
    assert [out for out, _ in said] == ["101.0\n"] * 2
    assert sum("compiling" in told.replace("that compiles", "") for _, told in said) == 1


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_the_first_process_that_compiles_has_another_one_begin_with_what_takes_long(modules):
    (modules / "slow.py").write_text(SLOW + AHEAD)
    said, told = begun(modules, BESIDE).communicate(timeout=100)
    assert (said, told.count("\n")) == ("101.0 1\n", 1)


def test_what_is_compiled_ahead_is_what_a_leg_calls(tmp_path):
    said, told = begun(tmp_path, A_LEG).communicate(timeout=100)
    assert said == "[1, 1]\n", told


@contextmanager
def held(lock: Path) -> Iterator[None]:
    """While in the block another process has the lock."""
    lock.parent.mkdir(exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(lock)], stdout=subprocess.PIPE, env=environment)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        yield
    finally:
        holder.kill()
        holder.communicate()


def test_a_lock_that_nobody_gives_back_is_waited_for_no_longer_than_is_said(modules, run, monkeypatch):
    monkeypatch.setattr(compiled, "LONGEST", 1.0)
    with held(modules / "__pycache__" / "upper.lock"):
        value, told = run()
        assert value == 3.0
        assert "waiting for another process that compiles 'twice'" in told
        assert run() == (3.0, "")  # nobody waits for what is there


def test_after_the_time_limit_nothing_is_compiled_or_waited_for(modules, run):
    late = "the time limit came before 'twice' was compiled"
    lock = modules / "__pycache__" / "upper.lock"
    with held(lock), compiling_until(time.monotonic() + 0.2), pytest.raises(TimeUp, match=late):
        run()
    with compiling_until(-1.0), pytest.raises(TimeUp, match=late):
        run()
    assert run()[0] == 3.0
    with compiling_until(-1.0):
        assert run() == (3.0, "")  # what is there is loaded at any time


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


def test_machine_code_that_is_damaged_is_compiled_again_and_replaced(modules, run):
    run()
    (file,) = (modules / "__pycache__").glob("*.kernel")  # `step` is linked into `twice`
    for damage in DAMAGES.values():
        damaged = damage(file.read_bytes())
        file.write_bytes(damaged)
        value, told = run()
        assert value == 3.0
        assert "compiling" in told
        assert file.read_bytes() != damaged
    assert run() == (3.0, "")


SMALL = "import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (1000, 1000))"  # as on a full disk, writing fails
HIDDEN = "import sys; sys.modules['numba'] = None"


@pytest.mark.parametrize(
    ("before", "environment", "told"),
    [
        (SMALL, {}, "machine code cannot be kept in"),
        (HIDDEN, {}, "numba is not installed"),
        ("", {"NUMBA_DISABLE_JIT": "1"}, ""),
    ],
    ids=["without room", "without numba", "switched off"],
)
def test_where_nothing_is_compiled_or_kept_it_runs_and_says_so_once(modules, before, environment, told):
    out, err = begun(modules, f"{before}\n{RUN}", **environment).communicate(timeout=100)
    assert out == "3.0\n"
    assert err.count(told) == 1 if told else err == ""
    assert not list((modules / "__pycache__").glob("*.kernel*"))


FOREIGN = """
import numba
from cpcal.solver.compiled import compiled

@numba.njit
def foreign(x):
    return x + 1.0

@compiled
def own(x):
    return foreign(x) + 1.0

@compiled
def both(x):
    return own(x) + 1.0
"""


@pytest.mark.parametrize("calls", ["both(1.0), foreign(1.0), own(1.0)", "own(1.0), both(1.0), foreign(1.0)"])
def test_what_a_compiled_function_calls_can_be_called_from_python_too(modules, calls):
    (modules / "foreign.py").write_text(FOREIGN)
    out, err = begun(modules, f"from foreign import *\nprint({calls})").communicate(timeout=100)
    assert sorted(out.split()) == ["2.0", "3.0", "4.0"], err


@pytest.mark.parametrize("home", [True, False])
def test_a_folder_that_can_not_be_written_is_no_error(modules, run, tmp_path, monkeypatch, home):
    (modules / "__pycache__").write_text("in the way")
    cache = tmp_path / "cache"
    cache.mkdir() if home else cache.write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    if home:
        first, second = run(), run()
        assert first[0] == 3.0
        assert second == (3.0, "")
        return
    with pytest.warns(RuntimeWarning, match="machine code cannot be kept in") as said:
        first, second = run(), run()
    assert first[0] == second[0] == 3.0
    assert "compiling" in second[1]
    assert len(said) == 1
