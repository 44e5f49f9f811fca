"""Certify, write the run, show it: what the verbs `certify` and `demo` share."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import typer

from cpcal.certify import certify
from cpcal.certify.projections import with_projections
from cpcal.cli.folders import unwritable
from cpcal.cli.progress import watch
from cpcal.cli.show import show_result, terminal
from cpcal.cli.status import Status
from cpcal.report import REPORT_NAME, write_report
from cpcal.results import Result, save_result
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict


@dataclass(frozen=True)
class Question:
    """The options of `cpcal.certify`, with its meanings and defaults."""

    legs: Sequence[int] | None = None
    delta: float = 100.0
    center: str = "fit"
    gap: float = 1e-6
    time_limit: float | None = None
    contractors: Sequence[str] = ("lifted",)
    arithmetic: str = "float64"
    eps: float | None = None
    support: str = "few"
    method: str = "bound"
    model: str | None = None


def answer(campaign: Campaign, question: Question, run: Path, *, quiet: bool) -> Result:
    """Certify, with certificates in the folder `run`, and add what the report draws.

    Progress goes to stderr unless `quiet` or no terminal is there.
    """
    legs = list(question.legs or range(1, campaign.legs + 1))
    watching = nullcontext() if quiet else watch(legs, question.gap, terminal(stderr=True))
    with watching as progress:
        result = certify(
            campaign,
            legs=question.legs,
            delta=question.delta,
            center=question.center,
            gap=question.gap,
            time_limit=question.time_limit,
            contractors=question.contractors,
            arithmetic=question.arithmetic,
            eps=question.eps,
            support=question.support,
            method=question.method,
            certificates=run,
            progress=progress,
            model=question.model,
        )
    return with_projections(campaign, result)


def publish(campaign: Campaign, result: Result, run: Path, *, as_json: bool) -> None:
    """Write `result.json` and the page into the folder `run`, print the answer. What is printed is never lost
    to a disk that is full: the InputError comes afterwards."""
    failure: OSError | None = None
    try:
        _write(campaign, result, run)
    except OSError as error:
        failure = error
    if as_json:
        typer.echo(json.dumps(result.to_json(), indent=1, allow_nan=False))
    else:
        console = terminal()
        show_result(console, result, campaign.legs)
        if failure is None:
            console.print(f"Report: {run / REPORT_NAME}", soft_wrap=True)
    if failure is not None:
        raise unwritable(run, failure)


def _write(campaign: Campaign, result: Result, run: Path) -> None:
    """The page of an earlier run goes first: no page ever stands beside a result that is not its own."""
    (run / REPORT_NAME).unlink(missing_ok=True)
    save_result(result, run)
    write_report(campaign, result, run)


def status_of(result: Result) -> Status:
    """The exit status that tells of a result."""
    if result.interrupted:
        return Status.INTERRUPTED
    unknown = any(leg.verdict is Verdict.UNKNOWN for leg in result.legs)
    return Status.UNKNOWN if unknown else Status.ANSWERED
