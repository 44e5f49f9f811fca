"""The package of docs/extending.md is built, installed without a network, and its parts run by their names."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

PACKAGE = Path(__file__).parents[2] / "docs" / "examples" / "package"
USED = """
import cpcal
from cpcal.solver.testing import check_contractor
from cpcal_halfway import logsumexp
from cpcal_halfway.contractor import bisected

net = cpcal.Network()
x = net.variable("x", 2, (0, 4))
net.add([x[0] * x[1] == 4, logsumexp(x[0], x[1]) == 3])
paving = net.solve(contractors=["bisected", "newton"], strategy="first", width=1e-3)
print(len(paving.solutions), paving.status)
check_contractor(bisected)
"""


def test_a_package_of_ones_own_is_built_installed_and_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel is unpacked to install it."""
    backend = pytest.importorskip("hatchling.build")
    shutil.copytree(PACKAGE, tmp_path / "source", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.chdir(tmp_path / "source")
    wheel = backend.build_wheel(str(tmp_path))
    installed = tmp_path / "installed"
    ZipFile(tmp_path / wheel).extractall(installed)
    path = os.pathsep.join([str(installed), str(Path(__file__).parents[2])])
    run = subprocess.run(
        [sys.executable, "-c", USED], env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True,
        timeout=600,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("2 2 boxes hold exactly one solution each")
