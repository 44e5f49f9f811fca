"""Entry points: one name, one package; what does not load says why."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cpcal.cli import app
from cpcal.common.errors import PluginError
from cpcal.solver import plugins


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
    assert plugins.load("lifted").__name__ == "Lifted"  # type: ignore[attr-defined]


def test_the_list_of_plugins_leaves_with_status_2_where_two_packages_register_one_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    registered(monkeypatch, ("hc4", "contractors.hc4:HC4", "cpcal"), ("hc4", "theirs.fast:HC4", "fast-hc4"))
    done = CliRunner().invoke(app, ["plugins"])
    assert done.exit_code == 2
    assert "cpcal: two packages register a contractor 'hc4': cpcal (contractors.hc4:HC4) and fast-hc4" in done.stderr


def test_a_foreign_folder_on_the_path_is_said_to_be_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "contractors").mkdir()
    (tmp_path / "contractors" / "__init__.py").write_text("")
    registered(monkeypatch, ("hc4", "contractors.hc4:HC4", "cpcal"))
    monkeypatch.syspath_prepend(tmp_path)
    saved: dict[str, Any] = {k: sys.modules.pop(k) for k in list(sys.modules) if k.split(".")[0] == "contractors"}
    try:
        with pytest.raises(PluginError, match="not the one of cpcal") as error:
            plugins.load("hc4")
    finally:
        for name in [k for k in sys.modules if k.split(".")[0] == "contractors"]:
            del sys.modules[name]
        sys.modules.update(saved)
    assert str(tmp_path / "contractors") in str(error.value)


def test_a_plugin_that_breaks_tells_its_own_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_plugin").mkdir()
    (tmp_path / "broken_plugin" / "__init__.py").write_text("")
    (tmp_path / "broken_plugin" / "one.py").write_text("import a_module_that_is_not_there\n")
    registered(monkeypatch, ("one", "broken_plugin.one:One", "theirs"))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(PluginError, match="a_module_that_is_not_there") as error:
        plugins.load("one")
    assert "not the one of" not in str(error.value)
