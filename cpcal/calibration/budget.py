"""The uncertainty budget of a calibration (GUM), and its check by Monte Carlo (GUM Supplement 1).

Repeats show noise. What all of them share they cannot show: a wrong scale of the camera or of its target, a lens whose
distortion is not quite known, thermal expansion, a wrong scale of the leg sensors. `Inputs` holds the standard
uncertainties of these, which the user knows from certificates and from the room. Each is propagated to the joint
parameters in their own frames by fitting the readings that it would have made, and the squares of all contributions
add up.

A set-up with a single camera has no length of its own: scale of camera, of target and of the leg sensors are one and
the same to it, and the only length that it knows is the target's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from cpcal.calibration.alignment import in_own_frame, own_frame_covariance
from cpcal.calibration.fit import Fit, fit
from cpcal.calibration.leg_equations import Noise
from cpcal.calibration.study_calibration import StudyCalibration
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot import Campaign, normalised, quaternion_from_rotation_vector, quaternion_product

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
        known = [field.name for field in fields(cls)]
        problems = [Problem("budget", f"has no input {name!r}", f"known: {', '.join(known)}") for name in values]
        problems = [problem for problem, name in zip(problems, values, strict=True) if name not in known]
        for name, value in values.items():
            if name in known and not (math.isfinite(value) and value >= 0.0):
                problems.append(Problem(f"budget {name}", f"is {value}", "give a standard uncertainty >= 0"))
        if problems:
            raise InputError(problems)
        return cls(**values)


@dataclass(frozen=True)
class Contribution:
    """Of one source to the joint parameters in their own frames, mm: root mean square over all, and the largest."""

    source: str
    uncertainty: float
    rms: float
    largest: float


@dataclass(frozen=True)
class Budget:
    """Contributions, and what they come to: combined standard uncertainties u_c; U = 2 u_c.

    inputs     what was stated
    expanded   (n, 7) mm: U of each parameter in its own frame
    """

    inputs: Inputs
    contributions: tuple[Contribution, ...]
    expanded: tuple[tuple[float, ...], ...]
    rms: float
    largest: float

    @property
    def sentence(self) -> str:
        """The expanded uncertainty, and what is not in it."""
        absent = [one.source for one in self.contributions if one.uncertainty == 0.0 and one.source in _SOURCES]
        missing = f" Not in it, as nothing was stated: {', '.join(absent)}." if absent else ""
        return (
            f"Uncertainty budget: the parameters in their own frames are known to U = {2.0 * self.largest:.2g} mm at "
            f"most and {2.0 * self.rms:.2g} mm on average (k = 2).{missing} A single camera has no length of its own: "
            "its scale, the target's and the sensors' cannot be told apart by these readings."
        )


def budget(found: StudyCalibration, inputs: Inputs) -> Budget:
    """Of x_c_sigma, with what the fit itself states of noise or residuals."""
    best = found.x_c_sigma
    statistical = _sigmas(best, best.covariance)
    columns = [("repeats and residuals", math.nan, statistical)]
    for source, size in _SOURCES.items():
        uncertainty = getattr(inputs, source)
        columns.append((source, uncertainty, size(found, uncertainty)))
    total = np.sqrt(sum((values**2 for _, _, values in columns), np.zeros_like(statistical)))
    rows = tuple(Contribution(name, u, _rms(values), float(values.max())) for name, u, values in columns)
    expanded = tuple(tuple(row) for row in (2.0 * total).tolist())
    return Budget(inputs, rows, expanded, _rms(total), float(total.max()))


@dataclass(frozen=True)
class MonteCarlo:
    """Half the 95 % intervals of the parameters in their own frames over simulated studies, mm, beside U of the budget.

    inside   share of the parameters whose U agrees with it to within a fifth
    """

    trials: int
    rms: float
    largest: float
    inside: float

    @property
    def sentence(self) -> str:
        """What the simulated studies say of U."""
        return (
            f"Monte Carlo (GUM Supplement 1, {self.trials} studies): half of the 95 % intervals is {self.largest:.2g} "
            f"mm at most and {self.rms:.2g} mm on average; it agrees with U to within a fifth for "
            f"{100 * self.inside:.0f} % of the parameters."
        )


def monte_carlo(found: StudyCalibration, inputs: Inputs, *, trials: int, seed: int = 0) -> MonteCarlo:
    """Readings drawn with the noise of camera and sensors and with the inputs' errors, each set fitted anew.

    Raises InputError for fewer than 20 trials.
    """
    if trials < _TRIALS_MIN:
        raise InputError([Problem("option trials", f"has no meaning: {trials}", f"give {_TRIALS_MIN} or more")])
    stream, best = np.random.default_rng(seed), found.x_c_sigma
    exact = _consistent(found.campaign, best)
    noise = best.noise
    assert noise is not None  # x_c_sigma is weighted by it
    drawn = []
    for _ in range(trials):
        shifted = _disturbed(_noisy(exact, noise, stream), inputs, stream)
        again = fit(shifted, weights="joint", noise=noise, start=best.parameters, covariance="noise")
        drawn.append(in_own_frame(again.parameters))
    low, high = np.quantile(np.array(drawn), [0.025, 0.975], axis=0)
    half, stated = 0.5 * (high - low), _total(found, inputs)
    free = stated > 0.0
    near = np.abs(half[free] - 2.0 * stated[free]) <= 0.2 * 2.0 * stated[free]
    return MonteCarlo(trials, _rms(half[free]), float(half.max()), float(np.mean(near)))


def _total(found: StudyCalibration, inputs: Inputs) -> Floats:
    """(n, 7) combined standard uncertainties in the own frames, mm: of the noise, as the simulated studies have it."""
    best = found.x_c_sigma
    squares = _sigmas(best, replace(best, source="noise").covariance) ** 2
    for source, size in _SOURCES.items():
        squares = squares + size(found, getattr(inputs, source)) ** 2
    total = np.sqrt(squares)
    return np.asarray(np.where(total > 1e-9, total, 0.0))


def _sigmas(best: Fit, covariance: Floats) -> Floats:
    """(n, 7) standard uncertainties in the own frames."""
    variance = np.diagonal(own_frame_covariance(best.parameters, covariance))
    return np.sqrt(np.maximum(variance, 0.0)).reshape(best.parameters.shape)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _refitted(found: StudyCalibration, campaign: Campaign) -> Floats:
    """(n, 7) by how much the parameters in their own frames change with these readings."""
    best = found.x_c_sigma
    again = fit(campaign, weights="joint", noise=best.noise, start=best.parameters, covariance="noise")
    return np.abs(in_own_frame(again.parameters) - in_own_frame(best.parameters))


def _scale_of_poses(found: StudyCalibration, size: float) -> Floats:
    campaign = found.campaign
    if size == 0.0:
        return np.zeros_like(found.x_c_sigma.parameters)
    return _refitted(found, replace(campaign, position=campaign.position * (1.0 + size)))


def _scale_of_sensors(found: StudyCalibration, size: float) -> Floats:
    """Each leg by itself: squares add up."""
    campaign, total = found.campaign, np.zeros_like(found.x_c_sigma.parameters)
    for leg in range(campaign.legs if size else 0):
        length = campaign.length.copy()
        length[:, leg] *= 1.0 + size
        total += _refitted(found, replace(campaign, length=length)) ** 2
    return np.asarray(np.sqrt(total))


def _lens(found: StudyCalibration, size: float) -> Floats:
    best, campaign = found.x_c_sigma, found.campaign
    if size == 0.0:
        return np.zeros_like(best.parameters)
    zeros = np.zeros(campaign.legs)
    only = Noise.from_sigmas([size] * 3, [0.0] * 3, zeros, count=len(campaign))
    return _sigmas(best, replace(best, noise=only, source="noise").covariance)


def _temperature(found: StudyCalibration, size: float) -> Floats:
    return _scale_of_poses(found, _EXPANSION * size)


_SOURCES = {
    "camera_scale": _scale_of_poses,
    "target_scale": _scale_of_poses,
    "lens": _lens,
    "sensor_scale": _scale_of_sensors,
    "temperature": _temperature,
}


def _consistent(campaign: Campaign, best: Fit) -> Campaign:
    """The campaign's poses with the readings that the fitted legs would have there."""
    return replace(campaign, length=campaign.length + best.estimate.equations.values(best.parameters))


def _noisy(campaign: Campaign, noise: Noise, stream: np.random.Generator) -> Campaign:
    values, axes = np.linalg.eigh(noise.pose)
    root = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    step = np.einsum("kij,kj->ki", root, stream.standard_normal((len(campaign), 6)))
    read = np.einsum("kij,kj->ki", noise.length_root, stream.standard_normal(campaign.length.shape))
    turned = quaternion_product(quaternion_from_rotation_vector(step[:, 3:]), campaign.quaternion)
    return replace(
        campaign,
        position=campaign.position + step[:, :3],
        quaternion=normalised(turned),
        length=campaign.length + read,
    )


def _disturbed(campaign: Campaign, inputs: Inputs, stream: np.random.Generator) -> Campaign:
    scales = (inputs.camera_scale, inputs.target_scale, _EXPANSION * inputs.temperature)
    scale = 1.0 + float(np.array(scales) @ stream.standard_normal(3))
    lens = inputs.lens * stream.standard_normal(campaign.position.shape)
    sensors = 1.0 + inputs.sensor_scale * stream.standard_normal(campaign.legs)
    return replace(campaign, position=campaign.position * scale + lens, length=campaign.length * sensors)
