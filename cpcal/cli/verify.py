"""`cpcal verify`: certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.report import beside
from cpcal.errors import InputError, Problem
from cpcal.interval import Interval
from cpcal.proof.checker import Accepted, check
from cpcal.proof.refusal import Refused

VERIFY_STATUS_HELP = "Exit status: **0** every certificate proved, **1** one refused, **2** unusable input."


def verify(
    target: Annotated[Path, typer.Argument(metavar="RUN|CERTIFICATE", help="A run, or one certificate in it.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the campaign.", show_default="RUN/../campaign"),
    ] = None,
) -> None:
    """Check the certificates of a RUN, or one CERTIFICATE, against the CAMPAIGN that they speak of.

    The checker forms every polynomial again from the campaign's numbers in exact rational arithmetic; it uses
    no solver and no rounding. docs/certificate-format.md says what a certificate claims and when it is accepted.
    """
    certificates = sorted(target.glob("*.cert.jsonl")) if target.is_dir() else [target]
    if not certificates or not all(path.is_file() for path in certificates):
        what = "holds no certificate (*.cert.jsonl)" if target.is_dir() else "is no file"
        raise InputError([Problem(str(target), what, "name the folder of a run, or a certificate in it")])
    folder = beside(certificates[0].parent) if campaign is None else campaign
    refused = False
    for path in certificates:
        began = time.monotonic()
        try:
            typer.echo(f"{path.name}: {_words(check(path, folder))} PROVED, {time.monotonic() - began:.1f} s")
        except Refused as reason:
            refused = True
            typer.echo(f"{path.name}: REFUSED, {reason}")
    raise typer.Exit(1 if refused else 0)


def _words(accepted: Accepted) -> str:
    """The claims in a sentence, every number rounded to the side that stays proved."""
    place = f"Leg {accepted.leg}, {accepted.measurements} measurements: no x in the box"
    low = Interval(accepted.eps_lo, accepted.eps_lo if accepted.eps_hi is None else accepted.eps_hi)
    digits = [part.strip("[]") for part in f"{low:.9f}".split(", ")]
    text = f"{place} satisfies all equations with |g| < {digits[0]} mm for any readings in their sets"
    if accepted.eps_hi is not None:
        text += f"; one does with |g| <= {digits[1]} mm for some readings"
    return f"{text}. {accepted.steps} steps:"
