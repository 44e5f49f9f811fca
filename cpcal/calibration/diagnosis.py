"""Which mechanism, if any, the data name: one is named only where its own model explains them and the others do not.

Repeats name drift and play (repeat_tests.py). What they leave over in the means, of calibration and validation poses
together, is asked of models with one parameter more a leg (corrections.py): the model of the paper first, and if that
explains the readings, nothing is named. The extremal configurations alone have two lengths a leg, over which every
function of the length is a gain: other poses must be there to tell models apart.

A robot without imperfections should not be accused in any of 200 studies, so levels are stricter than those of words.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.corrections import COLUMNS, Corrected, Poses, corrected
from cpcal.calibration.repeat_tests import RUNS, VARIANCES, RepeatTests
from cpcal.common.arrays import Floats

ACCUSED = 1e-4  # probability of naming something, test by test (repeats: all together), where all is well
_EXPLAINS = 1e-3  # probability of the residuals from which a model explains them
_PHYSICAL = 3.0  # standard errors by which a quantity that cannot be negative may be so
_ONE_SIGNED = ("sag", "lateral")

PLAIN, DRIFT, PLAY = "plain", "drift", "play"


@dataclass(frozen=True)
class Asked:
    """A model that was asked: c of each leg with standard errors, the range of what it adds (mm), and how likely its
    residuals are by noise alone. `common`: whether one c for all legs would do."""

    name: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    size: tuple[float, ...]
    chance: float
    common: bool

    @property
    def explains(self) -> bool:
        """Whether its residuals are what noise makes, with parameters that can be."""
        possible = self.name not in _ONE_SIGNED or all(
            c > -_PHYSICAL * e for c, e in zip(self.values, self.errors, strict=True)
        )
        return possible and self.chance >= _EXPLAINS


@dataclass(frozen=True)
class Diagnosis:
    """What is named, and what was asked. Nothing of it is proved; `cpcal compare` asks models with proofs."""

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


def diagnosis(poses: Poses, start: Floats, tests: RepeatTests) -> Diagnosis:
    """What repeats and means name, from the parameters (n, 7) of a fit."""
    named = [DRIFT] * bool(tests.found(RUNS, ACCUSED))
    named += [PLAY] * bool(tests.found(VARIANCES, ACCUSED))
    plain = _asked(corrected(poses, start, PLAIN))
    if plain.chance >= ACCUSED:
        return Diagnosis(tuple(named), (plain,), unexplained=False)
    models = (plain, *(_asked(corrected(poses, start, name)) for name in COLUMNS))
    able = [model.name for model in models[1:] if model.explains]
    if len(able) == 1:
        return Diagnosis((*named, able[0]), models, unexplained=False)
    return Diagnosis(tuple(named), models, unexplained=True)


def _asked(found: Corrected) -> Asked:
    numbers = (tuple(map(float, np.ravel(part))) for part in (found.values, found.errors, found.size))
    values, errors, size = numbers
    return Asked(found.name, values, errors, size, found.chance, found.common >= _EXPLAINS)


def _said(model: Asked) -> str:
    low, high = min(model.values), max(model.values)
    size = f"up to {max(model.size):.2g} mm over the poses"
    if model.name == "gain":
        alike = (
            " All legs have the same: a single camera cannot tell that from a wrong scale of its own, or of its target."
            if model.common
            else ""
        )
        return f"GAIN: the sensors' scales are off, by {low:.3g} to {high:.3g} mm/mm, {size}.{alike}"
    if model.name == "sag":
        return f"SAG: the legs shorten by their weight, by {low:.3g} to {high:.3g} mm if they lay flat, {size}."
    return f"LATERAL OFFSET of the joints from the actuator: {low:.3g} to {high:.3g} mm^2, {size}."


_WORDS = {
    DRIFT: "DRIFT: runs differ by more than chance.",
    PLAY: "PLAY (backlash or hysteresis): repeats scatter in the calibration equations as no noise of readings does.",
}
