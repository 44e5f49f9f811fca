"""Certify, write the run, show it: what the verbs `certify` and `demo` share."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from cpcal.certify.certify import answered, checked_options
from cpcal.certify.checkpoints import Checkpoints
from cpcal.certify.leg_tasks import HERE
from cpcal.certify.question import Progress, Question
from cpcal.cli.progress import watch
from cpcal.cli.show import show_result
from cpcal.cli.status import Status
from cpcal.cli.talk import Talk, record
from cpcal.common.errors import InputError, printable
from cpcal.execution.executors import Place
from cpcal.execution.outcomes import LostWorkerError
from cpcal.execution.stopping import Reason, Stopped, asked, give_up
from cpcal.files.run_folder import REPORT_NAME, RUN, answers_into
from cpcal.report import write_report
from cpcal.results import Explained, LegResult, Result, result_text, save_result, verdict_of
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict
from cpcal.solver.optimize import Bracket


def certified_into(
    run: Path,
    campaign: Campaign,
    given: Mapping[str, Any],
    *,
    as_json: bool = False,
    talk: Talk | None = None,
    checker: bool = True,
    place: Place = HERE,
    resume: bool = False,
) -> Result:
    """Certify with the keyword arguments `given` of `cpcal.certify`; write the run, print the answer.

    `checker`: the page checks the certificates itself. `place`: where the work is done. `resume`: go on from the
    checkpoint of an earlier run. Stopped before any leg has an answer, it raises Stopped, and what was there before
    stays.
    What is printed is never lost to a disk that is full: the InputError comes afterwards.
    """
    talk = replace(talk or Talk(), quiet=True) if as_json else talk or Talk()
    options, model = checked_options(campaign, **given)
    record("certify", robot=campaign.robot.name, measurements=len(campaign), options=options)
    kept = Checkpoints.for_run(run, campaign, options, model, resume=resume)
    question = Question(campaign=campaign, options=options, model=model, checkpoints=kept, whole=True)
    result: Result | None = None
    failure: InputError | None = None
    try:
        with answers_into(run, RUN, campaign) as draft:
            kept.begin()
            try:
                result = _watched(question, draft, place, talk)
            except LostWorkerError as error:
                result = _kept_until(error, replace(question, certificates=draft))
            except MemoryError as error:
                what = (
                    f"{len(campaign)} measurements need more memory than there is ({str(error) or 'nothing is left'})"
                )
                raise MemoryError(
                    f"{what}; go on with --resume, which keeps what is answered, where there is more"
                ) from None
            _check_something(result)
            save_result(result, draft)
            write_report(campaign, result, draft, checker=checker)
    except InputError as error:
        if result is None:
            raise
        failure = error
    _record(result)
    if as_json:
        typer.echo(result_text(result), nl=False)
    elif not talk.quiet:
        show_result(talk.out, campaign, result, model, verbose=talk.verbose)
        if failure is None:
            talk.say(f"Report: {run / REPORT_NAME}")
    if failure is not None:
        if any(kept.folder.glob("*.answer")):
            said = f"cpcal: what is answered is kept in {kept.folder}: --resume writes it, once there is room"
            typer.echo(printable(said), err=True)
        raise failure
    kept.end_after(result)
    record("written", folder=str(run))
    return result


def _watched(question: Question, draft: Path, place: Place, talk: Talk) -> Result:
    """The answers, with ranges and what the report draws. Progress goes to stderr unless `talk` is quiet."""
    legs = list(question.options.legs or range(1, question.campaign.legs + 1))
    watching = nullcontext() if talk.quiet else watch(legs, question.options.gap, talk.errors)
    with watching as progress:
        return answered(replace(question, certificates=draft, progress=_recorded(progress)), place)


def _kept_until(lost: LostWorkerError, question: Question) -> Result:
    """What was answered before nobody was there to work any more; that stops this run. Raises what it is given, if that
    was nothing."""
    give_up(Reason.DESERTED)
    if question.checkpoints is None or asked() is None:
        raise lost
    result = answered(replace(question, checkpoints=replace(question.checkpoints, resume=True)))
    if not result.legs:
        raise lost
    typer.echo(printable(f"cpcal: {lost}"), err=True)
    return result


def _check_something(result: Result) -> None:
    """Raises Stopped for a run that was stopped before there was any answer."""
    if result.interrupted and not result.legs:
        raise Stopped(asked() or Reason.INTERRUPTED)


def _recorded(progress: Progress | None) -> Progress:
    """A callback that also keeps a record of every bracket."""

    def tell(leg: int, bracket: Bracket) -> None:
        done = {"nodes": bracket.nodes, "pending": bracket.pending, "rate": bracket.rate, "seconds": bracket.seconds}
        record("bracket", leg=leg, eps_lo=bracket.lo, eps_hi=bracket.hi, **done)
        if progress is not None:
            progress(leg, bracket)

    return tell


def _record(result: Result) -> None:
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        bounds = {"eps_lo": leg.eps_lo, "eps_hi": leg.eps_hi, "certified": leg.certified, "seconds": leg.seconds}
        record("leg", leg=leg.leg, verdict=verdict.kind, word=verdict.word, **bounds)


def status_of(result: Result) -> Status:
    """The exit status that tells of a result; what stopped it counts while that is heard."""
    if result.interrupted:
        return Status(asked() or Reason.INTERRUPTED)
    return Status.ANSWERED if all(_good(result, leg) for leg in result.legs) else Status.UNKNOWN


def _good(result: Result, leg: LegResult) -> bool:
    """With a tolerance: the leg passes; without: it has an answer."""
    if result.options.tolerance is None:
        return leg.verdict is not Verdict.UNKNOWN
    return isinstance(verdict_of(result, leg), Explained)
