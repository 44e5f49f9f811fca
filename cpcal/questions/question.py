"""What is asked of every leg alike."""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from pickle import PicklingError
from typing import Generic, TypeVar

import numpy as np

from cpcal.common.errors import CpcalError, InputError, Problem
from cpcal.common.files import scratch_folder
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.codec import decoded, encoded
from cpcal.models import (
    PLAIN,
    LegModel,
    beyond_legs,
    built_in,
    fit_model,
    half_width_problems,
    leg_box,
    leg_model,
    leg_network,
    model_statement,
)
from cpcal.questions import LegResult, Options, Result
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import Statement
from cpcal.solver.certificate.recording import Recording, SearchKeeper
from cpcal.solver.contract import Contractor, Limits
from cpcal.solver.execution.checkpoint_file import garbled, kept, read_checkpoint
from cpcal.solver.execution.executors import Here, Place, Processes
from cpcal.solver.execution.outcomes import LostWorkerError, outcomes
from cpcal.solver.execution.stopping import Stopped, asked
from cpcal.solver.execution.threads import linear_algebra_on_one_thread
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.minimum import Bracket

# ------------------------------------------------------------------------------------------------------------------
# What a run of `certify` keeps on disk while it works, so that another one can go on from there.
#
# Two files a leg, in the folder `checkpoint` of the run: `legN.answer` once the leg is answered, with its certificates;
# before that `legN.search`, where its branch and bound stands. Whoever works on the leg writes them.

FOLDER = "checkpoint"
_LIMITS = {"legs": None, "time_limit": None, "node_limit": None, "tolerance": None}  # change no bracket
_LOGGER = logging.getLogger("cpcal")

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Checkpoints:
    """The folder, and what its files are of: they are refused for anything else. `resume`: what is there counts."""

    folder: Path
    of: Mapping[str, str]
    resume: bool = False

    @classmethod
    def for_run(cls, run: Path, question: Question, *, resume: bool) -> Checkpoints:
        """Those in the folder of a run. Limits may change between a run and the one that goes on with it."""
        campaign, options = question.campaign, question.options
        asked = replace(options, **_LIMITS) if options.method == "bound" else options  # type: ignore[arg-type]
        text = json.dumps(encoded(asked), sort_keys=True)
        of = {
            "version": __version__,
            "campaign": campaign_sha256(campaign),
            "options": hashlib.sha256(text.encode()).hexdigest(),
            "model": _model_digest(campaign, question.model),
        }
        return cls(run / FOLDER, of, resume)

    def begin(self) -> None:
        """Forget what is there, unless it is to be resumed. Raises InputError when a file there is refused."""
        if not self.resume:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        for path in sorted(self.folder.glob("leg*")) if self.folder.is_dir() else []:
            read_checkpoint(path, self._of(path.name))

    def end_after(self, result: Result) -> None:
        """The result is in its place: what was kept goes, unless a stop or a limit left something to go on with."""
        if not result.interrupted and not any(self.folder.glob("*.search")):
            shutil.rmtree(self.folder, ignore_errors=True)

    def answer(self, leg: int) -> tuple[LegResult, dict[str, bytes]] | None:
        """The leg, if it is answered already, and its certificates. Raises InputError."""
        path = self._path(leg, "answer")
        if not (self.resume and path.exists()):
            return None
        first, *rest = read_checkpoint(path, self._of(path.name))
        try:
            files = {str(line["file"]): str(line["text"]).encode() for line in rest}
            return decoded(LegResult, first["leg"]), files
        except (KeyError, ValueError, CpcalError) as error:
            raise garbled(path, error) from None

    def keep_answer(self, leg: LegResult, files: Files) -> None:
        """The leg is answered: that is kept, and where its search stood no longer matters."""
        path = self._path(leg.leg, "answer")
        lines = [{"leg": encoded(leg)}, *({"file": name, "text": text.decode()} for name, text in files.items())]
        if kept(path, self._of(path.name), lines):
            self._path(leg.leg, "search").unlink(missing_ok=True)
            _LOGGER.info("kept", extra={"fields": {"leg": leg.leg, "eps_lo": leg.bracket.lo, "eps_hi": leg.bracket.hi}})

    def search_keeper(self, leg: int, recording: Recording | None) -> SearchKeeper:
        """What keeps where the search for a leg stands."""
        path = self._path(leg, "search")
        return SearchKeeper(path, self._of(path.name), recording, resume=self.resume)

    def _path(self, leg: int, kind: str) -> Path:
        return self.folder / f"leg{leg}.{kind}"

    def _of(self, name: str) -> dict[str, str]:
        return {**self.of, "part": name}


