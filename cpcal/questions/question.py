"""What is asked of every leg alike, and what is kept on disk while it is answered."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.codec import decoded, encoded
from cpcal.common.errors import CpcalError, InputError, Problem, refuse, together
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
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
)
from cpcal.questions.result import LegResult, Options, Result
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Limits
from cpcal.solver.execution.checkpoint_file import garbled, kept, read_checkpoint
from cpcal.solver.execution.executors import Place
from cpcal.solver.optimize.bound import Bracket

# ------------------------------------------------------------------------------------------------------------------
# What a run of `certify` keeps on disk while it works, so that another one can go on from there.
#
# Two files a leg, in the folder `checkpoint` of the run: `legN.answer` once the leg is answered, with its certificates;
# before that `legN.search`, where its branch and bound stands. Whoever works on the leg writes them.

FOLDER = "checkpoint"
_LIMITS = {"legs": None, "time_limit": None, "node_limit": None, "tolerance": None}  # change no bracket


class Checkpoints(NamedTuple):
    """The folder, and what its files are of: they are refused for anything else. `resume`: what is there counts."""

    folder: Path
    of: Mapping[str, str]
    resume: bool = False

    @classmethod
    def for_run(cls, run: Path, question: Question, *, resume: bool) -> Checkpoints:
        """Those in the folder of a run. Limits may change between a run and the one that goes on with it."""
        campaign, options, model = question.campaign, question.options, question.model
        asked = replace(options, **_LIMITS) if options.method == "bound" else options  # type: ignore[arg-type]
        # of a user-defined model its equations count: a function that was edited between two runs keeps its name
        box, legs = leg_box(np.zeros(len(model.parameters)), 0.0, model), range(1, campaign.legs + 1)
        equations = [] if built_in(model) else [leg_network(campaign, leg, box, model=model).digest for leg in legs]
        of = {
            "version": __version__,
            "campaign": campaign_sha256(campaign),
            "options": _digest(encoded(asked)),
            "model": _digest([encoded((model.name, model.summary, model.extra)), *equations]),
        }
        return cls(run / FOLDER, of, resume)

    def begin(self) -> None:
        """Forget what is there, unless it is to be resumed. Raises InputError when a file there is refused."""
        if not self.resume:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        for path in sorted(self.folder.glob("leg*")) if self.folder.is_dir() else []:
            read_checkpoint(path, {**self.of, "part": path.name})

    def end_after(self, result: Result) -> None:
        """The result is in its place: what was kept goes, unless a stop or a limit left something to go on with."""
        if not result.interrupted and not any(self.folder.glob("*.search")):
            shutil.rmtree(self.folder, ignore_errors=True)

    def answer(self, leg: int) -> tuple[LegResult, dict[str, bytes]] | None:
        """The leg, if it is answered already, and its certificates. Raises InputError."""
        path, of = self.part(leg, "answer")
        if not (self.resume and path.exists()):
            return None
        first, *rest = read_checkpoint(path, of)
        try:
            files = {str(line["file"]): str(line["text"]).encode() for line in rest}
            return decoded(LegResult, first["leg"]), files
        except (KeyError, ValueError, CpcalError) as error:
            raise garbled(path, error) from None

    def keep_answer(self, leg: LegResult, files: Mapping[str, bytes]) -> None:
        """The leg is answered: that is kept, and where its search stood no longer matters."""
        path, of = self.part(leg.leg, "answer")
        if kept(path, of, [{"leg": encoded(leg)}, *({"file": n, "text": text.decode()} for n, text in files.items())]):
            self.part(leg.leg, "search")[0].unlink(missing_ok=True)

    def part(self, leg: int, kind: str) -> tuple[Path, dict[str, str]]:
        """A file, and what it is of."""
        path = self.folder / f"leg{leg}.{kind}"
        return path, {**self.of, "part": path.name}


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


# ------------------------------------------------------------------------------------------------------------------
# The question itself.

Progress = Callable[[int, Bracket], None]


class Question(NamedTuple):
    """Options, and what they are asked of. `certificates`: the folder for them.

    `checkpoints`: where what is done is kept meanwhile. `place`: where boxes of a search are decided; None: here.
    """

    campaign: Campaign
    options: Options
    model: LegModel = PLAIN
    certificates: Path | None = None
    progress: Progress | None = None
    checkpoints: Checkpoints | None = None
    place: Place | None = None

    @property
    def limits(self) -> Limits:
        return Limits(seconds=self.options.time_limit, nodes=self.options.node_limit, gap=self.options.gap)

    def center(self, leg: int) -> Floats:
        """All parameters of the model (n,); the extra ones are 0 but in the model's own fit."""
        if self.options.center == "fit":
            return fit_model(self.campaign, leg, self.model)
        plain = self.options.center == "plain"
        known = fit_model(self.campaign, leg) if plain else self.campaign.robot.parameters[leg - 1]
        return np.append(known, np.zeros(len(self.model.extra)))


def question_of(campaign: Campaign, *, progress: Progress | None = None, **given: Any) -> Question:
    """What is asked with the options that are `given`, if this campaign can be asked it.

    Raises InputError with every problem at once; PluginError for a contractor that is not there.
    """
    wanted, wrong = given.get("model"), given.get("outliers", 0)
    below = f"give a whole number below {len(campaign)}, such as 1"
    numbers = [leg for leg in given.get("legs") or () if isinstance(leg, int)]  # what is no number the options refuse
    model, _, options = together(
        partial(chosen_model, campaign, wanted, given.get("half_widths")),
        partial(
            refuse,
            *(
                (not 1 <= leg <= campaign.legs, "legs", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}")
                for leg in numbers
            ),
            (
                isinstance(wrong, int) and wrong >= len(campaign),
                "outliers",
                f"{wrong} is no number of measurements that may be wrong",
                below,
            ),
        ),
        partial(Options, **given | {"model": wanted.name if isinstance(wanted, LegModel) else wanted}),
    )
    plugins.check_names(options.contractors)
    return Question(campaign=campaign, options=options, model=model, progress=progress)


def chosen_model(
    campaign: Campaign, model: str | LegModel | None, half_widths: Mapping[str, float] | None = None
) -> LegModel:
    """The model with its half-widths. Raises InputError.

    Left out it is the campaign's; the campaign's half-widths count where its model is the one that is asked for.
    """
    asked = campaign.model
    if model is None:
        model = PLAIN.name if asked is None else asked.name
    found = leg_model(model)
    stated = asked.half_widths if asked is not None and asked.name == found.name else {}
    widths = {**stated, **(half_widths or {})}
    if problems := half_width_problems(found, widths):
        raise InputError(problems)
    return found.within(widths)


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
