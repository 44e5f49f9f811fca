"""`cpcal verify`: certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from enum import StrEnum
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import typer

from cpcal.checker.checker import check
from cpcal.checker.refusal import Refused
from cpcal.cli.checked import flint
from cpcal.cli.claims import sentences
from cpcal.cli.report import beside
from cpcal.errors import InputError, Problem, printable
from cpcal.numbers import nearest


class Numbers(StrEnum):
    FRACTIONS = "fractions"
    FLINT = "flint"


def verify(
    target: Annotated[Path, typer.Argument(metavar="RUN|CERTIFICATE", help="A run, or one certificate in it.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the campaign.", show_default="RUN/../campaign"),
    ] = None,
    numbers: Annotated[
        Numbers, typer.Option(help="Exact numbers: Python's own, or FLINT's, with the same verdicts in less time.")
    ] = Numbers.FRACTIONS,
) -> None:
    """Check the certificates of a RUN, or one CERTIFICATE, against the CAMPAIGN that they speak of.

    The checker forms every polynomial again from the campaign's numbers, or from the constraints that the certificate
    states, in exact rational arithmetic; it uses no solver and no rounding. docs/certificate-format.md says what a
    certificate claims and when it is accepted.
    """
    certificates = sorted(target.glob("*.cert.jsonl")) if target.is_dir() else [target]
    if not certificates or not all(path.is_file() for path in certificates):
        what = "holds no certificate (*.cert.jsonl)" if target.is_dir() else "is no file"
        raise InputError([Problem(str(target), what, "name the folder of a run, or a certificate in it")])
    folder = _beside(certificates[0].parent) if campaign is None else campaign
    accepted = [_verified(path, folder, numbers) for path in certificates]
    raise typer.Exit(0 if all(accepted) else 1)


def _beside(run: Path) -> Path | None:
    """The campaign of a run, where there is one: constraints of one's own have none."""
    try:
        return beside(run)
    except InputError:
        return None


def _verified(path: Path, campaign: Path | None, numbers: Numbers) -> bool:
    began = time.monotonic()
    try:
        accepted = check(path, campaign, rational=Fraction if numbers is Numbers.FRACTIONS else flint())
    except Refused as reason:
        typer.echo(printable(f"{path.name}: REFUSED, {reason}"))
        return False
    work = f"{accepted.steps} steps, {nearest(time.monotonic() - began, 1)} s"
    for sentence in sentences(accepted):
        typer.echo(printable(f"{path.name}: {sentence}: PROVED, {work}"))
    return True
