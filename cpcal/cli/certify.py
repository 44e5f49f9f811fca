"""`cpcal certify`: brackets of legs, of one campaign or many, of several models, or with wrong measurements."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cpcal.cli.options import (
    Running,
    Status,
    Talk,
    Where,
    check_target,
    check_writable,
    grouped,
    output_path,
    record,
    talking,
)
from cpcal.cli.progress import bar, watch
from cpcal.cli.sections import STYLES, show, table_of
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.files import scratch_folder
from cpcal.common.numbers import bracket_text, nearest, stated
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256, load_campaign
from cpcal.files.run_folder import COMPARED as FOLDER
from cpcal.files.run_folder import REPORT_NAME, ROBUST, RUN, answers_into, locked
from cpcal.legs import LegModel, built_in
from cpcal.questions import (
    COMPARED,
    Comparison,
    Entry,
    Explained,
    LegResult,
    Result,
    comparison_text,
    load_result,
    result_text,
    save_comparison,
    save_result,
    verdict_of,
)
from cpcal.questions.ask import answered, checked_options
from cpcal.questions.compare import compared, comparison_question
from cpcal.questions.outliers import certify_robust
from cpcal.questions.question import HERE, Checkpoints, Progress, Question
from cpcal.questions.robust_result import RobustResult
from cpcal.report import (
    FRAME,
    LONGER,
    QUANTIFIER,
    bounds_table,
    center_sentence,
    leg_sentence,
    notices,
    parameters_section,
    write_report,
)
from cpcal.report.advice import advise, fitted
from cpcal.report.comparison_page import (
    COMPARISON_PAGE,
    CampaignRow,
    comparison_lines,
    comparison_sentences,
    comparison_table,
    row_of,
    said,
    write_campaigns,
    write_comparison,
)
from cpcal.report.words import SHORT_QUANTIFIER, overall, short_fit, uncertified_legs
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.executors import Here, Place, Processes
from cpcal.solver.execution.outcomes import LostWorkerError, TaskOutcome, outcomes
from cpcal.solver.execution.stopping import Reason, Stopped, asked, give_up
from cpcal.solver.execution.threads import linear_algebra_on_one_thread
from cpcal.solver.optimize.minimum import Bracket

# ------------------------------------------------------------------------------------------------------------------
# Campaigns as verbs read them: what looks mixed up is said on stderr before the work begins.


def read_campaign(folder: Path) -> Campaign:
    """The campaign in a folder; see `warn`. Raises InputError."""
    return warn(load_campaign(folder))


def warn(campaign: Campaign) -> Campaign:
    """Say on stderr what looks wrong with the campaign."""
    for sentence in suspicions(campaign):
        typer.echo(printable(f"cpcal: warning: {sentence}"), err=True)
    return campaign


# ------------------------------------------------------------------------------------------------------------------
# `cpcal certify`: the main job. For exit statuses see `cpcal.cli`.

# ------------------------------------------------------------------------------------------------------------------
# What is printed at the end: a line a leg; with --verbose every table, and the sentences in full.

_MOST_LEGS = 6  # of which each has a line


def show_result(
    console: Console, campaign: Campaign, result: Result, model: LegModel, *, verbose: bool = False
) -> None:
    """The answer in ten lines at most, or all of it."""
    title = Text(f"{printable(result.robot)}: {result.measurements:,} measurements", style="bold")
    verdict = overall(result)
    if verdict is not None:
        title.append(f"; tolerance {stated(result.options.tolerance or 0.0)} mm: ")
        title.append(verdict.word, style=STYLES[verdict.kind])
    console.print(title, soft_wrap=True)
    if verbose:
        _everything(console, campaign, result, model)
    else:
        _lines(console, campaign, result, model)
    missing = notices(result, campaign.legs)
    if missing:
        console.print(Text(missing, style="bold yellow"))
    uncertified = uncertified_legs(result)
    if uncertified is not None:
        console.print(Text(uncertified, style="bold yellow"), soft_wrap=True)


def _lines(console: Console, campaign: Campaign, result: Result, model: LegModel) -> None:
    """A line a leg: how well it fits, what to look at first, what to do next."""
    for leg in result.legs[:_MOST_LEGS]:
        verdict = verdict_of(result, leg)
        found = advise(campaign, result, leg, model, fitted(campaign, result, leg, model))
        line = Text(f"Leg {leg.leg}: ").append(short_fit(verdict), style=STYLES[verdict.kind])
        if found.first:
            line.append(f"; look at {', '.join(str(k + 1) for k in found.first)}")
        console.print(line.append(f"; next: {found.short}"), soft_wrap=not console.is_terminal)
    more = len(result.legs) - _MOST_LEGS
    if more > 0:
        console.print(f"and {more} more legs, which the report shows")
    console.print(Text(SHORT_QUANTIFIER, style="italic"), soft_wrap=not console.is_terminal)


def _everything(console: Console, campaign: Campaign, result: Result, model: LegModel) -> None:
    console.print(table_of(bounds_table(result)))
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        line = Text(f"Leg {leg.leg}: ").append(verdict.word, style=STYLES[verdict.kind])
        said = [leg_sentence(result, leg), center_sentence(result, leg) or ""]
        console.print(line.append(f". {printable(' '.join(said).strip())}"), soft_wrap=not console.is_terminal)
        if leg.ranges is not None:
            fit = fitted(campaign, result, leg, model)
            show(console, [parameters_section(campaign, result, leg, fit)])
    console.print(Text(FRAME), soft_wrap=not console.is_terminal)
    console.print(Text(f"{QUANTIFIER} {LONGER}", style="italic"), soft_wrap=not console.is_terminal)


# ------------------------------------------------------------------------------------------------------------------
# Certify, write the run, show it: what the verbs `certify` and `demo` share.


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
                _campaign_record(rows[-1], len(rows) + len(failed), count, began)
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


def _campaign_record(row: CampaignRow, done: int, count: int, began: float) -> None:
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


class Center(StrEnum):
    FIT = "fit"
    PLAIN = "plain"
    NOMINAL = "nominal"


class Engine(StrEnum):
    FLOAT64 = "float64"
    ARB = "arb"


class MethodName(StrEnum):
    BOUND = "bound"
    TIMEOUT = "timeout"


class Support(StrEnum):
    FEW = "few"
    IRREDUCIBLE = "irreducible"
    NONE = "none"


@dataclass(frozen=True)
class CertifyFlags(Running):
    """The options of the command line: those of `cpcal.certify`, and where it runs."""

    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of parameters.")] = 100.0
    center: Annotated[Center, typer.Option(help="Middle of that box: a least-squares fit, or nominal.")] = Center.FIT
    gap: Annotated[float, typer.Option(help="Relative width at which the bracket counts as closed.")] = 1e-6
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg, at most.")] = None
    node_limit: Annotated[int | None, typer.Option(metavar="N", min=1, help="Boxes a leg, at most.")] = None
    contractors: Annotated[str, typer.Option(metavar="A,B", help="See `cpcal plugins`.")] = "lifted"
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64
    eps: Annotated[
        float | None, typer.Option(metavar="MM", help="Ask instead whether any parameters reach this eps.")
    ] = None
    tolerance: Annotated[
        float | None, typer.Option(metavar="MM", help="The error that the legs may have: each passes or fails.")
    ] = None
    support: Annotated[
        Support, typer.Option(help="Few measurements that prove the bound alone, or none that could be left out.")
    ] = Support.FEW
    method: Annotated[
        MethodName,
        typer.Option(help="Branch and bound on eps, or the paper's timeout method; that needs a time limit."),
    ] = MethodName.BOUND
    model: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Leg model, such as plain or gain.", show_default="the campaign's"),
    ] = None
    half_width: Annotated[
        list[str] | None, typer.Option(metavar="NAME=X", help="Of an extra parameter of the model; repeat for others.")
    ] = None

    def given(self) -> dict[str, object]:
        """The keyword arguments of `cpcal.certify`. Raises BadParameter."""
        return {
            "legs": None if self.legs is None else numbers_of(self.legs),
            "delta": self.delta,
            "center": self.center.value,
            "gap": self.gap,
            "time_limit": self.time_limit,
            "node_limit": self.node_limit,
            "contractors": names_of(self.contractors),
            "arithmetic": self.arithmetic.value,
            "eps": self.eps,
            "tolerance": self.tolerance,
            "support": self.support.value,
            "method": self.method.value,
            "model": self.model,
            "half_widths": half_widths_of(self.half_width or []),
        }


@talking
@grouped(CertifyFlags)
def certify(
    campaigns: Annotated[
        list[Path], typer.Argument(metavar="CAMPAIGN...", help="Folders of campaign.toml, measurements.csv.")
    ],
    run: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="RUN",
            parser=output_path,
            help="Folder for result.json, campaign.json, report.html and certificates; replaced there. Of several "
            "campaigns each has a folder in it.",
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json and nothing else.")] = False,
    no_checker: Annotated[bool, typer.Option("--no-checker", help="A page that does not check itself.")] = False,
    *,
    options: CertifyFlags,
    talk: Talk,
) -> None:
    """Bracket, leg by leg, the smallest model error eps of each CAMPAIGN, by proofs from both sides.

    A leg's parameters reach eps when for every measurement THERE EXISTS a reading in its set at which the leg
    equation is off by at most eps (mm). With --eps the question is whether any parameters in the box do.
    With --tolerance the exit status is 0 if every leg passes, else 1: one fails, or is undecided.

    Ctrl-C, SIGTERM and limits end it with what is proved until then, and certificates of that.
    """
    given = options.given()
    if len(campaigns) > 1:
        if as_json:
            raise InputError([Problem("option --json", "prints one result", "read summary.csv, or name one campaign")])
        check_writable(run)
        work = CampaignWork(given, checker=not no_checker, resume=options.resume)
        with options.place() as place:
            status = certified_all(campaigns, run, work, place, talk=talk)
        raise typer.Exit(status)
    (campaign,) = campaigns
    check_target(run, RUN, campaign)
    with options.place() as place:
        result = certified_into(
            run,
            read_campaign(campaign),
            given,
            as_json=as_json,
            talk=talk,
            checker=not no_checker,
            place=place,
            resume=options.resume,
        )
        status = status_of(result)
    raise typer.Exit(status)


def names_of(text: str) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers_of(text: str) -> tuple[int, ...]:
    """The numbers of --legs. Raises BadParameter."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        message = f"{text!r:.60} is no list of legs: give numbers with commas between them, such as 1,3"
        raise typer.BadParameter(message, param_hint="--legs") from None


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
# `cpcal compare`: leg models side by side. For exit statuses see `cpcal.cli`.


