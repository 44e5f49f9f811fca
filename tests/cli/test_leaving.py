"""However the program ends, it says one sentence and has the exit status that belongs to it."""

import dataclasses
import os
import re
import subprocess
import sys

import pytest

import cpcal
from cpcal.cli.app import VERBS
from tests.cli.command import done, refused
from tests.cli.command import run as command

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


@pytest.mark.parametrize(
    ("verb", "module"),
    [
        ("plugins", "lazy_loader"),
        ("--help", "typer"),
        ("plugins", "cpcal.solver.plugins"),
    ],
)
def test_ctrl_c_while_starting_up_is_130_without_a_traceback(verb, module):
    done = run(_AT_IMPORT.format(module=module, happens="os.kill(os.getpid(), signal.SIGINT)"), verb)
    assert (done.returncode, done.stderr) == (130, "cpcal: interrupted\n")


def test_ctrl_c_within_an_exec_is_130_too():
    """Dataclasses are made by exec; Python would end by the signal itself, whatever the status."""
    happens = "exec('os.kill(os.getpid(), signal.SIGINT)', {'os': os, 'signal': signal})"
    done = run(_AT_IMPORT.format(module="cpcal.cli.solve", happens=happens), "plugins")
    assert (done.returncode, done.stderr) == (130, "cpcal: interrupted\n")


def test_a_program_that_imports_cpcal_keeps_its_own_ctrl_c():
    code = _AT_IMPORT.replace('sys.argv[0] = "cpcal"', "").replace(
        "from cpcal.__main__ import main\nmain()",
        "try:\n    import cpcal\nexcept KeyboardInterrupt:\n    print('mine')",
    )
    done = run(code.format(module="lazy_loader", happens="os.kill(os.getpid(), signal.SIGINT)"))
    assert (done.returncode, done.stdout, done.stderr) == (0, "mine\n", "")


@pytest.mark.parametrize("module", ["cpcal.cli.app", "cpcal.cli.solve"])
def test_an_internal_error_is_3_and_asks_for_a_report(module):
    happens = "raise RuntimeError('bad\\nLeg 1: proved\\x1b[2J')"
    done = run(_AT_IMPORT.format(module=module, happens=happens), "plugins")
    assert done.returncode == 3
    assert done.stderr.startswith("cpcal: internal error, please report it")
    assert "RuntimeError" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "\x1b" not in done.stderr


def test_a_traceback_is_there_for_who_asks():
    code = _AT_IMPORT.format(module="cpcal.cli.solve", happens="raise RuntimeError('bad')")
    done = run(code, "plugins", CPCAL_TRACEBACK="1")
    assert done.returncode == 3
    assert "Traceback" in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("argument", ["plugins", "--help"])
def test_a_full_disk_is_said_and_is_2(argument):
    with open("/dev/full", "w") as full:
        done = run("from cpcal.__main__ import main; main()", argument, stdout=full)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "No space left" in done.stderr


def test_an_empty_name_is_refused_by_every_verb():
    words = [(verb, ["-o", ""]) for verb in VERBS] + [
        ("certify", empty) for empty in (["--output="], ["-o", "  "], [""])
    ]
    for verb, empty in words:
        done = command(*verb.split(), "x", *empty)
        assert (done.exit_code, "is empty" in done.stderr) == (2, True), (verb, empty)


def test_a_folder_of_a_strange_name_forges_no_line(tmp_path):
    assert len(done("simulate", "deltalab", "-o", tmp_path / "x\nLeg 1: proved").splitlines()) == 1


@pytest.mark.parametrize("verb", [["certify", "--eps", "0"], ["certify", "--model", "plain,gain"]])
def test_a_campaign_in_metres_is_warned_of_before_the_work(tmp_path, verb):
    campaign = cpcal.simulate(seed=1)
    metres = dataclasses.replace(campaign, position=campaign.position / 1e3)
    cpcal.save_campaign(metres, tmp_path / "c")
    name, *options = verb
    limits = ["--legs", "1", "--time-limit", "0.01"]
    done = command(name, tmp_path / "c", "-o", tmp_path / "r", *options, *limits)
    assert done.exit_code in (0, 1)
    assert "cpcal: warning: " in done.stderr
    assert "positions are in metres, not mm" in done.stderr


def test_a_library_that_cannot_be_loaded_is_named(campaign, tmp_path):
    """llvmlite says so by an OSError without number; the folder of answers has nothing to do with it."""
    code = (
        "import cpcal.solver.compiled\n"
        "def missing(*_):\n"
        "    raise OSError(\"Could not find/load shared object file 'libllvmlite.so'\")\n"
        "cpcal.solver.compiled._made = missing\n"
        "from cpcal.__main__ import main; main()"
    )
    done = run(code, "certify", campaign, "-o", tmp_path / "run")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "shared object file 'libllvmlite.so'" in done.stderr
    assert "cannot be written" not in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_log_on_a_full_disk_costs_one_sentence(campaign, tmp_path):
    limits = ["--legs", "1", "--time-limit", "0.01", "--log", "/dev/full"]
    done = command("certify", campaign, "-o", tmp_path / "run", *limits)
    assert done.exit_code in (0, 1)
    assert done.stderr.count("the record ends here") == 1
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr


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