def _model_digest(campaign: Campaign, model: LegModel) -> str:
    """Of its name and parameters and, where it is a user's, of the equations that it makes of every leg: a function
    that was edited between two runs keeps its name."""
    text = json.dumps(encoded((model.name, model.summary, model.extra)), sort_keys=True)
    digest = hashlib.sha256(text.encode())
    if not built_in(model):
        box, engine = leg_box(np.zeros(len(model.parameters)), 0.0, model), get_arithmetic("float64")
        for leg in range(1, campaign.legs + 1):
            digest.update(leg_network(campaign, leg, box, engine=engine, model=model).digest.encode())
    return digest.hexdigest()


Progress = Callable[[int, Bracket], None]


@dataclass(frozen=True, kw_only=True)
class Question:
    """Options, and what they are asked of. `certificates`: the folder for them; `prefix`: of their names.

    `whole`: ranges and projections too. `checkpoints`: where what is done is kept meanwhile. `place`: where boxes of a
    search are decided; None: here.
    """

    campaign: Campaign
    options: Options
    model: LegModel = PLAIN
    certificates: Path | None = None
    prefix: str = ""
    whole: bool = False
    progress: Progress | None = None
    checkpoints: Checkpoints | None = None
    place: Place | None = None

    @property
    def engine(self) -> Arithmetic:
        return get_arithmetic(self.options.arithmetic)

    @property
    def limits(self) -> Limits:
        return Limits(seconds=self.options.time_limit, nodes=self.options.node_limit, gap=self.options.gap)

    def named(self, network: ConstraintNetwork) -> list[tuple[str, Contractor]]:
        """The contractors asked for, with their names."""
        names = self.options.contractors
        parts = plugins.build_each(network, names, objective="eps", arithmetic=self.options.arithmetic)
        return list(zip(names, parts, strict=True))

    def center(self, leg: int) -> Floats:
        """All parameters of the model (n,); the extra ones are 0 but in the model's own fit."""
        if self.options.center == "fit":
            return fit_model(self.campaign, leg, self.model)
        plain = self.options.center == "plain"
        known = fit_model(self.campaign, leg) if plain else nominal(self.campaign, leg)
        return np.append(known, np.zeros(len(self.model.extra)))

    def statement(self, leg: int, domain: Box, only: tuple[int, ...] | None = None) -> Statement | None:
        """What a certificate would say; None where there can be none."""
        return model_statement(self.campaign, leg, self.model, domain, only)

    def certificate(self, leg: int, kind: str = "") -> Path:
        assert self.certificates is not None
        return self.certificates / f"{self.prefix}leg{leg}{kind}.cert.jsonl"

    def network(self, leg: int, center: Floats) -> ConstraintNetwork:
        box, eps = leg_box(center, self.options.delta, self.model), self.options.eps
        # A leg is longer than eps, which bounds eps.
        longest = float(np.nextafter(np.min(self.campaign.length[:, leg - 1]) + box.hi[6], np.inf))
        domain = (0.0, max(longest, 0.0)) if eps is None else (eps, eps)
        return leg_network(self.campaign, leg, box, engine=self.engine, eps=domain, model=self.model)


def beyond_all_legs(question: Question, legs: Sequence[int]) -> list[Problem]:
    """An eps or a tolerance that is as large as the legs are long with any parameters of the box."""
    asked = {"eps": question.options.eps, "tolerance": question.options.tolerance}
    given = {what: error for what, error in asked.items() if error is not None}
    largest = {leg: float(question.center(leg)[6]) + question.options.delta for leg in legs} if given else {}
    return [
        problem
        for what, error in given.items()
        for leg, offset in largest.items()
        for problem in beyond_legs(question.campaign, leg, offset, error, what)
    ]


def nominal(campaign: Campaign, leg: int) -> Floats:
    robot, k = campaign.robot, leg - 1
    return np.concatenate([robot.base[k], robot.mobile[k], [robot.offset[k]]])