@dataclass(frozen=True)
class CompareFlags(Where):
    """The options of the command line: those of `cpcal.compare`, and where it runs."""

    models: Annotated[str, typer.Option(metavar="A,B", help="Leg models.")] = ",".join(COMPARED)
    tolerance: Annotated[float | None, typer.Option(metavar="MM", help="Say which models are refuted at it.")] = None
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of (a, b, l).")] = 100.0
    gap: Annotated[float, typer.Option(help="Relative width at which a bracket counts as closed.")] = 1e-6
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg and model, at most.")] = None
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64


@talking
@grouped(CompareFlags)
def compare_models(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            parser=output_path,
            help="Folder for compare.json, compare.html, campaign.json and certificates; replaced there.",
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print compare.json and nothing else.")] = False,
    *,
    options: CompareFlags,
    talk: Talk,
) -> None:
    """Bracket the smallest model error eps of every leg of a CAMPAIGN under each of several leg models.

    With --tolerance it says which models the measurements refute at that many mm, and which certificate proves it; the
    exit status is then 0 if every leg has a model that passes, else 1: one has none, or is undecided.
    """
    legs = None if options.legs is None else numbers_of(options.legs)
    check_target(folder, FOLDER, campaign)
    if as_json:
        talk = replace(talk, quiet=True)
    with options.place() as place:
        found, failure = _written(read_campaign(campaign), options, legs, folder, talk, place)
        status = _status_of_models(found)
    if as_json:
        typer.echo(comparison_text(found), nl=False)
    _show_models(talk.out, found, verbose=talk.verbose)
    if failure is not None:
        raise failure
    talk.say(f"Page: {folder / COMPARISON_PAGE}")
    raise typer.Exit(status)


