"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from pickle import PicklingError
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import InputError, refuse, together, unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import RUN, answers_into
from cpcal.models import LegModel
from cpcal.questions.leg import all_or_none, certify_leg
from cpcal.questions.question import Checkpoints, Progress, Question, beyond_all_legs, question_of
from cpcal.questions.result import CampaignNote, LegResult, ModelNote, Result, Uncertified
from cpcal.robot import Campaign
from cpcal.solver.execution.executors import (
    Here,
    LostWorkerError,
    Place,
    Processes,
    executor_for,
    linear_algebra_on_one_thread,
    outcomes,
)
from cpcal.solver.execution.stopping import Stopped, asked, heard
from cpcal.solver.optimize.bound import Bracket

if TYPE_CHECKING:
    from distributed import Client

# ------------------------------------------------------------------------------------------------------------------
# All legs: each is a task, here or wherever an executor does it.
#
# What travels is the question and the answer, with the files that prove it: a worker needs no folder of ours.

LOADS = ("cpcal.questions.ask", "cpcal.solver.numba_begun")  # of workers
HERE: Place = (Here(), 1)


AnsweredLeg = tuple[LegResult, bool, Mapping[str, bytes]]  # whether it was interrupted; what proves it, by its name


def certify(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    gap: float = 1e-6,
    time_limit: float | None = None,
    node_limit: int | None = None,
    contractors: Sequence[str] = ("lifted",),
    eps: float | None = None,
    tolerance: float | None = None,
    outliers: int = 0,
    support: str = "few",
    method: str = "bound",
    certificates: StrPath | None = None,
    progress: Progress | None = None,
    model: str | LegModel | None = None,
    half_widths: Mapping[str, float] | None = None,
    ranges: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | Client | None = None,
    resume: bool = False,
) -> Result:
    """For every leg the smallest eps for which some x satisfies all N equations, bracketed by proofs.

    "Satisfies" means: for every measurement THERE EXISTS a reading in its set with `|g(x, M_k)| <= eps`.
    x ranges over all parameters within `delta` mm of the center: "fit" (least squares), "plain" (of the plain model) or
    "nominal". `legs` counts from 1 (default: all). `gap` is relative; `time_limit` (seconds) and `node_limit` (boxes)
    are of each leg. With `eps` (mm) the question is instead whether S(eps) is empty. `progress` is called with
    (leg, Bracket) as the brackets shrink. `tolerance` (mm) is the error that a leg may have: it passes if the
    recommended parameters are proved to be right to within it at every measured pose for ALL readings in their sets.
    With `outliers` all holds whichever so many measurements of a leg are wrong, nobody knows which.

    With `support` "none" no support is sought. `certificates` names a folder for `legN.cert.jsonl`, which prove the
    answers to `cpcal verify`: then
    every step of a contractor that gives weights (lifted) is proved once more in exact arithmetic before it counts for
    the answer. All contractors take part.
    Certificates replace those of an earlier run, and its answers, when all legs are done.

    `method` "bound" is branch and bound on eps; "timeout" is the method of the paper's section 5.2.1, which asks a
    solver made of the contractors for points at one eps after the other, and needs a `time_limit`.

    `model` is the leg model: "plain", "gain", "lateral", the name of one that an installed package provides,
    or a `LegModel` (default: the campaign's, else plain). Its extra parameters range within `half_widths` of 0: those
    given by name, else its own.

    With `ranges` each leg that has a tolerance to ask them at gets the proved ranges of its parameters: at `eps`, at
    the tolerance if some parameters reach it, else at 1.1 times eps_hi. `ranges-legN.cert.jsonl` proves them.

    `workers` processes of this machine, the Dask cluster whose `scheduler` has that address, or an `executor` (any of
    `concurrent.futures`, or a `distributed.Client`) do the legs; left out: this process does, one after the other. The
    certificates are the same, byte for byte.

    Ctrl-C ends it with what is proved so far, and certificates of that. Until all is answered the folder keeps what is
    done in `checkpoint`; with `resume` another call goes on from there, whatever its limits, to the same certificates.

    Raises InputError, PluginError, LostWorkerError.
    """
    question = question_of(
        campaign,
        progress=progress,
        legs=legs,
        delta=delta,
        center=center,
        gap=gap,
        time_limit=time_limit,
        node_limit=node_limit,
        contractors=contractors,
        eps=eps,
        tolerance=tolerance,
        outliers=outliers,
        support=support,
        method=method,
        model=model,
        half_widths=half_widths or {},
        ranges=ranges,
    )
    with heard(), executor_for(workers, scheduler, executor, loads=LOADS) as place:
        return _answered_into(question, certificates, place, resume=resume)


