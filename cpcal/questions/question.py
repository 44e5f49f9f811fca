"""What is asked of every leg alike: checked once, and then only handed down."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.codec import encoded
from cpcal.common.errors import InputError, Problems, refuse
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.models import PLAIN, LegModel, beyond_legs, built_in, fit_model, leg_box, leg_model, leg_network
from cpcal.questions.result import Options
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Limits
from cpcal.solver.execution.checkpoint_file import Checkpoints
from cpcal.solver.execution.executors import Place
from cpcal.solver.optimize.bound import Bracket

_LIMITS = {"legs": None, "time_limit": None, "node_limit": None, "tolerance": None}  # change no bracket
Progress = Callable[[int, Bracket], None]


class Question(NamedTuple):
    """Options, and what they are asked of.

    certificates  of the leg at work, by the names of their files; None: none are asked for
    checkpoints   where its search is kept meanwhile
    place         where boxes of a search are decided; None: here
    centers       of the boxes of legs, where they are known
    """

    campaign: Campaign
    options: Options
    model: LegModel = PLAIN
    certificates: dict[str, bytes] | None = None
    progress: Progress | None = None
    checkpoints: Checkpoints | None = None
    place: Place | None = None
    centers: Mapping[int, Floats] | None = None

    @property
    def legs(self) -> Sequence[int]:
        return self.options.legs or range(1, self.campaign.legs + 1)

    @property
    def limits(self) -> Limits:
        return Limits(seconds=self.options.time_limit, nodes=self.options.node_limit, gap=self.options.gap)

    @property
    def identity(self) -> dict[str, str]:
        """What its checkpoints are of. Limits may change between a run and the one that goes on with it."""
        campaign, options, model = self.campaign, self.options, self.model
        asked = replace(options, **_LIMITS) if options.method == "bound" else options  # type: ignore[arg-type]
        # of a user-defined model its equations count: a function that was edited between two runs keeps its name
        box, legs = leg_box(np.zeros(len(model.parameters)), 0.0, model), range(1, campaign.legs + 1)
        equations = [] if built_in(model) else [leg_network(campaign, leg, box, model=model).digest for leg in legs]
        parts = {"options": encoded(asked), "model": [encoded((model.name, model.summary, model.extra)), *equations]}
        texts = {name: json.dumps(value, sort_keys=True) for name, value in parts.items()}
        digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
        return {"version": __version__, "campaign": campaign_sha256(campaign), **digests}

    def center(self, leg: int) -> Floats:
        """All parameters of the model (n,); the extra ones are 0 but in the model's own fit."""
        if self.centers and leg in self.centers:
            return self.centers[leg]
        if self.options.center == "fit":
            return fit_model(self.campaign, leg, self.model)
        plain = self.options.center == "plain"
        known = fit_model(self.campaign, leg) if plain else self.campaign.robot.parameters[leg - 1]
        return np.append(known, np.zeros(len(self.model.extra)))


COMPARED = ("plain", "gain", "lateral")
_CENTERS = ("plain", "nominal")  # the same for all models, whatever their own fits


def question_of(campaign: Campaign, *, progress: Progress | None = None, **given: Any) -> Question:
    """What is asked with the options that are `given`, if this campaign can be asked it.

    Raises InputError with every problem at once; PluginError for a contractor that is not there.
    """
    wanted, wrong = given.get("model"), given.get("outliers", 0)
    problems = Problems()
    with problems.kept():
        model = chosen_model(campaign, wanted, given.get("half_widths"))
    for leg in given.get("legs") or ():
        if isinstance(leg, int) and not 1 <= leg <= campaign.legs:  # what is no number the options refuse
            problems.wrong("legs", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}")
    if isinstance(wrong, int) and wrong >= len(campaign):
        what, below = f"{wrong} is no number of measurements that may be wrong", f"below {len(campaign)}, such as 1"
        problems.wrong("outliers", what, f"give a whole number {below}")
    with problems.kept():
        options = Options(**given | {"model": wanted.name if isinstance(wanted, LegModel) else wanted})
    problems.raise_any()
    plugins.check_names(options.contractors)
    question = Question(campaign=campaign, options=options, model=model, progress=progress)
    asked = {what: error for what in ("eps", "tolerance") if (error := getattr(options, what)) is not None}
    centers = {leg: question.center(leg) for leg in question.legs} if asked else {}
    beyond = [
        problem
        for what, error in asked.items()
        for leg, center in centers.items()
        for problem in beyond_legs(campaign, leg, float(center[6]) + options.delta, error, what)
    ]
    if beyond:
        raise InputError(beyond)
    return question._replace(centers=centers)


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
    return found.within({**stated, **(half_widths or {})})


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
    problems, questions = Problems(), []
    with problems.kept():
        refuse(
            (not names, "models", "none is named", f"name some, such as {', '.join(COMPARED)}"),
            (len(set(names)) < len(names), "models", "one is named twice", "name each once"),
            *(
                (name not in names, "half_widths", f"{name!r} is not compared", f"models are {listed}")
                for name in widths
            ),
            (center not in _CENTERS, "center", f"{center!r} is not common to all models", f"use {centers}"),
        )
    for name, model in zip(names, models, strict=True):
        with problems.kept():
            questions.append(question_of(campaign, model=model, half_widths=widths.get(name, {}), **given))
    problems.raise_any()
    return questions
