"""`cpcal certify`: brackets of legs, of one campaign or many, in several models, or with wrong measurements."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.text import Text

from cpcal.cli.options import (
    Legs,
    Status,
    Talk,
    TimeLimit,
    Where,
    answer,
    check_target,
    check_writable,
    expert,
    numbers_of,
    output,
    record,
)
from cpcal.cli.progress import Counted, counted, line
from cpcal.cli.progress import Legs as LegsProgress
from cpcal.cli.sections import STYLES, show, show_table
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.files import scratch_folder
from cpcal.common.numbers import stated
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256, load_campaign
from cpcal.files.run_folder import REPORT_NAME, RUN, answers_into, locked
from cpcal.models import LegModel, built_in
from cpcal.questions import (
    Result,
    load_result,
    result_text,
    save_result,
    verdict_of,
)
from cpcal.questions.ask import HERE, answered, comparison
from cpcal.questions.question import Checkpoints, Question, question_of
from cpcal.report import (
    FRAME,
    LONGER,
    QUANTIFIER,
    bounds_table,
    center_sentence,
    leg_sentence,
    notices,
    outliers_section,
    parameters_section,
    write_report,
)
from cpcal.report.comparison_page import (
    CampaignRow,
    comparison_lines,
    comparison_sentences,
    comparison_table,
    passing,
    row_of,
    write_campaigns,
    write_comparison,
)
from cpcal.report.words import SHORT_QUANTIFIER, advise, fitted, overall, short_fit, uncertified_legs
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.executors import Here, Place, Processes
from cpcal.solver.execution.outcomes import LostWorkerError, TaskOutcome, outcomes
from cpcal.solver.execution.stopping import Reason, Stopped, asked, give_up
from cpcal.solver.execution.threads import linear_algebra_on_one_thread
from cpcal.solver.optimize.minimum import Bracket


def warn(campaign: Campaign) -> Campaign:
    """The campaign; what looks mixed up is said on stderr before the work begins."""
    for sentence in suspicions(campaign):
        typer.echo(printable(f"cpcal: warning: {sentence}"), err=True)
    return campaign


# ------------------------------------------------------------------------------------------------------------------
# What is printed at the end: a line a leg; with --verbose every table, and the sentences in full.

_MOST_LEGS = 6  # of which each has a line


def show_result(talk: Talk, campaign: Campaign, result: Result, model: LegModel) -> None:
    """The answer in ten lines at most, or all of it."""
    title = Text(f"{printable(result.campaign.robot)}: {result.campaign.measurements:,} measurements", style="bold")
    if (whole := overall(result)) is not None:
        title.append(f"; tolerance {stated(result.options.tolerance or 0.0)} mm: ")
        title.append(whole.word, style=STYLES[whole.kind])
    talk.say(title)
    if result.options.outliers:
        show(talk, outliers_section(result))
    elif talk.verbose:
        _everything(talk, campaign, result, model)
    else:
        for leg in result.legs[:_MOST_LEGS]:
            found = advise(campaign, result, leg, model, fitted(campaign, result, leg, model))
            verdict = verdict_of(result, leg)
            text = Text(f"Leg {leg.leg}: ").append(short_fit(verdict), style=STYLES[verdict.kind])
            if found.first:
                text.append(f"; look at {', '.join(str(k + 1) for k in found.first)}")
            talk.say(text.append(f"; next: {found.short}"))
        if (more := len(result.legs) - _MOST_LEGS) > 0:
            talk.say(f"and {more} more legs, which the report shows")
        talk.say(SHORT_QUANTIFIER, style="italic")
    for missing in filter(None, (notices(result, campaign.legs), uncertified_legs(result))):
        talk.say(missing, style="bold yellow")


def _everything(talk: Talk, campaign: Campaign, result: Result, model: LegModel) -> None:
    show_table(talk, bounds_table(result))
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        sentences = f"{leg_sentence(result, leg)} {center_sentence(result, leg) or ''}".strip()
        text = Text(f"Leg {leg.leg}: ").append(verdict.word, style=STYLES[verdict.kind])
        talk.say(text.append(f". {printable(sentences)}"))
        if leg.ranges is not None:
            show(talk, parameters_section(campaign, result, leg, fitted(campaign, result, leg, model)))
    talk.say(FRAME)
    talk.say(f"{QUANTIFIER} {LONGER}", style="italic")


# ------------------------------------------------------------------------------------------------------------------
# Certify, write the run, show it: what the verbs `certify` and `demo` share.


def _record(result: Result) -> None:
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        bounds = {
            "eps_lo": leg.bracket.lo,
            "eps_hi": leg.bracket.hi,
            "certified": leg.certified,
            "seconds": leg.work.seconds,
        }
        record("leg", leg=leg.leg, verdict=verdict.kind, word=verdict.word, **bounds)


def certified_into(
    run: Path,
    question: Question,
    *,
    talk: Talk,
    as_json: bool = False,
    checker: bool = True,
    place: Place = HERE,
    resume: bool = False,
) -> Result:
    """Answer a question, write the run, print the answer.

    `checker`: the page checks the certificates itself. `place`: where the work is done. `resume`: go on from the
    checkpoint of an earlier run. Stopped before any leg has an answer, it raises Stopped, and what was there before
    stays.
    """
    campaign = question.campaign
    record("certify", robot=campaign.robot.name, measurements=len(campaign), options=question.options)
    kept = Checkpoints.for_run(run, question, resume=resume)

    def find(draft: Path) -> Result:
        kept.begin()
        here = replace(question, certificates=draft, checkpoints=kept)
        try:
            with line(talk.errors) as shown:
                result = answered(replace(here, progress=_recorded(LegsProgress(shown))), place)
        except LostWorkerError as error:
            result = _kept_until(error, here)
        except MemoryError as error:
            what = f"{len(campaign)} measurements need more memory than there is ({str(error) or 'nothing is left'})"
            remedy = "go on with --resume, which keeps what is answered, where there is more"
            raise MemoryError(f"{what}; {remedy}") from None
        return _something(result)

    def show(result: Result, failure: InputError | None) -> None:
        _record(result)
        if as_json:
            typer.echo(result_text(result), nl=False)
        elif not talk.quiet:
            show_result(talk, campaign, result, question.model)
            if failure is None:
                talk.say(f"Report: {run / REPORT_NAME}")
        if failure is not None and any(kept.folder.glob("*.answer")):
            note = f"cpcal: what is answered is kept in {kept.folder}: --resume writes it, once there is room"
            typer.echo(printable(note), err=True)

    def write(result: Result, draft: Path) -> None:
        save_result(result, draft)
        write_report(campaign, result, draft, checker=checker)

    result = answer(run, RUN, find, write, show, campaign)
    kept.end_after(result)
    record("written", folder=str(run))
    return result


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


def _something(result: Result) -> Result:
    """Raises Stopped for a run that was stopped before there was any answer."""
    if result.interrupted and not result.legs:
        raise Stopped(asked() or Reason.INTERRUPTED)
    return result


def _recorded(progress: LegsProgress) -> Any:
    """A callback that also keeps a record of every bracket."""

    def tell(leg: int, bracket: Bracket) -> None:
        done = {"nodes": bracket.nodes, "pending": bracket.pending, "rate": bracket.rate, "seconds": bracket.seconds}
        record("bracket", leg=leg, eps_lo=bracket.lo, eps_hi=bracket.hi, **done)
        progress(leg, bracket)

    return tell


def status_of(result: Result) -> Status:
    """The exit status that tells of a result; what stopped it counts while that is heard.

    With a tolerance each leg has to pass; without one, to have an answer.
    """
    if result.interrupted:
        return Status(asked() or Reason.INTERRUPTED)
    if result.options.tolerance is None:
        good = all(leg.bracket.verdict is not Verdict.UNKNOWN for leg in result.legs)
    else:
        good = all(verdict_of(result, leg).passes for leg in result.legs)
    return Status.ANSWERED if good else Status.UNKNOWN


# ------------------------------------------------------------------------------------------------------------------
# Many campaigns as one run: each is certified into a folder of its own, and a summary says which are worst.


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
        campaign = task.campaign
        with nullcontext() if task.run is None else locked(task.run):
            question, kept = question_of(campaign, **self.given), None
            if task.run is not None:
                kept = Checkpoints.for_run(task.run, question, resume=self.resume)
                kept.begin()
            with linear_algebra_on_one_thread(), scratch_folder() as folder:
                asked_here = replace(question, certificates=folder, checkpoints=kept)
                result = _something(answered(asked_here))
                save_result(result, folder, campaign)
                write_report(campaign, result, folder, checker=self.checker)
                files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
                return CertifiedCampaign(result, files, kept)


def certified_all(folders: Sequence[Path], runs: Path, work: CampaignWork, place: Place, *, talk: Talk) -> Status:
    """Certify each campaign into a folder of `runs` that is called as its own; say which are worst; the exit status.

    One that cannot be used stops no other. Where the work resumes those that are answered already stay as they are.
    Raises InputError for two campaigns of one name, and while another run writes into `runs`.
    """
    names = [folder.resolve().name for folder in folders]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        remedy = "give their folders different names, or certify them into different folders"
        raise InputError([Problem(name, "is the name of two campaigns", remedy) for name in twice])
    with locked(runs), counted("campaigns", talk.errors) as progress:
        rows, failed = _rows_of_all(dict(zip(names, folders, strict=True)), runs, work, place, progress)
        return _ended(rows, failed, len(names), runs, talk)


def _rows_of_all(
    folders: Mapping[str, Path], runs: Path, work: CampaignWork, place: Place, progress: Counted
) -> tuple[list[CampaignRow], list[str]]:
    rows: list[CampaignRow] = []
    failed: list[str] = []
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
    executor, most = place
    for outcome in _while_reachable(outcomes(executor, most, work, tasks())):
        name = outcome.task.name
        try:
            found = outcome.value
            put(runs / name, outcome.task.campaign, found)
            if found.kept is not None:
                found.kept.end_after(found.result)
        except (CpcalError, OSError) as error:
            _fail(failed, name, error)
        else:
            rows.append(row_of(name, found.result))
            worst, done, spent = rows[-1].worst, len(rows) + len(failed), time.monotonic() - began
            rate = done / spent if spent > 0.0 else 0.0
            pace = {
                "done": done,
                "of": len(folders),
                "rate": rate,
                "left": (len(folders) - done) / rate if rate else None,
            }
            bounds = {"eps_lo": worst.bracket.lo, "eps_hi": worst.bracket.hi, "leg": worst.leg}
            record("campaign", campaign=name, **bounds, seconds=rows[-1].seconds, **pace)
        progress(len(rows) + len(failed), len(folders))
    return rows, failed


def _while_reachable(
    found: Iterator[TaskOutcome[CampaignTask, CertifiedCampaign]],
) -> Iterator[TaskOutcome[CampaignTask, CertifiedCampaign]]:
    """Outcomes until nobody is there to work any more: those not begun stay so."""
    try:
        yield from found
    except LostWorkerError as error:
        record("lost", message=str(error))
        typer.echo(f"cpcal: {error}; what is done is kept, and --resume goes on with the others", err=True)


def _earlier(run: Path, campaign: Campaign, given: Mapping[str, Any]) -> Result | None:
    """What an earlier run has found, if it was asked the same of the same campaign by this version, and ended.

    Of a user-defined model nothing is kept: its equations may be others by now, and no result holds them.
    """
    question = question_of(campaign, **given)
    if not built_in(question.model):
        return None
    try:
        found = load_result(run)
    except InputError:
        return None
    known = (found.options, found.version, found.campaign.sha256)
    same = known == (question.options, __version__, campaign_sha256(campaign))
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


def _ended(rows: list[CampaignRow], failed: list[str], count: int, runs: Path, talk: Talk) -> Status:
    """Write the summary, print it, and the status of all."""
    reason = asked()
    missing = count - len(rows) - len(failed)
    page = write_campaigns(rows, failed, missing, runs)
    talk.say(*page.lines, f"Summary: {page.path}")
    if reason is not None and (missing > 0 or any(row.result.interrupted for row in rows)):
        return Status(reason)
    if failed or missing:
        return Status.UNUSABLE
    return Status.ANSWERED if all(status_of(row.result) is Status.ANSWERED for row in rows) else Status.UNKNOWN


# ------------------------------------------------------------------------------------------------------------------
# The verb.


@dataclass(frozen=True)
class CertifyFlags:
    """The options of `cpcal.certify` and `compare`."""

    tolerance: Annotated[
        float | None, typer.Option(metavar="MM", help="The error that the legs may have: each passes or fails.")
    ] = None
    outliers: Annotated[
        int,
        typer.Option(metavar="Q", min=0, help="Measurements of a leg that may be wrong, at most, nobody knows which."),
    ] = 0
    model: Annotated[
        str | None,
        typer.Option(
            metavar="A,B", help="Leg model, such as plain or gain; several are compared.", show_default="the campaign's"
        ),
    ] = None
    legs: Legs = None
    time_limit: TimeLimit = None
    eps: Annotated[float | None, expert(metavar="MM", help="Ask instead whether any parameters reach this eps.")] = None
    delta: Annotated[float, expert(metavar="MM", help="Half-width of the box of parameters.")] = 100.0
    center: Annotated[
        Literal["fit", "plain", "nominal"], expert(help="Middle of that box: a least-squares fit, or nominal.")
    ] = "fit"
    gap: Annotated[float, expert(help="Relative width at which the bracket counts as closed.")] = 1e-6
    node_limit: Annotated[int | None, expert(metavar="N", min=1, help="Boxes a leg, at most.")] = None
    contractors: Annotated[str, expert(metavar="A,B", help="See `cpcal plugins`.")] = "lifted"
    arithmetic: Annotated[Literal["float64", "arb"], expert(help="Rigorous arithmetic.")] = "float64"
    support: Annotated[
        Literal["few", "irreducible", "none"],
        expert(help="Few measurements that prove the bound alone, or none that could be left out."),
    ] = "few"
    method: Annotated[
        Literal["bound", "timeout"],
        expert(help="Branch and bound on eps, or the paper's timeout method; that needs a time limit."),
    ] = "bound"
    half_width: Annotated[
        list[str] | None, expert(metavar="NAME=X", help="Of an extra parameter of the model; repeat for others.")
    ] = None
    as_json: Annotated[bool, expert("--json", help="Print result.json and nothing else.")] = False
    no_checker: Annotated[bool, expert("--no-checker", help="A page that does not check itself.")] = False

    def given(self) -> dict[str, Any]:
        """The keyword arguments of `cpcal.certify`. Raises BadParameter."""
        shared = [
            *("time_limit", "delta", "gap", "eps", "tolerance", "outliers", "node_limit", "model"),
            *("center", "arithmetic", "support", "method"),
        ]
        return {name: getattr(self, name) for name in shared} | {
            "legs": numbers_of(self.legs),
            "contractors": names_of(self.contractors),
            "half_widths": half_widths_of(self.half_width or []),
            "ranges": True,
        }

    def only(self, *names: str, where: Where, because: str) -> None:
        """InputError for each option that was given and is none of these."""
        problems = [
            Problem(
                f"option --{field.name.replace('_', '-').removeprefix('as-')}",
                f"has no meaning {because}",
                "leave it out",
            )
            for values in (self, where)
            for field in fields(values)
            if field.name not in names and getattr(values, field.name) != field.default
        ]
        if problems:
            raise InputError(problems)


_WITH_OUTLIERS = (
    *("outliers", "model", "legs", "time_limit", "delta", "center", "half_width", "as_json", "no_checker"),
    *("workers", "scheduler", "memory_limit", "resume"),
)


def certify(
    campaigns: Annotated[
        list[Path], typer.Argument(metavar="CAMPAIGN...", help="Folders of campaign.toml, measurements.csv.")
    ],
    run: Annotated[
        Path,
        output(
            "RUN",
            "Folder for result.json, campaign.json, a page and certificates; replaced there. Of several campaigns each "
            "has a folder in it.",
        ),
    ],
    options: CertifyFlags,
    where: Where,
    talk: Talk,
) -> Status:
    """Bracket, leg by leg, the smallest model error eps of each CAMPAIGN, by proofs from both sides.

    A leg's parameters reach eps when for every measurement THERE EXISTS a reading in its set at which the leg
    equation is off by at most eps (mm). With --tolerance the exit status is 0 if every leg passes, else 1: one fails,
    or is undecided. With --outliers the bracket holds whichever so many measurements are left out. Several models by
    commas are compared: which does the data refute, and does any pass?

    Ctrl-C, SIGTERM and limits end it with what is proved until then, and certificates of that.
    """
    models = names_of(options.model or "")
    one = bool(options.outliers) or len(models) > 1
    if len(campaigns) > 1:
        if options.as_json:
            raise InputError([Problem("option --json", "prints one result", "read summary.csv, or name one campaign")])
        if one:
            raise InputError([Problem("options", "--outliers and several models ask about one campaign", "name one")])
        check_writable(run)
        work = CampaignWork(options.given(), checker=not options.no_checker, resume=where.resume)
        with where.place() as place:
            return certified_all(campaigns, run, work, place, talk=talk)
    (campaign,) = campaigns
    if options.as_json:
        talk = replace(talk, quiet=True)
    if len(models) > 1:
        return _models_compared(campaign, run, models, options, where, talk)
    if options.outliers:
        options.only(*_WITH_OUTLIERS, where=where, because="with --outliers")
    check_target(run, RUN, campaign)
    with where.place() as place:
        question = question_of(warn(load_campaign(campaign)), **options.given())
        how: dict[str, Any] = {"as_json": options.as_json, "checker": not options.no_checker, "resume": where.resume}
        return status_of(certified_into(run, question, talk=talk, place=place, **how))


def names_of(text: str) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def half_widths_of(texts: list[str]) -> dict[str, float]:
    """The values of --half-width. Raises BadParameter."""
    out = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            out[name.strip()] = float(number)
        except ValueError:
            message = f"{text!r:.60} is no half-width: give a name and a number, such as s=0.01"
            raise typer.BadParameter(message, param_hint="--half-width") from None
    return out


# ------------------------------------------------------------------------------------------------------------------
# With several models: a run of each in a folder of its own, and a page that compares them.


def _models_compared(
    campaign: Path, runs: Path, models: tuple[str, ...], options: CertifyFlags, where: Where, talk: Talk
) -> Status:
    """Without a tolerance every bracket is an answer; with one, each leg needs a model that passes."""
    known = ("tolerance", "legs", "time_limit", "delta", "gap", "arithmetic", "contractors", "node_limit")
    places = ("workers", "scheduler", "memory_limit", "resume")
    options.only(*known, *places, "model", "no_checker", where=where, because="with several models")
    given = {name: value for name, value in options.given().items() if name in known}
    questions, found = comparison(warn(load_campaign(campaign)), models, **given), dict[str, Result]()
    check_writable(runs)
    how: dict[str, Any] = {"checker": not options.no_checker, "resume": where.resume, "talk": replace(talk, quiet=True)}
    with locked(runs), where.place() as place:
        for question in questions:
            name = question.model.name
            try:
                found[name] = certified_into(runs / name, question, place=place, **how)
            except Stopped:
                if not found:
                    raise
                break
            if found[name].interrupted:
                break
        stopped = len(found) < len(questions) or any(result.interrupted for result in found.values())
        page = write_comparison(found, runs, stopped=stopped)
        if talk.verbose:
            show_table(talk, comparison_table(found))
            talk.say(*map(printable, comparison_sentences(found)), f"{QUANTIFIER} {LONGER}")
        else:
            talk.say(*comparison_lines(found), SHORT_QUANTIFIER)
        talk.say(f"Page: {page}")
        if stopped:
            return Status(asked() or Reason.INTERRUPTED)
    if options.tolerance is None:
        return Status.ANSWERED
    legs = {leg.leg for result in found.values() for leg in result.legs}
    return Status.ANSWERED if all(passing(found, leg) for leg in legs) else Status.UNKNOWN
