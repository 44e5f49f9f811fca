"""However the program ends, it says one sentence and has the exit status that belongs to it."""

import os
import re
import subprocess
import sys

import pytest

from tests.cli.command import refused

# Something happens the moment a module is imported; runners may start us with SIGINT ignored.
_AT_IMPORT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[0] = "cpcal"  # as the installed command has it

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            {happens}

sys.meta_path.insert(0, Finder())
from cpcal.__main__ import main
main()
"""


def run(code, *arguments, stdout=subprocess.PIPE, **more):
    environment = {k: v for k, v in os.environ.items() if k != "CPCAL_TRACEBACK"} | more
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        env=environment,
    )


CTRL_C = "os.kill(os.getpid(), signal.SIGINT)"
# Dataclasses are made by exec; Python would end by the signal itself, whatever the status.
WITHIN_EXEC = f"exec({CTRL_C!r}, {{'os': os, 'signal': signal}})"


@pytest.mark.parametrize(
    ("verb", "module", "happens"),
    [
        ("plugins", "lazy_loader", CTRL_C),
        ("--help", "typer", CTRL_C),
        ("plugins", "cpcal.solver.plugins", CTRL_C),
        ("plugins", "cpcal.cli.solve", WITHIN_EXEC),
    ],
)
def test_ctrl_c_while_starting_up_is_130_without_a_traceback(verb, module, happens):
    done = run(_AT_IMPORT.format(module=module, happens=happens), verb)
    assert (done.returncode, done.stderr) == (130, "cpcal: interrupted\n")


def test_a_program_that_imports_cpcal_keeps_its_own_ctrl_c():
    code = _AT_IMPORT.replace('sys.argv[0] = "cpcal"', "").replace(
        "from cpcal.__main__ import main\nmain()",
        "try:\n    import cpcal\nexcept KeyboardInterrupt:\n    print('mine')",
    )
    done = run(code.format(module="lazy_loader", happens=CTRL_C))
    assert (done.returncode, done.stdout, done.stderr) == (0, "mine\n", "")


@pytest.mark.parametrize("module", ["cpcal.cli.app", "cpcal.cli.solve"])
def test_an_internal_error_is_3_and_asks_for_a_report(module):
    happens = "raise RuntimeError('bad\\nLeg 1: proved\\x1b[2J')"
    code = _AT_IMPORT.format(module=module, happens=happens)
    assert "Traceback" in run(code, "plugins", CPCAL_TRACEBACK="1").stderr or module == "cpcal.cli.app"
    done = run(code, "plugins")
    assert done.returncode == 3
    assert done.stderr.startswith("cpcal: internal error, please report it")
    assert "RuntimeError" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "\x1b" not in done.stderr


def test_too_little_memory_is_a_message_with_what_was_asked(campaign, tmp_path, monkeypatch):
    def short(*_):
        raise MemoryError("Unable to allocate 7.5 GiB")

    monkeypatch.setattr("cpcal.cli.certify.answered", short)
    said = refused("certify", campaign, "-o", tmp_path / "run")
    assert re.search(r"too little memory: 64 measurements .* 7\.5 GiB.* --resume", said), said


@pytest.mark.skipif(sys.platform != "linux", reason="needs limits of address space")
def test_where_libraries_have_no_room_that_is_said_at_once():
    """OpenBLAS would ask for its buffers for ever, deaf to SIGTERM."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (450_000_000, resource.RLIM_INFINITY))\n"
    done = run(limit + "from cpcal.__main__ import main; main()", "plugins")
    assert done.returncode == 2
    assert "address space is limited to 450 MB" in done.stderr
