"""`cpcal verify`: certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cpcal.checker import Refused, Unusable, check
from cpcal.cli.claims import sentences
from cpcal.errors import InputError, Problem, printable
from cpcal.files import load_campaign
from cpcal.numbers import nearest


def verify(
    target: Annotated[Path, typer.Argument(metavar="RUN|CERTIFICATE", help="A run, or one certificate in it.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the original campaign, to compare the run's with."),
    ] = None,
) -> None:
    """Check the certificates of a RUN, or one CERTIFICATE, against the campaign.json beside them.

    The checker forms every polynomial again from the campaign's numbers, or from the constraints that the certificate
    states, in exact rational arithmetic; it uses no solver and no rounding. docs/certificate-format.md says what a
    certificate claims and when it is accepted.
    """
    certificates = sorted(target.glob("*.cert.jsonl")) if target.is_dir() else [target]
    if not certificates or not all(path.is_file() for path in certificates):
        what = "holds no certificate (*.cert.jsonl)" if target.is_dir() else "is no file"
        raise InputError([Problem(str(target), what, "name the folder of a run, or a certificate in it")])
    digest = None if campaign is None else load_campaign(campaign).sha256
    accepted = [_verified(path, digest) for path in certificates]
    raise typer.Exit(0 if all(accepted) else 1)


def _verified(path: Path, digest: str | None) -> bool:
    began = time.monotonic()
    try:
        accepted = check(path)
    except Unusable as reason:
        raise InputError([Problem(str(path), str(reason), "name the folder of a run")]) from None
    except Refused as reason:
        typer.echo(printable(f"{path.name}: REFUSED, {reason}"))
        return False
    if digest not in (None, accepted.campaign):
        typer.echo(f"{path.name}: REFUSED, the campaign is another one: its SHA-256 differs")
        return False
    work = f"{accepted.steps} steps, {nearest(time.monotonic() - began, 1)} s"
    for sentence in sentences(accepted):
        typer.echo(printable(f"{path.name}: {sentence}: PROVED, {work}"))
    return True
