"""Many campaigns as one run: each is certified into a folder of its own, and a summary says which are worst."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from cpcal.certify.certify import answered, checked_options
from cpcal.certify.checkpoints import Checkpoints
from cpcal.certify.question import Question
from cpcal.cli.certified_run import status_of
from cpcal.cli.progress import bar
from cpcal.cli.status import Status
from cpcal.cli.talk import Talk, record
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.file_lock import scratch_folder
from cpcal.common.version import __version__
from cpcal.execution.executors import Here, Place, Processes
from cpcal.execution.outcomes import LostWorkerError, TaskOutcome, outcomes
from cpcal.execution.stopping import Reason, Stopped, asked
from cpcal.execution.threads import linear_algebra_on_one_thread
from cpcal.files import campaign_sha256, load_campaign
from cpcal.files.run_folder import RUN, answers_into, locked
from cpcal.legs import built_in
from cpcal.report import write_report
from cpcal.report.campaigns_page import CampaignRow, row_of, write_campaigns
from cpcal.results import Result, load_result, save_result
from cpcal.robot import Campaign


@dataclass(frozen=True)
class CampaignTask:
    """A campaign to be certified; a pure value. `run`: its folder, where the work can keep checkpoints in it."""

    name: str
    campaign: Campaign
    run: Path | None = None


@dataclass(frozen=True)
class CertifiedCampaign:
    """What was found, the files of its run, and what was kept meanwhile."""

    result: Result
    files: Mapping[str, bytes]
    kept: Checkpoints | None = None


@dataclass(frozen=True)
class CampaignWork:
    """What is asked of each campaign; with `resume` legs, and a search, go on from where a stopped run was."""

    given: Mapping[str, Any]
    checker: bool
    resume: bool = False

    def __call__(self, task: CampaignTask) -> CertifiedCampaign:
        """Raises InputError for a campaign that cannot be asked it, or whose folder another run writes into."""
        with nullcontext() if task.run is None else locked(task.run):
            return self._certified(task)

    def _certified(self, task: CampaignTask) -> CertifiedCampaign:
        campaign = task.campaign
        options, model = checked_options(campaign, **self.given)
        kept = None
        if task.run is not None:
            kept = Checkpoints.for_run(task.run, campaign, options, model, resume=self.resume)
            kept.begin()
        with linear_algebra_on_one_thread(), scratch_folder() as folder:
            question = Question(
                campaign=campaign, options=options, model=model, certificates=folder, checkpoints=kept, whole=True
            )
            result = answered(question)
            if result.interrupted and not result.legs:
                raise Stopped(asked() or Reason.INTERRUPTED)
            save_result(result, folder, campaign)
            write_report(campaign, result, folder, checker=self.checker)
            return CertifiedCampaign(result, {path.name: path.read_bytes() for path in sorted(folder.iterdir())}, kept)


def certified_all(folders: Sequence[Path], runs: Path, work: CampaignWork, place: Place, *, talk: Talk) -> Status:
    """Certify each campaign into a folder of `runs` that is called as its own; say which are worst; the exit status.

    One that cannot be used stops no other. Where the work resumes those that are answered already stay as they are.
    Raises InputError for two campaigns of one name, and while another run writes into `runs`.
    """
    names = _names(folders)
    with locked(runs):
        return _all_of(dict(zip(names, folders, strict=True)), runs, work, place, talk)


def _all_of(folders: Mapping[str, Path], runs: Path, work: CampaignWork, place: Place, talk: Talk) -> Status:
    rows: list[CampaignRow] = []
    failed: list[str] = []
    count = len(folders)
    near = isinstance(place[0], Here | Processes)  # else perhaps of another machine, without our folders

    def tasks() -> Iterator[CampaignTask]:
        for name, folder in folders.items():
            try:
                campaign = load_campaign(folder)
                earlier = _earlier(runs / name, campaign, work.given) if work.resume else None
            except InputError as error:
                _fail(failed, name, error)
                continue
            if earlier is None:
                yield CampaignTask(name, campaign, runs / name if near else None)
            else:
                rows.append(row_of(name, earlier))

    began = time.monotonic()
    with bar("campaigns", quiet=talk.quiet) as progress:
        executor, most = place
        for outcome in _while_reachable(outcomes(executor, most, work, tasks())):
            try:
                found = outcome.value
                put(runs / outcome.task.name, outcome.task.campaign, found)
                if found.kept is not None:
                    found.kept.end_after(found.result)
            except (CpcalError, OSError) as error:
                _fail(failed, outcome.task.name, error)
            else:
                rows.append(row_of(outcome.task.name, found.result))
                _record(rows[-1], len(rows) + len(failed), count, began)
            if progress is not None:
                progress(len(rows) + len(failed), count)
    return _ended(rows, failed, count, runs, talk)


def _while_reachable(
    found: Iterator[TaskOutcome[CampaignTask, CertifiedCampaign]],
) -> Iterator[TaskOutcome[CampaignTask, CertifiedCampaign]]:
    """Outcomes until nobody is there to work any more: those not begun stay so."""
    try:
        yield from found
    except LostWorkerError as error:
        record("lost", message=str(error))
        typer.echo(f"cpcal: {error}; what is done is kept, and --resume goes on with the others", err=True)


def _names(folders: Sequence[Path]) -> list[str]:
    """Of the runs. Raises InputError for two of one name."""
    names = [folder.resolve().name for folder in folders]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        remedy = "give their folders different names, or certify them into different folders"
        raise InputError([Problem(name, "is the name of two campaigns", remedy) for name in twice])
    return names


def _earlier(run: Path, campaign: Campaign, given: Mapping[str, Any]) -> Result | None:
    """What an earlier run has found, if it was asked the same of the same campaign by this version, and ended.

    Of a user-defined model nothing is kept: its equations may be others by now, and no result holds them.
    """
    options, model = checked_options(campaign, **given)
    if not built_in(model):
        return None
    try:
        found = load_result(run)
    except InputError:
        return None
    same = (found.options, found.version, found.campaign_sha256) == (options, __version__, campaign_sha256(campaign))
    return found if same and not found.interrupted else None


def put(run: Path, campaign: Campaign, found: CertifiedCampaign) -> None:
    """Write a run, all or nothing. Raises InputError where it cannot be written."""
    with answers_into(run, RUN, campaign) as draft:
        for name, content in found.files.items():
            (draft / name).write_bytes(content)


def _fail(failed: list[str], name: str, error: Exception) -> None:
    lines = error.problems if isinstance(error, InputError) else [error]
    what = "; ".join(map(str, lines[:3])) if lines else str(error)
    failed.append(f"{name}: {what}")
    record("failed", campaign=name, kind=type(error).__name__, message=str(error))
    typer.echo(printable(f"cpcal: {failed[-1]}"), err=True)


def _record(row: CampaignRow, done: int, count: int, began: float) -> None:
    spent = time.monotonic() - began
    rate = done / spent if spent > 0.0 else 0.0
    left = (count - done) / rate if rate > 0.0 else None
    bounds = {"eps_lo": row.worst.eps_lo, "eps_hi": row.worst.eps_hi, "leg": row.worst.leg}
    record("campaign", campaign=row.name, **bounds, seconds=row.seconds, done=done, of=count, rate=rate, left=left)


def _ended(rows: list[CampaignRow], failed: list[str], count: int, runs: Path, talk: Talk) -> Status:
    """Write the summary, print it, and the status of all."""
    reason = asked()
    missing = count - len(rows) - len(failed)
    interrupted = reason is not None and (missing > 0 or any(row.result.interrupted for row in rows))
    page = write_campaigns(rows, failed, missing, runs)
    if not talk.quiet:
        for line in page.lines:
            typer.echo(printable(line))
        typer.echo(printable(f"Summary: {page.path}"))
    if interrupted:
        return Status(reason or Reason.INTERRUPTED)
    if failed or missing:
        return Status.UNUSABLE
    return Status.ANSWERED if all(status_of(row.result) is Status.ANSWERED for row in rows) else Status.UNKNOWN
