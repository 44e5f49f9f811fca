"""Entry points: one name, one package; what does not load says why."""

import os
import subprocess
import sys
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.common.errors import PluginError
from cpcal.solver import plugins
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box

ROOT = str(Path(cpcal.__file__).parents[1])


class Package:
    """A distribution with a name."""

    def __init__(self, name: str) -> None:
        self.name, self.version = name, "1.0"


def registered(monkeypatch: pytest.MonkeyPatch, *points: tuple[str, str, str]) -> None:
    """Only these (name, value, package) are found."""
    found = [EntryPoint(name, value, plugins.GROUP) for name, value, _ in points]
    for point, (_, _, package) in zip(found, points, strict=True):
        vars(point).update(dist=Package(package))
    monkeypatch.setattr(plugins, "entry_points", lambda group: found)


def test_two_packages_that_register_one_name_are_both_named(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = ("hc4", "contractors.hc4:HC4", "cpcal")
    registered(
        monkeypatch, ours, ("hc4", "theirs.fast:HC4", "fast-hc4"), ("lifted", "contractors.lifted:Lifted", "cpcal")
    )
    with pytest.raises(PluginError, match=r"two packages .*'hc4'.*cpcal \(contractors.hc4:HC4\) and fast-hc4 \(theirs"):
        plugins.load("hc4")
    assert plugins.load("lifted").__name__ == "Lifted"


def test_the_list_of_plugins_leaves_with_status_2_where_two_packages_register_one_name(monkeypatch):
    registered(monkeypatch, ("hc4", "contractors.hc4:HC4", "cpcal"), ("hc4", "theirs.fast:HC4", "fast-hc4"))
    done = CliRunner().invoke(app, ["plugins"])
    assert done.exit_code == 2
    assert "cpcal: two packages register a contractor 'hc4': cpcal (contractors.hc4:HC4) and fast-hc4" in done.stderr


STRANGER = """
import pickle, sys
import cpcal
from cpcal.solver import plugins
{before}
net = cpcal.Network()
x = net.variable("x", domain=(0, 9))
net.add(x * x <= 4)
print("contracted to", net.contract(contractors=["hc4", "lifted"]).box["x"].hi < 3)
import contractors
print("theirs is", contractors.mine)
assert pickle.loads(pickle.dumps(plugins.load("hc4"))) is plugins.load("hc4")
"""


@pytest.mark.parametrize(
    ("stranger", "before"), [("contractors.py", "import contractors"), ("contractors/__init__.py", "")]
)
def test_a_module_of_the_same_name_is_neither_hidden_nor_run_for_ours(tmp_path, stranger, before):
    (tmp_path / stranger).parent.mkdir(exist_ok=True)
    (tmp_path / stranger).write_text("print('theirs runs')\nmine = 7\n")
    code = [sys.executable, "-c", STRANGER.format(before=before)]
    done = subprocess.run(code, cwd=tmp_path, env={**os.environ, "PYTHONPATH": ROOT}, capture_output=True, text=True)
    expected = ["contracted to True", "theirs is 7"]
    expected.insert(0 if before else 1, "theirs runs")
    assert done.stdout.splitlines() == expected, done.stderr


def test_a_class_and_what_returns_no_contraction_are_refused() -> None:
    class Nothing:
        def __init__(self, found: object) -> None:
            self.found = found

        def contract(self, box: Box, deadline: float = 0.0) -> Any:
            return self.found

    net = cpcal.Network()
    x = net.variable("x", domain=(0, 9))
    net.add(x * x <= 4)
    for verb in (net.contract, net.solve, partial(net.minimize, x)):
        with pytest.raises(PluginError, match="Nothing is a class: give its name, or an object"):
            verb(contractors=[Nothing])
        for found in (None, Contraction(None), Contraction(Box.from_dict({"y": (0, 1)}))):  # type: ignore[arg-type]
            with pytest.raises(
                PluginError, match=r"of the contractor Nothing returned .*: it returns a Contraction whose"
            ):
                verb(contractors=[Nothing(found)])
