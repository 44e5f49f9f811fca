"""The uncertainty budget of a calibration (GUM), and its check by Monte Carlo (GUM Supplement 1).

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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from cpcal.calibration.fit import Fit, Noise, fit, root
from cpcal.calibration.frames import on_drawing, on_drawing_errors
from cpcal.common.errors import InputError, Problem, unusable
from cpcal.common.values import Floats
from cpcal.robot import Campaign, Pose, Robot

_EXPANSION = 1.2e-5  # 1/K, of steel
_TRIALS_MIN = 20


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

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Inputs:
        """From names and numbers. Raises InputError for other names, and for what is no standard uncertainty."""
        known, problems = [field.name for field in fields(cls)], []
        for name, value in values.items():
            if name not in known:
                problems.append(Problem("budget", f"has no input {name!r}", f"known: {', '.join(known)}"))
            elif not (math.isfinite(value) and value >= 0.0):
                problems.append(Problem(f"budget {name}", f"is {value}", "give a standard uncertainty >= 0"))
        if problems:
            raise InputError(problems)
        return cls(**values)


@dataclass(frozen=True)
class Contribution:
    """Of one source to the joint parameters laid on the drawing, mm: root mean square over all, and the largest."""

    source: str
    uncertainty: float
    rms: float
    largest: float


@dataclass(frozen=True)
class MonteCarlo:
    """Half the 95 % intervals of the parameters over simulated studies, mm, beside U of the budget.

    inside   share of the parameters whose U agrees with it to within a fifth
    """

    trials: int
    rms: float
    largest: float
    inside: float


@dataclass(frozen=True)
class Budget:
    """Contributions, and what they come to: combined standard uncertainties u_c; U = 2 u_c.

    inputs       what was stated
    expanded     (n, 7) mm: U of each parameter, laid on the drawing
    monte_carlo  its check, where that was asked for
    """

    inputs: Inputs
    contributions: tuple[Contribution, ...]
    expanded: tuple[tuple[float, ...], ...]
    rms: float
    largest: float
    monte_carlo: MonteCarlo | None = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """The expanded uncertainty, what is not in it, and what the simulated studies say of it."""
        absent = [one.source for one in self.contributions[1:] if one.uncertainty == 0.0]
        missing = f" Not in it, as nothing was stated: {', '.join(absent)}." if absent else ""
        said = (
            f"Uncertainty budget: the parameters, laid on the drawing, are known to U = {2.0 * self.largest:.2g} mm at "
            f"most and {2.0 * self.rms:.2g} mm on average (k = 2).{missing} A single camera has no length of its own: "
            "its scale, the target's and the sensors' cannot be told apart by these readings."
        )
        made = self.monte_carlo
        if made is None:
            return (said,)
        return (
            said,
            f"Monte Carlo (GUM Supplement 1, {made.trials} studies): half of the 95 % intervals is {made.largest:.2g} "
            f"mm at most and {made.rms:.2g} mm on average; it agrees with U to within a fifth for "
            f"{100 * made.inside:.0f} % of the parameters.",
        )


def budget(best: Fit, campaign: Campaign, drawing: Robot, inputs: Inputs, *, trials: int | None = None) -> Budget:
    """Of x_c_sigma of a campaign, with what the fit itself states of noise or residuals.

    trials   check U with so many simulated studies. Raises InputError for fewer than 20.
    """
    if trials is not None and trials < _TRIALS_MIN:
        raise unusable("option trials", f"has no meaning: {trials}", f"give {_TRIALS_MIN} or more")
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
    checked = None
    if trials is not None:
        by_noise = np.sqrt(errors(replace(best, source="noise")) ** 2 + shared)
        drawn = [refitted(**readings) for readings in _drawn_readings(best, campaign, inputs, trials)]
        checked = _compared(np.array(drawn), 2.0 * by_noise)
    expanded = tuple(tuple(row) for row in (2.0 * total).tolist())
    return Budget(inputs, rows, expanded, _rms(total), float(total.max()), checked)


def _drawn_readings(best: Fit, campaign: Campaign, inputs: Inputs, trials: int) -> Iterator[dict[str, Floats]]:
    """Readings with the noise of camera and sensors and with the inputs' errors."""
    stream, noise = np.random.default_rng(0), best.noise
    assert noise is not None  # x_c_sigma is weighted by it
    exact = campaign.length + best.equations.values(best.parameters)  # of the fitted legs at these poses
    roots = root(noise.pose)
    scales = np.array([inputs.camera_scale, inputs.target_scale, _EXPANSION * inputs.temperature])
    for _ in range(trials):
        step = np.einsum("kij,kj->ki", roots, stream.standard_normal((len(campaign), 6)))
        read = np.einsum("kij,kj->ki", noise.length_root, stream.standard_normal(exact.shape))
        seen = Pose(campaign.position, campaign.quaternion).moved(step)
        scale = 1.0 + float(scales @ stream.standard_normal(3))
        off = inputs.lens * stream.standard_normal(campaign.position.shape)
        sensors = 1.0 + inputs.sensor_scale * stream.standard_normal(campaign.legs)
        position = seen.position * scale + off
        yield {"position": position, "quaternion": seen.quaternion, "length": (exact + read) * sensors}


def _compared(drawn: Floats, expanded: Floats) -> MonteCarlo:
    """Parameters (trials, n, 7) of simulated studies beside U (n, 7)."""
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    half, free = 0.5 * (high - low), expanded > 1e-9
    near = np.abs(half[free] - expanded[free]) <= 0.2 * expanded[free]
    return MonteCarlo(len(drawn), _rms(half[free]), float(half.max()), float(np.mean(near)))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