def absent_legs(campaign: Campaign, legs: Sequence[int] | None) -> list[Problem]:
    """Legs that the campaign has not."""
    remedy = f"choose from 1 to {campaign.legs}"
    numbers = [leg for leg in legs or () if isinstance(leg, int)]  # what is no number the options refuse
    return [Problem("legs", f"there is no leg {leg}", remedy) for leg in numbers if not 1 <= leg <= campaign.legs]


# ------------------------------------------------------------------------------------------------------------------
# A question asked of each leg as a task of its own, here or wherever an executor does it.
#
# What travels is the question and the answer, with the files that prove it: a worker needs no folder of ours.

A = TypeVar("A")
T = TypeVar("T")

_RESUME, _AGAIN = "go on with --resume, which keeps what is answered", "run again"
HERE: Place = (Here(), 1)


@dataclass(frozen=True)
class TaskAnswer(Generic[A, T]):
    """What was found about one leg (or whatever was asked about), and the files that prove it, by name."""

    asked: A
    found: T
    files: Mapping[str, bytes]


def answers(
    question: Question, work: Callable[[Question, A], T], of: Sequence[A], place: Place = HERE
) -> Iterator[TaskAnswer[A, T]]:
    """`work(question, leg)` for each of `of`, as they are done; certificates are written aside and come as bytes.

    A single one is done here, and the boxes of its search are the tasks. Progress is told by work that is done here.
    When the process is asked to stop, those not begun are missing. Raises what the work raises, and InputError for a
    question that cannot travel.
    """
    kept = question.checkpoints is not None
    question, (executor, most) = placed(question, len(of), place)
    if not isinstance(executor, Here):
        question = replace(question, progress=None)
    if not isinstance(executor, Here | Processes):  # perhaps of another machine, without our folders
        question = replace(question, checkpoints=None)
    task = _Aside(work, question)
    for outcome in outcomes(executor, most, task, of):
        error = outcome.error
        if isinstance(error, PicklingError | AttributeError) and "pickle" in str(error).lower():
            remedy = "define it in a module that workers can import, or work here: leave out workers"
            raise InputError([Problem("model", f"cannot be sent to other processes ({error})", remedy)])
        if isinstance(error, LostWorkerError):
            about = getattr(outcome.task, "leg", outcome.task)
            raise LostWorkerError(f"leg {about}: {error}; {_RESUME if kept else _AGAIN}, perhaps with fewer workers")
        yield outcome.value


def placed(question: Question, count: int, place: Place) -> tuple[Question, Place]:
    """A question about so many legs, and where it is asked; about one it is here, and place is where boxes are decided.

    No process is begun for a search that closes in few boxes.
    """
    if count != 1 or isinstance(place[0], Here):
        return question, place
    return replace(question, place=place), HERE


@dataclass(frozen=True)
class _Aside(Generic[A, T]):
    """The work, with a folder of its own for certificates."""

    work: Callable[[Question, A], T]
    question: Question

    def __call__(self, asked_about: A) -> TaskAnswer[A, T]:
        reason = asked()
        if reason is not None:
            raise Stopped(reason)
        with linear_algebra_on_one_thread():
            return self._answer(asked_about)

    def _answer(self, asked_about: A) -> TaskAnswer[A, T]:
        if self.question.certificates is None:
            return TaskAnswer(asked_about, self.work(self.question, asked_about), {})
        with scratch_folder() as folder:
            found = self.work(replace(self.question, certificates=folder), asked_about)
            files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        return TaskAnswer(asked_about, found, files)


# ------------------------------------------------------------------------------------------------------------------
# The leg model of a question: from the caller, by name or as an object, or from the campaign.


def chosen_model(
    campaign: Campaign, model: str | LegModel | None, half_widths: Mapping[str, float] | None
) -> tuple[LegModel, list[Problem]]:
    """The model with its half-widths, and what is wrong with the choice; it is the plain one then.

    The campaign's half-widths count where its model is the one that is asked for.
    """
    asked = campaign.model
    if model is None:
        model = PLAIN.name if asked is None else asked.name
    try:
        found = leg_model(model)
    except InputError as error:
        return PLAIN, list(error.problems)
    stated = asked.half_widths if asked is not None and asked.name == found.name else {}
    widths = {**stated, **(half_widths or {})}
    problems = half_width_problems(found, widths)
    return (PLAIN, problems) if problems else (found.within(widths), [])
