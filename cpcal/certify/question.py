"""What is asked of every leg alike, and what may not be asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.errors import InputError, Problem
from cpcal.legs import PLAIN, LegModel, fit_model, leg_box, leg_network, model_statement
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.certificate.statement import Statement
from cpcal.solver.contract import Contractor, Limits
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Bracket

Floats = npt.NDArray[np.float64]
Progress = Callable[[int, Bracket], None]

CENTERS = ("fit", "nominal", "plain")
SUPPORTS = ("few", "irreducible")
METHODS = ("bound", "timeout")


@dataclass(frozen=True)
class Question:
    """The arguments of `certify` that concern one leg as well as another."""

    campaign: Campaign
    delta: float
    center: str
    contractors: tuple[str, ...]
    engine: Arithmetic
    eps: float | None
    limits: Limits
    support: str
    method: str
    certificates: Path | None
    progress: Progress | None
    model: LegModel = PLAIN
    prefix: str = ""  # of the certificates' names

    def named(self, network: ConstraintNetwork) -> list[tuple[str, Contractor]]:
        """The contractors asked for, with their names."""
        parts = plugins.build_each(network, self.contractors, objective="eps", arithmetic=self.engine.name)
        return list(zip(self.contractors, parts, strict=True))

    def middle(self, leg: int) -> Floats:
        """All parameters of the model (n,); the extra ones are 0 but in the model's own fit."""
        if self.center == "fit":
            return fit_model(self.campaign, leg, self.model)
        known = fit_model(self.campaign, leg) if self.center == "plain" else nominal(self.campaign, leg)
        return np.append(known, np.zeros(len(self.model.extra)))

    def statement(self, leg: int, domain: Box, only: tuple[int, ...] | None = None) -> Statement | None:
        """What a certificate would say; None where there can be none."""
        return model_statement(self.campaign, leg, self.model, domain, only)

    def certificate(self, leg: int, kind: str = "") -> Path:
        assert self.certificates is not None
        return self.certificates / f"{self.prefix}leg{leg}{kind}.cert.jsonl"

    def network(self, leg: int, middle: Floats) -> ConstraintNetwork:
        box = leg_box(middle, self.delta, self.model)
        # A leg is longer than eps, which bounds eps.
        longest = float(np.nextafter(np.min(self.campaign.length[:, leg - 1]) + box.hi[6], np.inf))
        domain = (0.0, max(longest, 0.0)) if self.eps is None else (self.eps, self.eps)
        return leg_network(self.campaign, leg, box, engine=self.engine, eps=domain, model=self.model)


def nominal(campaign: Campaign, leg: int) -> Floats:
    robot, k = campaign.robot, leg - 1
    return np.concatenate([robot.base[k], robot.mobile[k], [robot.offset[k]]])


def check(
    campaign: Campaign,
    legs: Sequence[int] | None,
    delta: float,
    center: str,
    gap: float,
    time_limit: float | None,
    eps: float | None,
    support: str,
    method: str,
    others: Sequence[Problem] = (),
) -> None:
    """All problems with the options at once, and `others`."""
    wrong: list[Problem] = list(others)
    for leg in legs or ():
        if not 1 <= leg <= campaign.legs:
            wrong.append(Problem("legs", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}"))
    if legs is not None and len(set(legs)) < len(legs):
        wrong.append(Problem("legs", "a leg is named twice", "name each once"))
    if not (np.isfinite(delta) and delta >= 0.0):
        wrong.append(Problem("delta", f"{delta} is no half-width", "give a number of mm, 0 or more"))
    if center not in CENTERS:
        wrong.append(Problem("center", f"{center!r} is not known", f"use one of {', '.join(CENTERS)}"))
    if not 0.0 <= gap < 1.0:
        wrong.append(Problem("gap", f"{gap} is no relative gap", "give a number from 0 to below 1, such as 1e-6"))
    if time_limit is not None and not time_limit > 0.0:
        wrong.append(Problem("time_limit", f"{time_limit} is no time", "give a positive number of seconds"))
    if eps is not None and not (np.isfinite(eps) and eps >= 0.0):
        wrong.append(Problem("eps", f"{eps} is no tolerance", "give a number of mm, 0 or more"))
    if support not in SUPPORTS:
        wrong.append(Problem("support", f"{support!r} is not known", f"use one of {', '.join(SUPPORTS)}"))
    if method not in METHODS:
        wrong.append(Problem("method", f"{method!r} is not known", f"use one of {', '.join(METHODS)}"))
    if method == "timeout" and eps is not None:
        wrong.append(Problem("method", "timeout seeks the smallest eps", "leave eps out"))
    if method == "timeout" and time_limit is None:
        remedy = "give a number of seconds a leg, such as 60"
        wrong.append(Problem("time_limit", "is missing, and method timeout may go on for ever", remedy))
    if wrong:
        raise InputError(wrong)
