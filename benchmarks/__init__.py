"""Measurements of speed, run by hand: `python -m benchmarks list` says what there is. Figures, never tests."""

import sys
from collections.abc import Callable, Iterable

import typer


def run_by_hand(*studies: Callable[..., None]) -> None:
    """Run the function that the command line names, or the only one there is; its parameters are the options."""
    explained = sys.modules["__main__"].__doc__
    app = typer.Typer(help=explained, add_completion=False, pretty_exceptions_enable=False)
    for study in studies:
        app.command(help=explained if len(studies) == 1 else None)(study)
    app()


def asked(names: Iterable[str] | None, known: Iterable[str]) -> list[str]:
    """The names, or all that are known where none are given. Ends with a message for one that is not."""
    if unknown := set(names or ()).difference(known):
        raise typer.BadParameter(f"there is no {', '.join(sorted(unknown))}; choose from {', '.join(known)}")
    return list(names or known)
