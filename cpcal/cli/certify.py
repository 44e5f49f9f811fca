"""`cpcal certify`: brackets of the legs of a campaign, in several models, or with wrong measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cpcal.cli.verbs import (
    Status,
    Talk,
    Where,
    answer,
    argument,
    expert,
    line,
    numbers_of,
    option,
    options,
    output,
    refuse_options,
    warn,
)
from cpcal.common.errors import OutputError, printable
from cpcal.common.numbers import stated
from cpcal.files import load_campaign, save_campaign_json
from cpcal.files.run_folder import RUN, locked
from cpcal.models import LegModel
from cpcal.questions import Result, save_result, verdict_of
from cpcal.questions.ask import HERE, answered
from cpcal.questions.question import Question, comparison, question_of
from cpcal.report import (
    FRAME,
    LONGER,
    QUANTIFIER,
    bounds_table,
    leg_sentence,
    notices,
    outliers_section,
    parameters_section,
    write_report,
)
from cpcal.report.run_page import advice, answer_section, comparison_section, passing, write_comparison
from cpcal.report.section import Mark, Section, Table, Words
from cpcal.report.words import SHORT_QUANTIFIER, overall, uncertified_legs
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.checkpoint_file import FOLDER, Checkpoints
from cpcal.solver.execution.executors import LostWorkerError, Place
from cpcal.solver.execution.stopping import Reason, Stopped, asked, give_up

if TYPE_CHECKING:
    from rich.text import Text


def warned(campaign: Campaign) -> Campaign:
    """The campaign; what looks mixed up is said on stderr before the work begins."""
    for sentence in suspicions(campaign):
        warn(f"warning: {sentence}")
    return campaign


# ------------------------------------------------------------------------------------------------------------------
# Sections of a page on a terminal: what `cpcal.report` says of an answer, without figures.

STYLES = {  # by the kind of a verdict
    "explained": "bold green",
    "unexplained": "bold red",
    "bounded": "bold cyan",
    "undecided": "bold yellow",
    "undetermined": "bold magenta",
    "uncompared": "bold yellow",
}
_LOOKS = {**STYLES, "quantifier": "italic"}


def show(talk: Talk, *sections: Section) -> None:
    """Titles, sentences, lists, tables and data of the sections, and of their parts; with --verbose notes, too."""
    for section in sections:
        if section.title:
            talk.say(text_of(section.title, "bold"))
        talk.say(*map(text_of, (*section.sentences, *section.items)))
        for table in section.tables:
            show_table(talk, table)
        for name, words in section.data.items():
            talk.say(text_of([f"{name}: ", words]))
        talk.say(*map(text_of, section.notes if talk.verbose else ()))
        show(talk, *section.parts)


def show_table(talk: Talk, table: Table) -> None:
    """Names and words at the left, numbers at the right."""
    left = [k for k, (_, style, _) in enumerate(table.cells(table.head)) if not k or "word" in style]
    talk.table(table.head, [tuple(map(text_of, row)) for row in table.rows], left)


def text_of(words: Words, style: str = "") -> Text:
    from rich.text import Text  # here: a quiet command prints nothing

    if isinstance(words, str):
        return Text(printable(words), style=style)
    if isinstance(words, Mark):
        start = "\n    " if words.style == "second" else ""
        return Text(start) + text_of(
            words.words, next((_LOOKS[name] for name in words.style.split() if name in _LOOKS), style)
        )
    return Text().join(text_of(part, style) for part in words)


# ------------------------------------------------------------------------------------------------------------------
# What is printed at the end: a line a leg; with --verbose every table, and the sentences in full.

_MOST_LEGS = 6  # of which each has a line


def show_result(talk: Talk, campaign: Campaign, result: Result, model: LegModel) -> None:
    """The first screen of the page; with --verbose all of the answer."""
    if talk.quiet:
        return
    title = text_of(f"{campaign.title}: {result.campaign.measurements:,} measurements", "bold")
    if (whole := overall(result)) is not None:
        title.append(f"; tolerance {stated(result.options.tolerance or 0.0)} mm: ")
        title.append(whole.word, style=STYLES[whole.kind])
    talk.say(title)
    answer = answer_section(result, advice(campaign, result, model))
    legs = result.legs if talk.verbose else result.legs[:_MOST_LEGS]
    show(talk, answer._replace(items=answer.items[: len(legs)]))
    if more := len(result.legs) - len(legs):
        talk.say(f"and {more} more legs, which the report shows")
    if result.options.outliers:
        show(talk, outliers_section(result))
    elif talk.verbose:
        show_table(talk, bounds_table(result))
    for leg in legs if talk.verbose else ():
        talk.say(f"Leg {leg.leg}: {leg_sentence(result, leg)}")
        show(talk, parameters_section(campaign, result, leg))
    talk.say(*([FRAME, f"{QUANTIFIER} {LONGER}"] if talk.verbose else [SHORT_QUANTIFIER]), style="italic")
    for missing in filter(None, (notices(result, campaign.legs), uncertified_legs(result))):
        talk.say(missing, style="bold yellow")


# ------------------------------------------------------------------------------------------------------------------
# Certify, write the run, show it: what the verbs `certify` and `demo` share.


def certified_into(run: Path, question: Question, *, talk: Talk, place: Place = HERE, resume: bool = False) -> Result:
    """Answer a question, write the run, print the answer.

    `place`: where the work is done. `resume`: go on from the checkpoint of an earlier run. Stopped before any leg has
    an answer, it raises Stopped, and what was there before stays.
    """
    campaign, kept = question.campaign, Checkpoints(run / FOLDER, question.identity, resume)

    def find(draft: Path) -> Result:
        try:
            with line(talk.console()) as shown:
                result = answered(question._replace(progress=shown.leg), place, draft, kept)
        except LostWorkerError as error:  # nobody is there to work any more: what is answered counts
            give_up(Reason.DESERTED)
            if asked() is None:
                raise
            result = answered(question, HERE, draft, kept._replace(resume=True))
            if not result.legs:
                raise
            warn(str(error))
        except MemoryError as error:
            what = f"{len(campaign)} measurements need more memory than there is ({str(error) or 'nothing is left'})"
            remedy = "go on with --resume, which keeps what is answered, where there is more"
            raise MemoryError(f"{what}; {remedy}") from None
        if result.interrupted and not result.legs:
            raise Stopped(asked() or Reason.INTERRUPTED)
        save_campaign_json(campaign, draft)
        return result

    page = partial(write_report, campaign, model=question.model)
    show = partial(show_result, talk, campaign, model=question.model)
    try:
        result = answer(run, RUN, find, save_result, page, show, talk)
    except OutputError:
        if any(kept.folder.glob("*.answer")):
            warn(f"what is answered is kept in {kept.folder}: --resume writes it, once there is room")
        raise
    if not result.unfinished:
        kept.end()
    return result


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
# The verb.

_NOT_WITH_OUTLIERS = ("eps", "gap", "node_limit", "contractors", "support", "method")
_NOT_WITH_MODELS = ("outliers", "eps", "center", "support", "method")


@options
class CertifyFlags:
    """The options of `cpcal.certify` and `compare`."""

    tolerance: float | None = option(
        None, "The error that a leg may have, whatever the readings are: does it pass?", "MM"
    )
    outliers: int = option(0, "Measurements of a leg that may be wrong, at most, nobody knows which.", "Q", min=0)
    model: str | None = option(
        None, "Leg model, such as plain or gain; several are compared.", "A,B", show_default="the campaign's"
    )
    legs: str | None = option(None, "Legs, counted from 1.", "1,3", show_default="all")
    time_limit: float | None = option(None, "Seconds a leg, at most.", "S", min=0.0)
    eps: float | None = expert(None, "Ask instead whether any parameters reach this eps.", "MM")
    delta: float = expert(100.0, "Half-width of the box of parameters.", "MM")
    center: Literal["fit", "nominal"] = expert("fit", "Middle of that box: a least-squares fit, or nominal.")
    gap: float = expert(1e-6, "Relative width at which the bracket counts as closed.")
    node_limit: int | None = expert(None, "Boxes a leg, at most.", "N", min=1)
    contractors: str = expert("lifted", "See `cpcal plugins`.", "A,B")
    support: Literal["few", "none"] = expert("few", "Seek few measurements that give the bound by themselves.")
    method: Literal["bound", "timeout"] = expert(
        "bound", "Branch and bound on eps, or the paper's timeout method; that needs a time limit."
    )


def certify(
    campaign: Path = argument("CAMPAIGN", "Folder of campaign.toml, measurements.csv."),
    run: Path = output("RUN", "Folder for result.json, campaign.json, a page and certificates; replaced there."),
    *,
    options: CertifyFlags,
    where: Where,
    talk: Talk,
) -> Status:
    """Two proved tolerances of each leg of a CAMPAIGN: below the one it fails, from the other on it passes.

    It fails when no parameters meet the tolerance at every measured pose, whatever the readings in their sets are. It
    passes when the recommended parameters meet it for ALL readings: worse sensors make passing harder. Between them
    the readings are too uncertain to say. With --tolerance the exit status is 0 if every leg passes, else 1. With
    --outliers all this holds whichever so many measurements are left out. Several models by commas are compared.

    Ctrl-C, SIGTERM and limits end it with what is proved until then, and certificates of that.
    """
    legs = numbers_of(options.legs, int, "legs: give numbers with commas between them, such as 1,3", "--legs")
    contractors, models = (
        tuple(name.strip() for name in names.split(",") if name.strip())
        for names in (options.contractors, options.model or "")
    )
    given = asdict(options) | {"ranges": True, "legs": legs, "contractors": contractors}
    several, changed = len(models) > 1, {k for k, v in asdict(CertifyFlags()).items() if getattr(options, k) != v}
    if several:
        refuse_options(_NOT_WITH_MODELS, changed, "with several models")
        given = {name: value for name, value in given.items() if name not in ("model", "ranges", *_NOT_WITH_MODELS)}
    elif options.outliers:
        refuse_options(_NOT_WITH_OUTLIERS, changed, "with --outliers")
    loaded = warned(load_campaign(campaign))
    with where.place() as place:
        if several:
            return _models_compared(comparison(loaded, models, **given), run, where.resume, place, talk)
        question = question_of(loaded, **given)
        return status_of(certified_into(run, question, talk=talk, place=place, resume=where.resume))


def _models_compared(questions: Sequence[Question], runs: Path, resume: bool, place: Place, talk: Talk) -> Status:
    """A run of each model in a folder of its own, and a page that compares them.

    Without a tolerance every bracket is an answer; with one, each leg needs a model that passes.
    """
    found = {}
    with locked(runs):
        for question in questions:
            name = question.model.name
            try:
                hushed = replace(talk, quiet=True)
                found[name] = certified_into(runs / name, question, talk=hushed, place=place, resume=resume)
            except Stopped:
                if not found:
                    raise
                break
            if found[name].interrupted:
                break
        stopped = len(found) < len(questions) or any(result.interrupted for result in found.values())
        page = write_comparison(found, runs, stopped=stopped, title=questions[0].campaign.title)
        compared = comparison_section(found)
        show(talk, compared if talk.verbose else compared._replace(parts=()))
        talk.say(*[] if talk.verbose else [SHORT_QUANTIFIER])
        talk.say(f"Page: {page}")
        if stopped:
            return Status(asked() or Reason.INTERRUPTED)
    if questions[0].options.tolerance is None:
        return Status.ANSWERED
    return Status.ANSWERED if all(passing(found).values()) else Status.UNKNOWN
