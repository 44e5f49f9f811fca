"""No number is only stated: every change of a file that `cpcal verify` reads is refused, or it is information."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.genuine_runs import RUNS
from cpcal.checker import Accepted, check, check_run
from cpcal.cli import app, checked
from tests.every_key import FILES, accepted_changes, table

Verify = Callable[[], bool]


@pytest.fixture
def verified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Verify:
    """Whether `run` is accepted; no certificate is checked twice, and all is done in one process."""
    known: dict[tuple[bytes, ...], Accepted] = {}

    def once(path: Path, *given: object, **options: int) -> Accepted:
        of = path.with_name("campaign.json")
        key = path.read_bytes(), of.read_bytes() if of.exists() else b""
        if key not in known:
            known[key] = check(path, *given, **options)
        return known[key]

    for module in (check_run.__module__, "cpcal.checker.robust_claim", checked.__name__):
        monkeypatch.setattr(import_module(module), "check", once)
    monkeypatch.setattr(checked, "side_by_side", lambda checks: nullcontext(lambda: [one() for one in checks]))

    def accepted() -> bool:
        done = CliRunner().invoke(app, ["verify", str(tmp_path / "run")])
        assert done.exit_code in (0, 1, 2), done.output
        return bool(done.exit_code == 0)

    return accepted


@pytest.mark.parametrize("kind", [kind for kind in RUNS if kind not in ("pose sets", "solve", "campaigns")])
def test_every_change_outside_of_the_information_is_refused(kind: str, tmp_path: Path, verified: Verify) -> None:
    RUNS[kind](tmp_path)
    assert verified()
    (file,) = (tmp_path / "run" / name for name in FILES if (tmp_path / "run" / name).exists())
    assert list(accepted_changes(file, verified)) == []


def test_the_documentation_has_the_table_of_all_keys() -> None:
    """`python -m tests.every_key` prints it."""
    assert table() in Path("docs/trust.md").read_text(encoding="utf-8")
