"""The command, in this process."""

from __future__ import annotations

from typing import Any

from typer.testing import CliRunner

from cpcal.cli import app


def run(*words: object) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words], prog_name="cpcal")
