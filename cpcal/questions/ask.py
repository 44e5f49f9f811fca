"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from pickle import PicklingError
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import InputError, unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256, save_campaign_json
from cpcal.files.run_folder import RUN, answers_into
from cpcal.models import LegModel
from cpcal.questions.leg import certify_leg
from cpcal.questions.question import COMPARED, Progress, Question, comparison, question_of
from cpcal.questions.result import CampaignNote, LegResult, ModelNote, Result, Uncertified
from cpcal.robot import Campaign
from cpcal.solver.execution.checkpoint_file import FOLDER, Checkpoints
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


AnsweredLeg = tuple[LegResult, bool, dict[str, bytes]]  # whether it was interrupted; what proves it, by its name


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
    answers to `cpcal verify`: then every step is proved once more in exact arithmetic before it counts for the answer,
    and contractors that give no weights (all but lifted) take no part, where another one gives some.
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
    kept = None if run is None else Checkpoints(Path(run) / FOLDER, question.identity, resume)
    with nullcontext() if run is None else answers_into(run, RUN) as draft:
        result = answered(question, place, draft, kept)
        if draft is not None:
            save_campaign_json(question.campaign, draft)
    if kept is not None and not result.unfinished:
        kept.end()
    return result


def answered(
    question: Question, place: Place = HERE, folder: Path | None = None, kept: Checkpoints | None = None
) -> Result:
    """All legs, with certificates in the `folder`, if there is one. Progress is told by work that is done here.

    When the process is asked to stop, legs not begun are missing.
    Raises LostWorkerError, and InputError for a question that cannot travel to where the work is done.
    """
    done, interrupted = dict[int, LegResult](), False
    try:
        for leg, stopped, files in _answers(question, place, kept, certified=folder is not None):
            interrupted |= stopped
            paths = [] if folder is None else [folder / name for name in files]
            try:
                for path, content in zip(paths, files.values(), strict=True):
                    write_file(path, content)
            except InputError:  # a full disk costs all certificates of the leg, and no answer
                for path in paths:
                    path.unlink(missing_ok=True)
                names = ("recommended", "passes_from", "reduced", "ranges")
                parts = {k: replace(of, certificate=None) for k in names if (of := getattr(leg, k)) is not None}
                bracket = replace(leg.bracket, certificate=None, proofs=(), point_certificate=None)
                leg = replace(leg, **parts, bracket=bracket, not_certified=Uncertified.UNWRITTEN)
            done[leg.leg] = leg
    except KeyboardInterrupt:
        interrupted = True
    campaign, model = question.campaign, question.model
    return Result(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        options=question.options,
        model=ModelNote(model.name, model.extra),
        version=__version__,
        interrupted=interrupted or len(done) < len(question.legs),
        legs=tuple(done[leg] for leg in question.legs if leg in done),
    )


def _answers(question: Question, place: Place, kept: Checkpoints | None, *, certified: bool) -> Iterator[AnsweredLeg]:
    """Those that were kept, then the others as they are done and kept.

    Of a single one the boxes of its search are the tasks: no process is begun for a search that closes in few boxes.
    """
    left = list(question.legs)
    for leg, files in [] if kept is None else kept.begin(LegResult):
        if leg.leg in left:
            left.remove(leg.leg)
            yield leg, False, files
    if len(left) == 1 and not isinstance(place[0], Here):
        question, place = question._replace(place=place), HERE
    executor, most = place
    here = isinstance(executor, Here)
    there = question._replace(
        certificates={} if certified else None,
        progress=question.progress if here else None,
        # others are perhaps of another machine, without our folders
        checkpoints=kept if isinstance(executor, Here | Processes) else None,
    )
    for number, future in outcomes(executor, most, partial(_aside, there), left):
        try:
            leg, stopped, files = future.result()
        except (PicklingError, AttributeError) as error:
            if "pickle" not in str(error).lower():
                raise
            remedy = "define it in a module that workers can import, or work here: leave out workers"
            raise unusable("model", f"cannot be sent to other processes ({error})", remedy) from None
        except LostWorkerError as error:
            again = "run again" if kept is None else "go on with --resume, which keeps what is answered"
            raise LostWorkerError(f"leg {number}: {error}; {again}, perhaps with fewer workers") from None
        if question.progress is not None and not here:
            bracket, work = leg.bracket, leg.work
            question.progress(leg.leg, Bracket(bracket.lo, bracket.hi, work.nodes, work.programs, work.seconds))
        if kept is not None and not (stopped or leg.work.pending or leg.not_certified is Uncertified.UNWRITTEN):
            kept.keep_answer(leg.leg, leg, files)
        yield leg, stopped, files
        if stopped and here:
            return


def _aside(question: Question, leg: int) -> AnsweredLeg:
    """A leg, and the certificates of it alone."""
    reason = asked()
    if reason is not None:
        raise Stopped(reason)
    proofs = None if question.certificates is None else dict[str, bytes]()
    with linear_algebra_on_one_thread():
        found, stopped = certify_leg(question._replace(certificates=proofs), leg)
    return found, stopped, proofs or {}


# ------------------------------------------------------------------------------------------------------------------
# Leg models compared: the same question with each of them, about the same box.


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