def _answered_into(question: Question, run: StrPath | None, place: Place, *, resume: bool = False) -> Result:
    """All legs, with certificates in the folder of a run, if there is one."""
    if run is None:
        return answered(question, place)
    with answers_into(run, RUN, question.campaign) as draft:
        kept = Checkpoints.for_run(Path(run), question, resume=resume)
        kept.begin()
        result = answered(question._replace(certificates=draft, checkpoints=kept), place)
    kept.end_after(result)
    return result


def answered(question: Question, place: Place = HERE) -> Result:
    """All legs. Progress is told by work that is done here.

    Of a single one the boxes of its search are the tasks: no process is begun for a search that closes in few boxes.
    When the process is asked to stop, legs not begun are missing.
    Raises LostWorkerError, and InputError for a question that cannot travel to where the work is done.
    """
    campaign, model, kept = question.campaign, question.model, question.checkpoints
    numbers = question.options.legs or tuple(range(1, campaign.legs + 1))
    beyond = beyond_all_legs(question, numbers)
    if beyond:
        raise InputError(beyond)
    earlier = [] if kept is None else [found for leg in numbers if (found := kept.answer(leg)) is not None]
    done = {leg.leg: with_certificates(question, files, leg) for leg, files in earlier}
    left = [leg for leg in numbers if leg not in done]
    if len(left) == 1 and not isinstance(place[0], Here):
        question, place = question._replace(place=place), HERE
    executor, most = place
    here = isinstance(executor, Here)
    near = isinstance(executor, Here | Processes)  # else perhaps of another machine, without our folders
    there = question._replace(progress=question.progress if here else None, checkpoints=kept if near else None)
    interrupted = False
    try:
        for number, future in outcomes(executor, most, partial(_aside, there), left):
            leg, stopped, files = _value(number, future, resumable=kept is not None)
            done[leg.leg] = leg = with_certificates(question, files, leg)
            interrupted = interrupted or stopped
            unfinished = stopped or leg.work.pending or leg.not_certified is Uncertified.UNWRITTEN
            if kept is not None and not unfinished:
                kept.keep_answer(leg, files)
            if question.progress is not None and not here:
                bracket, work = leg.bracket, leg.work
                question.progress(leg.leg, Bracket(bracket.lo, bracket.hi, work.nodes, work.programs, work.seconds))
            if stopped and here:
                break
    except KeyboardInterrupt:
        interrupted = True
    return Result(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        options=question.options,
        model=ModelNote(model.name, model.extra),
        version=__version__,
        interrupted=interrupted or len(done) < len(numbers),
        legs=tuple(done[leg] for leg in numbers if leg in done),
    )


