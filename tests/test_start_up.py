"""What an import loads, and which thing a name is when a function and a package share it. In fresh interpreters."""

import subprocess
import sys
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType

import pytest

import cpcal

HEAVY = {"flint", "jinja2", "matplotlib", "numpy", "scipy"}
LAZY = ["", ".calibration", ".files", ".models", ".questions", ".report", ".robot", ".simulate"]


def interpreted(code, *, status=0):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    return done.stdout


def test_importing_a_package_loads_nothing_heavy():
    """One after the other in one interpreter: what all of them have not loaded, none has."""
    code = f"""
import sys
from importlib import import_module
for package in {LAZY}:
    import_module("cpcal" + package)
    print("cpcal" + package, *sys.modules)
"""
    found = [line.split() for line in interpreted(code).splitlines()]
    assert {package: HEAVY & set(loaded) for package, *loaded in found} == {f"cpcal{name}": set() for name in LAZY}


def loaded_by(arguments, *, status=0):
    """What the command has loaded when it ends."""
    code = f"""
import atexit, sys
from cpcal.__main__ import main
atexit.register(lambda: print("loaded:", *sys.modules))
sys.argv = ["cpcal", *{arguments}]
main()
"""
    return set(interpreted(code, status=status).split("loaded:")[-1].split())


def test_the_version_help_and_a_mistyped_verb_load_no_verb():
    for arguments, status in ((["--version"], 0), (["--help"], 0), (["certfy"], 2)):
        loaded = loaded_by(arguments, status=status)
        assert HEAVY.isdisjoint(loaded)
        assert "cpcal.cli.app" in loaded
        assert "cpcal.cli.certify" not in loaded


def test_verbs_load_what_they_need_and_pages_no_plotting_library():
    """One after the other in one interpreter."""
    code = """
import sys, cpcal.cli.verify
print(*sys.modules)
import cpcal.cli.solve, cpcal.cli.campaign
print(*sys.modules)
import cpcal.cli.certify, cpcal.report.run_page, cpcal.report.study_page
print(*sys.modules)
"""
    verify, solve, pages = (set(line.split()) for line in interpreted(code).splitlines())
    assert HEAVY.isdisjoint(verify)
    assert {"matplotlib", "jinja2", "cv2"}.isdisjoint(solve)
    assert "matplotlib" not in pages


def test_verify_loads_no_solver_and_begins_without_arrays(tmp_path):
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=8, factor=0)
    cpcal.save_result(cpcal.certify(campaign, legs=[1], delta=1.0, certificates=tmp_path), tmp_path)
    loaded = loaded_by(["verify", "-q", str(tmp_path)])
    assert {"numba", "scipy", "flint", "cv2", "matplotlib", "jinja2"}.isdisjoint(loaded)
    assert {"cpcal.checker.lens", "cpcal.checker.sight"}.isdisjoint(loaded)


@pytest.mark.parametrize(
    "imports",
    [
        "import cpcal.simulate",
        "import cpcal; cpcal.simulate; import cpcal.simulate",
        "import importlib; importlib.import_module('cpcal.simulate.campaigns')",
    ],
)
def test_a_function_keeps_its_name_whatever_is_imported_before(imports):
    lines = ["import sys", imports, "import cpcal", "print(type(cpcal.simulate).__name__)"]
    lines += ["from cpcal.simulate import simulate as same", "print(same is cpcal.simulate)"]
    assert interpreted("\n".join(lines)).split() == ["function", "True"]


def test_no_public_name_is_hidden_by_a_file_of_the_same_name():
    for found in walk_packages(cpcal.__path__, "cpcal."):
        if "__main__" not in found.name:
            import_module(found.name)
    for package in map(import_module, (f"cpcal{name}" for name in LAZY)):
        assert not [name for name in package.__all__ if isinstance(getattr(package, name), ModuleType)]


def test_every_public_name_is_listed_and_there():
    assert "certify" in dir(cpcal)
    assert all(getattr(cpcal, name) is not None for name in cpcal.__all__)
    with pytest.raises(AttributeError, match="certfy"):
        getattr(cpcal, "certfy")  # noqa: B009, the name as a checker of types would refuse it
