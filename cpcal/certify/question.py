"""What is asked of every leg alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpcal.certify.checkpoints import Checkpoints
from cpcal.common.arrays import Floats
from cpcal.common.errors import Problem
from cpcal.execution.executors import Place
from cpcal.legs import PLAIN, LegModel, beyond_legs, fit_model, leg_box, leg_network, model_statement
from cpcal.results import Options
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.certificate.statement import Statement
from cpcal.solver.contract import Contractor
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.limits import Limits
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Bracket

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
