"""Certify, write the run, show it: what the verbs `certify` and `demo` share."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from cpcal.certify.certify import answered, checked_options
from cpcal.certify.projections import with_projections
from cpcal.certify.question import Question
from cpcal.certify.ranges import with_ranges
from cpcal.cli.progress import watch
from cpcal.cli.show import show_result, terminal
from cpcal.cli.status import Status
from cpcal.common.errors import InputError
from cpcal.files.run_folder import RUN, answers_into
from cpcal.report import REPORT_NAME, write_report
from cpcal.results import Explained, Result, result_text, save_result, verdict_of
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict


def certified_into(run: Path, campaign: Campaign, given: Mapping[str, Any], *, as_json: bool) -> Result:
    """Certify with the keyword arguments `given` of `cpcal.certify`; write the run, print the answer.

    What is printed is never lost to a disk that is full: the InputError comes afterwards.
    """
    options, model = checked_options(campaign, **given)
    question = Question(campaign=campaign, options=options, model=model)
    result: Result | None = None
    failure: InputError | None = None
    try:
        with answers_into(run, RUN, campaign) as draft:
            result = _watched(question, draft, quiet=as_json)
            save_result(result, draft)
            write_report(campaign, result, draft)
    except InputError as error:
        if result is None:
            raise
        failure = error
    if as_json:
        typer.echo(result_text(result), nl=False)
    else:
        console = terminal()
        show_result(console, result, campaign.legs)
        if failure is None:
            console.print(f"Report: {run / REPORT_NAME}", soft_wrap=True)
    if failure is not None:
        raise failure
    return result


def _watched(question: Question, draft: Path, *, quiet: bool) -> Result:
    """The answers, with what the report draws. Progress goes to stderr unless `quiet` or no terminal is there."""
    legs = list(question.options.legs or range(1, question.campaign.legs + 1))
    watching = nullcontext() if quiet else watch(legs, question.options.gap, terminal(stderr=True))
    with watching as progress:
        result = answered(replace(question, certificates=draft, progress=progress))
        result = with_ranges(question.campaign, result, certificates=draft, model=question.model)
    return with_projections(question.campaign, result, question.model)


def status_of(result: Result) -> Status:
    """The exit status that tells of a result."""
    if result.interrupted:
        return Status.INTERRUPTED
    if result.options.tolerance is None:
        good = all(leg.verdict is not Verdict.UNKNOWN for leg in result.legs)
    else:
        good = all(isinstance(verdict_of(result, leg), Explained) for leg in result.legs)
    return Status.ANSWERED if good else Status.UNKNOWN