def _written(
    campaign: Campaign, options: CompareFlags, legs: tuple[int, ...] | None, folder: Path, talk: Talk, place: Place
) -> tuple[Comparison, InputError | None]:
    """What was found, and why it could not be written."""
    question, models = comparison_question(
        campaign,
        names_of(options.models),
        tolerance=options.tolerance,
        legs=legs,
        delta=options.delta,
        gap=options.gap,
        time_limit=options.time_limit,
        arithmetic=options.arithmetic.value,
    )
    errors = talk.errors

    def tell(entry: Entry) -> None:
        record("entry", subject=entry.subject, model=entry.model, eps_lo=entry.eps_lo, eps_hi=entry.eps_hi)
        errors.print(f"{entry.subject}, {entry.model}: {nearest(entry.seconds, 1)} s", soft_wrap=True)

    found: Comparison | None = None
    try:
        with answers_into(folder, FOLDER, campaign) as draft:
            found = compared(replace(question, certificates=draft), models, tell, place)
            save_comparison(found, draft)
            write_comparison(found, draft)
    except InputError as error:
        if found is None:
            raise
        return found, error
    return found, None


def _show_models(console: Console, found: Comparison, *, verbose: bool) -> None:
    wrapped = not console.is_terminal
    if not verbose:
        for line in comparison_lines(found):
            console.print(line, soft_wrap=wrapped)
        console.print(Text(SHORT_QUANTIFIER, style="italic"), soft_wrap=wrapped)
        return
    table = comparison_table(found)  # without the ranges of extra parameters, which the page has
    console.print(table_of(replace(table, head=table.head[:6], rows=tuple(row[:6] for row in table.rows))))
    for sentence in comparison_sentences(found):
        console.print(printable(sentence), soft_wrap=wrapped)
    console.print(Text(said(found), style="italic"), soft_wrap=wrapped)


