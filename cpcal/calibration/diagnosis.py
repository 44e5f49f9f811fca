"""Which mechanism, if any, the data name: one is named only where its own model explains them and the others do not.

Repeats name drift and play (repeatability.py). What they leave over in the means, of calibration and validation poses
together, is asked of models with one parameter more a leg (below): the model of the paper first, and if that
explains the readings, nothing is named. The extremal configurations alone have two lengths a leg, over which every
function of the length is a gain: other poses must be there to tell models apart.

A robot without imperfections should not be accused in any of 200 studies, so levels are stricter than those of words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.calibration.fit import LegEquations, Noise, chances, whitening
from cpcal.calibration.statistics import RUNS, VARIANCES, Tests, unusual
from cpcal.common.values import Floats
from cpcal.robot import Campaign
from cpcal.solver.optimize.least_squares import least_squares

# ------------------------------------------------------------------------------------------------------------------
# Fits with one parameter more a leg: does a gain of the sensor, a sag of the leg or a lateral offset explain the data?
#
#     ||v|| = L + l + c phi        phi, a column of N numbers for each leg, at the latest estimate:
#
#     "gain"     L less its mid-range               c: relative error of the sensor (mm/mm)
#     "sag"      -((L + l) / s)^7 sin^2(tilt)       c: mm by which the leg's own weight would bring its ends together if
#                                                   it lay flat with its mid-range length s
#     "lateral"  1 / (2 (L + l))                    c: mm^2, square of the distance of the joints from the actuator
#
# weighted by the noise of all legs together. All three are leg models of cpcal too: `compare` asks the same with
# proofs. Here a model *explains* the readings when its residuals are what the noise has them.

PLAIN, DRIFT, PLAY = "plain", "drift", "play"
_TOLERANCE = 1e-9
ACCUSED = 1e-4  # probability of naming something, test by test (repeats: all together), where all is well
_EXPLAINS = 1e-3  # probability of the residuals from which a model explains them
_PHYSICAL = 3.0  # standard errors by which a quantity that cannot be negative may be so
_ONE_SIGNED = ("sag", "lateral")
_LEVEL = np.radians(0.5)  # how level a base is: the standard deviation of the lean that "sag" may find of the vertical
_LEAN = 1e-5  # rad, of the difference quotients
_SEVENTH = 7  # the chord of a uniform beam on two hinges shortens with the seventh power of its length


@dataclass(frozen=True)
class Asked:
    """A model that was asked: a correction c of each leg, in the unit of its column, with standard errors, the range of
    what it adds over the poses (mm), and how likely its residuals are by noise alone."""

    name: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    size: tuple[float, ...]
    chance: float

    @property
    def explains(self) -> bool:
        """Whether its residuals are what noise makes, with parameters that can be."""
        possible = self.name not in _ONE_SIGNED or all(
            c > -_PHYSICAL * e for c, e in zip(self.values, self.errors, strict=True)
        )
        return possible and self.chance >= _EXPLAINS


Column = Callable[[LegEquations, Floats, Floats], Floats]


def corrected(equations: LegEquations, noise: Noise, up: Floats, start: Floats, name: str) -> Asked:
    """The fit with a correction of `COLUMNS`, or "plain", from the parameters (n, 7) of one without; `up`: (3,)."""
    legs = len(start)
    size, across = 7 + (name != PLAIN), np.linalg.svd(up[None])[2][1:]
    weight = whitening(noise.propagated(equations, start))

    def column(x: Floats, tilt: Floats) -> Floats:
        """phi (N, n) where the vertical leans by `tilt` (2,) rad."""
        leant = up + tilt @ across
        return COLUMNS[name](equations, x, leant / np.linalg.norm(leant)) if name in COLUMNS else 0.0 * equations.length

    def parts(at: Floats) -> tuple[Floats, Floats, Floats]:
        """x (n, 7), c (n,), tilt (2,)."""
        rows = at[:-2].reshape(legs, size)
        return rows[:, :7], rows[:, 7] if size > 7 else np.zeros(legs), at[-2:]

    def residual(at: Floats) -> Floats:
        x, c, tilt = parts(at)
        off = np.einsum("kij,kj->ki", weight, equations.values(x) - c * column(x, tilt))
        return np.concatenate([off.ravel(), tilt / _LEVEL])

    def jacobian(at: Floats) -> Floats:
        """phi counts as it is at x; only the lean moves it."""
        x, c, tilt = parts(at)
        phi = column(x, tilt)
        leaning = np.stack([-c * (column(x, tilt + step) - phi) / _LEAN for step in _LEAN * np.eye(2)], axis=-1)
        own = np.concatenate([equations.by_parameters(x), -phi[..., None]], axis=-1)[..., :size]
        design = (weight[..., None] * own[:, None]).reshape(-1, legs * size)  # rows by measurement, then leg
        leaning = np.einsum("kij,kjt->kit", weight, leaning).reshape(-1, 2)
        return np.block([[design, leaning], [np.zeros((2, legs * size)), np.eye(2) / _LEVEL]])

    first = np.concatenate([np.concatenate([start, np.zeros((legs, size - 7))], axis=1).ravel(), np.zeros(2)])
    found = least_squares(residual, jacobian, first, tolerance=_TOLERANCE)
    x, c, tilt = parts(found.at)
    freedom = equations.length.size - size * legs
    design = jacobian(found.at)
    errors = (
        np.sqrt(np.diagonal(np.linalg.pinv(design.T @ design))[7 : size * legs : 8]) if size > 7 else np.zeros(legs)
    )
    added = np.abs(c) * np.ptp(column(x, tilt), axis=0)
    chance = chances(found.cost, freedom, noise.freedom)[1] if freedom > 0 else 1.0
    return Asked(name, tuple(c.tolist()), tuple(errors.tolist()), tuple(added.tolist()), chance)


def vertical(campaign: Campaign) -> Floats:
    """(3,) unit vector: the normal of the base joints' plane on the platform's side. The base is taken to be level."""
    base = campaign.robot.base
    normal = np.linalg.svd(base - base.mean(axis=0))[2][-1]
    return np.asarray(normal * np.sign(normal @ (campaign.position.mean(axis=0) - base.mean(axis=0))))


def sag_shape(leg: Floats, length: Floats, middle: Floats | float, up: Floats) -> Floats:
    """How much a leg (..., 3), of that length (...), shortens by its weight: (length / middle)^7 sin^2(tilt).

    As a share of what it would lying flat with the length `middle`.
    """
    cosine = (leg @ up) / np.linalg.norm(leg, axis=-1)
    return np.asarray((length / middle) ** _SEVENTH * (1.0 - cosine**2))


def mid_range(length: Floats) -> Floats:
    """(n,) mm: halfway between the shortest and the longest reading of each leg."""
    return np.asarray(0.5 * (length.min(axis=0) + length.max(axis=0)))


COLUMNS: dict[str, Column] = {
    "gain": lambda equations, x, up: equations.length - mid_range(equations.length),
    "sag": lambda equations, x, up: (
        -sag_shape(equations.vectors(x)[0], equations.length + x[:, 6], x[:, 6] + mid_range(equations.length), up)
    ),
    "lateral": lambda equations, x, up: 0.5 / (equations.length + x[:, 6]),
}


@dataclass(frozen=True)
class Diagnosis:
    """What is named, and what was asked. Nothing of it is proved; `cpcal.compare` asks models with proofs."""

    named: tuple[str, ...]
    models: tuple[Asked, ...]
    unexplained: bool

    @property
    def sentence(self) -> str:
        """What the data name, in words."""
        said = [_WORDS[name] for name in self.named if name in _WORDS]
        chosen = [model for model in self.models if model.name in self.named]
        said += [_said(model) for model in chosen]
        if self.unexplained:
            asked = ", ".join(model.name for model in self.models)
            able = [model.name for model in self.models if model.explains and model.name != PLAIN]
            if able:
                said.append(
                    "The readings are not explained by seven parameters a leg; several models would do "
                    f"({', '.join(able)}), and these poses do not tell them apart."
                )
            else:
                said.append(f"The readings are explained by NONE OF THESE models: {asked}.")
        return " ".join(said) or "No imperfection is named: seven parameters a leg and the noise explain all readings."


def diagnosis(campaigns: Sequence[Campaign], noises: Sequence[Noise], start: Floats, tests: Tests) -> Diagnosis:
    """What repeats name, and the means of several campaigns of one robot in the same frames, such as calibration and
    validation, from the parameters (n, 7) of a fit."""
    named = [DRIFT] * bool(unusual(tests, RUNS, ACCUSED)) + [PLAY] * bool(unusual(tests, VARIANCES, ACCUSED))
    each = [LegEquations.of(campaign) for campaign in campaigns]
    columns = zip(*((one.position, one.rotation, one.length) for one in each), strict=True)
    pose, length = (np.concatenate([getattr(one, name) for one in noises]) for name in ("pose", "length"))
    given = LegEquations(*map(np.concatenate, columns)), Noise(pose, length, noises[0].freedom), vertical(campaigns[0])
    plain = corrected(*given, start, PLAIN)
    if plain.chance >= ACCUSED:
        return Diagnosis(tuple(named), (plain,), unexplained=False)
    models = (plain, *(corrected(*given, start, name) for name in COLUMNS))
    able = [model.name for model in models[1:] if model.explains]
    if len(able) == 1:
        return Diagnosis((*named, able[0]), models, unexplained=False)
    return Diagnosis(tuple(named), models, unexplained=True)


def _said(model: Asked) -> str:
    low, high = min(model.values), max(model.values)
    size = f"up to {max(model.size):.2g} mm over the poses"
    if model.name == "gain":
        return (
            f"GAIN: the sensors' scales are off, by {low:.3g} to {high:.3g} mm/mm, {size}. A single camera cannot tell "
            "what all legs share from a wrong scale of its own, or of its target."
        )
    if model.name == "sag":
        return f"SAG: the legs shorten by their weight, by {low:.3g} to {high:.3g} mm if they lay flat, {size}."
    return f"LATERAL OFFSET of the joints from the actuator: {low:.3g} to {high:.3g} mm^2, {size}."


_WORDS = {
    DRIFT: "DRIFT: runs differ by more than chance.",
    PLAY: "PLAY (backlash or hysteresis): repeats scatter in the calibration equations as no noise of readings does.",
}
