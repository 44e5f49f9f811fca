"""The uncertainty budget of a calibration (GUM).

Repeats show noise. What all of them share they cannot show: a wrong scale of the camera or of its target, a lens whose
distortion is not quite known, thermal expansion, a wrong scale of the leg sensors. `Inputs` holds the standard
uncertainties of these, which the user knows from certificates and from the room. Each is propagated to the joint
parameters, laid on the drawing, by fitting the readings that it would have made, and the squares of all contributions
add up.

A set-up with a single camera has no length of its own: scale of camera, of target and of the leg sensors are one and
the same to it, and the only length that it knows is the target's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpcal.calibration.fit import Fit, Noise, fit
from cpcal.calibration.frames import on_drawing, on_drawing_errors
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot import Campaign, Robot

_EXPANSION = 1.2e-5  # 1/K, of steel


@dataclass(frozen=True)
class Inputs:
    """Standard uncertainties of what all readings share; 0: none, or not known.

    camera_scale   relative, of the distances that the camera gives (its focal length)
    target_scale   relative, of the target's dots
    lens           mm: of a position by the rest of the distortion, from configuration to configuration
    sensor_scale   relative, of each leg's sensor
    temperature    K: between target and robot, or robot and drawing; with the expansion of steel
    """

    camera_scale: float = 0.0
    target_scale: float = 0.0
    lens: float = 0.0
    sensor_scale: float = 0.0
    temperature: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError for what is no standard uncertainty."""
        wrong = [(name, value) for name, value in vars(self).items() if not 0.0 <= value < math.inf]
        if wrong:
            remedy = "give a standard uncertainty >= 0"
            raise InputError([Problem(f"budget {name}", f"is {value}", remedy) for name, value in wrong])


@dataclass(frozen=True)
class Contribution:
    """Of one source to the joint parameters laid on the drawing, mm: root mean square over all, and the largest."""

    source: str
    uncertainty: float
    rms: float
    largest: float


@dataclass(frozen=True)
class Budget:
    """Contributions, and what they come to: combined standard uncertainties u_c; U = 2 u_c.

    inputs       what was stated
    expanded     (n, 7) mm: U of each parameter, laid on the drawing
    """

    inputs: Inputs
    contributions: tuple[Contribution, ...]
    expanded: tuple[tuple[float, ...], ...]
    rms: float
    largest: float

    @property
    def sentence(self) -> str:
        """The expanded uncertainty, and what is not in it."""
        absent = [one.source for one in self.contributions[1:] if one.uncertainty == 0.0]
        missing = f" Not in it, as nothing was stated: {', '.join(absent)}." if absent else ""
        return (
            f"Uncertainty budget: the parameters, laid on the drawing, are known to U = {2.0 * self.largest:.2g} mm at "
            f"most and {2.0 * self.rms:.2g} mm on average (k = 2).{missing} A single camera has no length of its own: "
            "its scale, the target's and the sensors' cannot be told apart by these readings."
        )


def budget(best: Fit, campaign: Campaign, drawing: Robot, inputs: Inputs) -> Budget:
    """Of x_c_sigma of a campaign, with what the fit itself states of noise or residuals."""
    laid, nothing = on_drawing(best.parameters, drawing), np.zeros_like(best.parameters)

    def errors(found: Fit) -> Floats:
        """(n, 7) standard uncertainties of the parameters laid on the drawing."""
        return on_drawing_errors(found.parameters, found.covariance, drawing)

    def refitted(**readings: Any) -> Floats:
        """(n, 7) the parameters of other readings, laid on the drawing."""
        other = replace(campaign, **readings)
        again = fit(other, weighted=True, noise=best.noise, start=best.parameters, covariance="noise")
        return on_drawing(again.parameters, drawing)

    def scaled(share: float) -> Floats:
        return np.abs(refitted(position=campaign.position * (1.0 + share)) - laid) if share else nothing

    def sensors(share: float) -> Floats:
        """Each leg by itself: squares add up."""
        legs = np.eye(campaign.legs)[: campaign.legs if share else 0]
        each = (refitted(length=campaign.length * (1.0 + share * leg)) - laid for leg in legs)
        return np.asarray(np.sqrt(sum((change**2 for change in each), nothing)))

    def lens(size: float) -> Floats:
        if not size:
            return nothing
        only = Noise.from_sigmas([size] * 3, [0.0] * 3, np.zeros(campaign.legs), count=len(campaign))
        return errors(replace(best, noise=only, source="noise"))

    stated = {
        "camera_scale": scaled(inputs.camera_scale),
        "target_scale": scaled(inputs.target_scale),
        "lens": lens(inputs.lens),
        "sensor_scale": sensors(inputs.sensor_scale),
        "temperature": scaled(_EXPANSION * inputs.temperature),
    }
    shared = sum((values**2 for values in stated.values()), nothing)
    statistical = errors(best)
    total = np.sqrt(statistical**2 + shared)
    columns = {"repeats and residuals": (math.nan, statistical)}
    columns |= {source: (getattr(inputs, source), values) for source, values in stated.items()}
    rows = tuple(Contribution(name, u, _rms(values), float(values.max())) for name, (u, values) in columns.items())
    expanded = tuple(tuple(row) for row in (2.0 * total).tolist())
    return Budget(inputs, rows, expanded, _rms(total), float(total.max()))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