def _status_of_models(found: Comparison) -> Status:
    """Without a tolerance every bracket is an answer; with one, each leg needs a model that passes."""
    if found.interrupted:
        return Status(asked() or Reason.INTERRUPTED)
    at, subjects = found.tolerance, {entry.subject for entry in found.entries}
    if at is None:
        return Status.ANSWERED
    passed = {entry.subject for entry in found.entries if isinstance(entry.leg_verdict(at, found.options), Explained)}
    return Status.ANSWERED if passed == subjects else Status.UNKNOWN


# ------------------------------------------------------------------------------------------------------------------
# `cpcal robust`: brackets when some measurements may be wrong. For exit statuses see `cpcal.cli`.


@talking
@grouped(Where, "where")
def robust_brackets(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            parser=output_path,
            help="Folder for robust.json, campaign.json and certificates; replaced there.",
        ),
    ],
    outliers: Annotated[int, typer.Option(help="Measurements of a leg that may be wrong, at most.")],
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None,
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of parameters.")] = 100.0,
    center: Annotated[
        Center,
        typer.Option(help="Middle of that box: a least-squares fit, which gross errors move, or nominal."),
    ] = Center.FIT,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg, at most.")] = None,
    model: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Leg model, such as plain or gain.", show_default="the campaign's"),
    ] = None,
    *,
    where: Where,
    talk: Talk,
) -> None:
    """Bracket the smallest model error of a CAMPAIGN's legs when some measurements may be wrong, nobody knows which.

    Proved: whichever so many are left out, no parameters explain all others better than eps_lo. The point explains all
    but those that are named.
    """
    check_target(folder, ROBUST, campaign)
    with where.stoppable():
        found = certify_robust(
            read_campaign(campaign),
            outliers=outliers,
            legs=None if legs is None else numbers_of(legs),
            delta=delta,
            center=center.value,
            time_limit=time_limit,
            model=model,
            certificates=folder,
            tell=talk.progress(),
            workers=where.workers,
            scheduler=where.scheduler,
        )
    for leg in found.legs:
        record("leg", leg=leg.leg, eps_lo=leg.eps_lo, eps_hi=leg.eps_hi, left_out=leg.left_out, seconds=leg.seconds)
    _show_robust(talk.out, found)
    raise typer.Exit(Status.ANSWERED if all(leg.complete for leg in found.legs) else Status.UNKNOWN)


def _show_robust(console: Console, found: RobustResult) -> None:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "eps_lo [mm]", "eps_hi [mm]", "left out", "proofs"):
        table.add_column(name, justify="right" if name.startswith("eps") else "left", overflow="fold")
    for leg in found.legs:
        bounds = bracket_text(leg.eps_lo, leg.eps_hi)
        table.add_row(str(leg.leg), *bounds, ", ".join(leg.left_out) or "none", str(len(leg.proofs)))
    console.print(table)
    for leg in found.legs:
        console.print(f"Leg {leg.leg}: {leg.sentence}", soft_wrap=not console.is_terminal)
    said = f"Whichever {found.outliers} measurements of a leg are wrong, no parameters in the box explain the others"
    console.print(f"{said} better than eps_lo; some explain all but those left out to within eps_hi.", soft_wrap=True)
