"""The options of an uncertainty budget: what all readings share and no repeat shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import typer

from cpcal.calibration.budget import Budget, Inputs, MonteCarlo, budget, monte_carlo
from cpcal.calibration.study_calibration import StudyCalibration
from cpcal.common.errors import InputError, Problem

_PANEL = "Uncertainty budget (GUM): standard uncertainties of what all readings share"


def _input(metavar: str, help: str) -> Any:
    return typer.Option(metavar=metavar, help=help, rich_help_panel=_PANEL)


@dataclass(frozen=True)
class BudgetFlags:
    """Left out: not stated. The budget is made where any is given."""

    camera_scale: Annotated[
        float | None, _input("REL", "Of the distances that the camera gives (focal length), relative.")
    ] = None
    target_scale: Annotated[float | None, _input("REL", "Of the target's dots, relative.")] = None
    lens: Annotated[float | None, _input("MM", "Of a position, by the rest of the distortion, from pose to pose.")] = (
        None
    )
    sensor_scale: Annotated[float | None, _input("REL", "Of each leg's sensor, relative.")] = None
    temperature: Annotated[float | None, _input("K", "Between target and robot; with the expansion of steel.")] = None
    trials: Annotated[
        int | None, _input("N", "Check U by Monte Carlo with so many simulated studies (GUM Supplement 1).")
    ] = None

    def checked(self) -> Inputs | None:
        """What was stated; None where nothing was. Raises InputError."""
        names = ("camera_scale", "target_scale", "lens", "sensor_scale", "temperature")
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if given:
            return Inputs.of(given)
        if self.trials is not None:
            what = "has no meaning without a standard uncertainty"
            raise InputError([Problem("option --trials", what, "state one, such as --camera-scale 1e-4")])
        return None

    def made(self, found: StudyCalibration, inputs: Inputs | None) -> tuple[Budget | None, MonteCarlo | None]:
        """The budget and its check, where they are asked for. Raises InputError."""
        if inputs is None:
            return None, None
        checked = None if self.trials is None else monte_carlo(found, inputs, trials=self.trials)
        return budget(found, inputs), checked