def _aside(question: Question, leg: int) -> AnsweredLeg:
    """A leg, its certificates written aside."""
    reason = asked()
    if reason is not None:
        raise Stopped(reason)
    with linear_algebra_on_one_thread(), TemporaryDirectory(prefix="cpcal-") as place:
        folder = Path(place)
        if question.certificates is not None:
            question = question._replace(certificates=folder)
        found, stopped = certify_leg(question, leg)
        return found, stopped, {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _value(number: int, future: Future[AnsweredLeg], *, resumable: bool) -> AnsweredLeg:
    error = future.exception()
    if isinstance(error, PicklingError | AttributeError) and "pickle" in str(error).lower():
        remedy = "define it in a module that workers can import, or work here: leave out workers"
        raise unusable("model", f"cannot be sent to other processes ({error})", remedy)
    if isinstance(error, LostWorkerError):
        again = "go on with --resume, which keeps what is answered" if resumable else "run again"
        raise LostWorkerError(f"leg {number}: {error}; {again}, perhaps with fewer workers")
    return future.result()


def with_certificates(question: Question, files: Mapping[str, bytes], leg: LegResult) -> LegResult:
    """The leg, its certificates in the folder for them; where they cannot be written it stays, without them."""
    lost = set()
    for name, content in files.items():
        assert question.certificates is not None
        try:
            write_file(question.certificates / name, content)
        except InputError:
            lost.add(name)
    bracket = leg.bracket
    for name in ("recommended", "passes_from", "reduced", "ranges"):
        of = getattr(leg, name)
        if of is not None and of.certificate in lost:
            leg = replace(leg, **{name: replace(of, certificate=None)})
    if lost.intersection((bracket.certificate, bracket.point_certificate, *bracket.proofs)):
        kept = all_or_none(question, [None if name in lost else name for name in bracket.proofs])
        bracket = replace(
            bracket,
            certificate=None,
            proofs=kept,
            point_certificate=None if bracket.point_certificate in lost else bracket.point_certificate,
        )
        left = kept or bracket.point_certificate
        leg = replace(leg, bracket=bracket, not_certified=Uncertified.NOTHING if left else Uncertified.UNWRITTEN)
    return leg


# ------------------------------------------------------------------------------------------------------------------
# Leg models compared: the same question with each of them, about the same box.

COMPARED = ("plain", "gain", "lateral")
_CENTERS = ("plain", "nominal")  # the same for all models, whatever their own fits


def compare(
    campaign: Campaign,
    models: Sequence[str | LegModel] = COMPARED,
    *,
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    certificates: StrPath | None = None,
    **given: Any,
) -> dict[str, Result]:
    """What `certify` answers with each model, by the model's name; `given`: other arguments of `certify`.

    All models are asked about the same box of (a, b, l), within `delta` mm of the fit of the plain model (or of the
    nominal parameters, with `center="nominal"`), their extra parameters within `half_widths[model]` of 0. So a model
    that contains another one never has a larger eps. `certificates` names a folder, in which each model has one.
    Ctrl-C ends it with what is proved so far. Raises InputError with every problem, PluginError.
    """
    questions, found = comparison(campaign, models, half_widths, **given), {}
    with heard():
        for question in questions:
            name = question.model.name
            found[name] = _answered_into(question, None if certificates is None else Path(certificates) / name, HERE)
            if found[name].interrupted:
                break
    return found


def comparison(
    campaign: Campaign,
    models: Sequence[str | LegModel],
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    *,
    center: str = "plain",
    **given: Any,
) -> list[Question]:
    """What is asked with each of the models. Raises InputError with every problem, PluginError."""
    names = [model if isinstance(model, str) else model.name for model in models]
    widths, given = half_widths or {}, {"center": center, "support": "none"} | given
    listed, centers = ", ".join(names), " or ".join(_CENTERS)
    _, *questions = together(
        partial(
            refuse,
            (not names, "models", "none is named", f"name some, such as {', '.join(COMPARED)}"),
            (len(set(names)) < len(names), "models", "one is named twice", "name each once"),
            *(
                (name not in names, "half_widths", f"{name!r} is not compared", f"models are {listed}")
                for name in widths
            ),
            (center not in _CENTERS, "center", f"{center!r} is not common to all models", f"use {centers}"),
        ),
        *(
            partial(question_of, campaign, model=model, half_widths=widths.get(name, {}), **given)
            for name, model in zip(names, models, strict=True)
        ),
    )
    return questions
