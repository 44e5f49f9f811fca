"""The command, in this process."""

from typing import Any

from typer.testing import CliRunner

from cpcal.cli import app


def run(*words: object) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words], prog_name="cpcal")


def done(*words: object, status: int = 0) -> str:
    """What is said by a command that ends with this status."""
    outcome = run(*words)
    assert outcome.exit_code == status, outcome.output
    return str(outcome.output)


def refused(*words: object) -> str:
    """What is said on stderr by a command that cannot use what it is given, in one line; it prints nothing."""
    outcome = run(*words)
    assert (outcome.exit_code, outcome.stdout) == (2, ""), outcome.output
    return " ".join(outcome.stderr.split())
