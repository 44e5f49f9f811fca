"""The named problems: legs of simulated DeltaLab campaigns, and the cables of the Hangprinter.

    leg5-e10-n704-d100     leg 5, joint error 10 mm, 704 measurements, box of half-width 100 mm, exact readings
    leg5-e10-n704-d100-u   the same with the readings' uncertainty (3 standard deviations)
    cable-a-linear         anchor anywhere within 4 m; needs `--data`
    FAMILY:ARGUMENTS       of another package, by the entry point `cpcal.benchmark_problems`

Everything follows from the name, so that a process of its own can make the problem again.
"""

from __future__ import annotations

import re
import runpy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

import cpcal
from cpcal.common.values import Floats
from cpcal.models import fit_model, leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork

GROUP = "cpcal.benchmark_problems"
SEED = 1
POSES = 64
CABLES = tuple(f"cable-{cable}-{model}" for model in ("linear", "quadratic") for cable in "abcd")

_LEG = re.compile(r"leg([1-6])-e([\d.]+)-n(\d+)-d([\d.]+)(-u)?")
_EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "hangprinter.py"


class PosedProblem(Protocol):
    """A constraint set whose smallest `eps` is sought; `start` is where a first fit may begin."""

    @property
    def measurements(self) -> int: ...

    @property
    def start(self) -> Floats | None: ...

    def network(self, eps: float | None = None) -> ConstraintNetwork:
        """The constraints, with the variable "eps" free or at a value."""
        ...


@dataclass(frozen=True)
class Leg:
    """One leg of a campaign that everything can be known of."""

    name: str
    leg: int
    joint_error: float
    measurements: int
    delta: float
    uncertain: bool

    @classmethod
    def named(cls, name: str) -> Leg | None:
        if (match := _LEG.fullmatch(name)) is None:
            return None
        leg, error, count, delta, uncertain = match.groups()
        if int(count) % POSES:
            raise ValueError(f"{name}: the number of measurements is a multiple of {POSES}")
        return cls(name, int(leg), float(error), int(count), float(delta), uncertain is not None)

    @cached_property
    def campaign(self) -> Campaign:
        factor = 3.0 if self.uncertain else 0.0
        return cpcal.simulate(seed=SEED, joint_error=self.joint_error, factor=factor, runs=self.measurements // POSES)

    @cached_property
    def middle(self) -> Floats:
        """The least-squares fit: the middle of the box."""
        return fit_model(self.campaign, self.leg)

    @property
    def start(self) -> Floats:
        return np.append(self.middle, 0.0)

    @property
    def box(self) -> Box:
        return leg_box(self.middle, self.delta)

    @property
    def longest(self) -> float:
        """A leg is longer than eps, which bounds eps."""
        shortest = float(np.min(self.campaign.length[:, self.leg - 1]))
        return max(float(np.nextafter(shortest + self.box.hi[6], np.inf)), 0.0)

    def network(self, eps: float | None = None) -> ConstraintNetwork:
        domain = (0.0, self.longest) if eps is None else (eps, eps)
        return leg_network(self.campaign, self.leg, self.box, eps=domain)


@dataclass(frozen=True)
class Cable:
    """One cable of docs/examples/hangprinter.py; `data` is the folder of the real measurements."""

    name: str
    data: Path
    start = None

    @cached_property
    def _readings(self) -> tuple[Floats, Floats]:
        position, angle = runpy.run_path(str(_EXAMPLE))["load"](self.data / "hangprinter" / "samples.csv")
        return position, angle

    @property
    def measurements(self) -> int:
        return len(self._readings[0])

    def network(self, eps: float | None = None) -> ConstraintNetwork:
        position, angle = self._readings
        _, cable, model = self.name.split("-")
        build = runpy.run_path(str(_EXAMPLE))["cable_network"]
        net: cpcal.Network
        net, error = build(position, angle[:, "abcd".index(cable)], quadratic=model == "quadratic")
        if eps is not None:
            net.add(error.within((eps, eps)))
        return net


def problem(name: str, data: Path | None = None) -> PosedProblem:
    """The problem of that name. Raises ValueError, PluginError; for a cable without `data`, FileNotFoundError."""
    if (leg := Leg.named(name)) is not None:
        return leg
    family, _, arguments = name.partition(":")
    if family in plugins.found(GROUP):
        provided: PosedProblem = plugins.load(family, GROUP)(arguments, data)
        return provided
    if name not in CABLES:
        others = "".join(f", {other}:..." for other in plugins.found(GROUP))
        known = f"legs are named like leg1-e1-n64-d100, cables {CABLES[0]}{others}"
        raise ValueError(f"no problem is called {name!r}; {known}")
    if data is None or not (data / "hangprinter" / "samples.csv").is_file():
        raise FileNotFoundError("needs --data with the folder that holds hangprinter/samples.csv")
    return Cable(name, data)
