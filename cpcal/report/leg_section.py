"""What the page says of one leg: its figures, the table of its parameters, and what stands behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import about, bracket_text, nearest, plain_gap, rounded_down, rounded_up, stated
from cpcal.common.values import Floats
from cpcal.legs import PARAMETERS, PLAIN, LegModel, model_residuals, reading_sensitivities
from cpcal.questions import LegResult, Result, contractors_sentences, verdict_of
from cpcal.report.overview import FEW, Advice, Fitted, advise, fitted, measurement_names, support_numbers
from cpcal.report.svg import MOST_POINTS, Enclosure, Panel, Residuals, enclosure_svg, in_view, panel_svg, residual_svg
from cpcal.report.words import center_sentence, fit_sentence, leg_sentence
from cpcal.robot import Campaign, rotation_matrix
from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.interval import Box

if TYPE_CHECKING:
    from cpcal.calibration import CalibrationRecord

# ------------------------------------------------------------------------------------------------------------------
# How far the residual of each measurement can move while its reading stays in its set.


def reading_sensitivity(campaign: Campaign, leg: int, parameters: npt.ArrayLike, model: LegModel = PLAIN) -> Floats:
    """Sensitivity of `g(x, M_k)` about its value at the centre of the reading set, (N,) mm; to first order.

    With v = P + R b - a and b' = R b: `sum p_i |v_i|/|v| + sum r_j |(b' x (P - a))_j|/|v| + lambda`
    (DESIGN section 5); of other models by their derivatives. Plain floating point, for drawing; no proof rests on it.
    0 for exact readings.
    """
    if model.name != PLAIN.name:
        return reading_sensitivities(campaign, leg, parameters, model)
    x = np.asarray(parameters, np.float64)
    arm = rotation_matrix(campaign.quaternion) @ x[3:6]
    base = campaign.position - x[:3]
    vector = base + arm
    distance = np.linalg.norm(vector, axis=1)
    moved = np.sum(campaign.position_radius * np.abs(vector), axis=1)
    turned = np.sum(campaign.rotation_radius * np.abs(np.cross(arm, base)), axis=1)
    safe = np.where(distance > 0.0, distance, 1.0)
    return np.asarray((moved + turned) / safe + campaign.length_radius[:, leg - 1])


# ------------------------------------------------------------------------------------------------------------------
# What the page says of a leg's parameters two at a time, from the proved half-planes of the result.


def pairs(campaign: Campaign, result: Result, leg: LegResult) -> dict[str, Any] | None:
    """The panels and what their caption says; None where the result has none."""
    if leg.projections is None:
        return None
    panels = _panels(campaign, result, leg)
    eps = leg.projections.eps
    return {
        "svgs": [Markup(_svg(leg.leg, panel)) for panel in panels],  # made by us
        "eps": eps_text(result, eps),
        "margin": about(eps / leg.eps_hi) if result.options.eps is None and 0.0 < leg.eps_hi < eps else None,
        "proved_point": leg.point is not None,
        "fit": any(in_view(panel, panel.fit) for panel in panels),
        "nominal": any(in_view(panel, panel.nominal) for panel in panels),
    }


def eps_text(result: Result, eps: float) -> str:
    """An eps that the user gave as it was given; another one rounded down: what holds to within eps, holds to within
    less."""
    return stated(eps) if eps in (result.options.eps, result.options.tolerance) else bracket_text(eps, eps)[0]


def _panels(campaign: Campaign, result: Result, leg: LegResult) -> list[Panel]:
    assert leg.projections is not None
    box = leg.projections.box
    point = None if leg.point is None else np.array(leg.point[:7])
    fit = np.array(leg.center[:7]) if result.options.center == "fit" else None
    nominal = campaign.robot.parameters[leg.leg - 1]
    origin = box.mid[:7] if point is None else point
    panels = []
    for projection in leg.projections.pairs:
        k = [PARAMETERS.index(name) for name in projection.parameters]
        points = (None if point is None else point[k], None if fit is None else fit[k], nominal[k])
        panels.append(Panel(projection.parameters, box.lo[k], box.hi[k], projection.half_planes, origin[k], *points))
    return panels


def _svg(leg: int, panel: Panel) -> str:
    widths = [plain_gap(float(lo), float(hi)) for lo, hi in zip(panel.lo, panel.hi, strict=True)]
    label = (
        f"Leg {leg}: polygon that holds {panel.names[0]} and {panel.names[1]}, "
        f"in a rectangle of {widths[0]} by {widths[1]} mm"
    )
    return panel_svg(panel, label=label)


# ------------------------------------------------------------------------------------------------------------------
# Parameters in the frames of the robot's drawing, where a study found how camera and target stand in them.

DRAWING_FRAME = (
    "a: base joint centre, in the base frame of the robot's drawing; b: mobile joint centre, in its mobile frame; "
    "l: length offset. These frames are estimates of the study: certified values were moved by them, ranges are the "
    "hulls of the moved boxes."
)
_ROUNDING = 1e-9  # mm, more than moving a box in float64 can lose


@dataclass(frozen=True, eq=False)
class DrawingFrames:
    """Camera in the base frame and target in the mobile frame: rotations (3, 3) and positions (3,), mm."""

    camera: tuple[Floats, Floats]
    target: tuple[Floats, Floats]

    @classmethod
    def of(cls, record: CalibrationRecord) -> DrawingFrames:
        camera, target = (
            (rotation_matrix(np.array([frame.quaternion]))[0], np.array(frame.position))
            for frame in (record.frames.camera_in_base, record.frames.target_in_mobile)
        )
        return cls(camera, target)

    def point(self, x: Floats) -> Floats:
        """Parameters (n,); those of the model, after l, stay."""
        return self._moved(x, lambda rotation, at, part: rotation @ part + at)

    def box(self, lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
        """A box that holds all parameters of the box `lo`, `hi` (n,)."""
        radius = self._moved(0.5 * (hi - lo), lambda rotation, _, part: np.abs(rotation) @ part)
        middle = self.point(0.5 * (lo + hi))
        return middle - radius - _ROUNDING, middle + radius + _ROUNDING

    def _moved(self, x: Floats, move: object) -> Floats:
        assert callable(move)
        parts = [move(*self.camera, x[:3]), move(*self.target, x[3:6]), x[6:]]
        return np.concatenate(parts)


def frames_of_run(result: Result, record: CalibrationRecord, where: str) -> DrawingFrames:
    """The frames of the study that the run's campaign comes from. Raises InputError where the record is of another."""
    if record.campaign_sha256 != result.campaign_sha256:
        what = "holds the frames of another study: the SHA-256 of its campaign differs"
        raise InputError([Problem(where, what, "name the folder that cpcal calibrate wrote with the run's campaign")])
    return DrawingFrames.of(record)


def check_movable(result: Result) -> None:
    """InputError for a model whose own parameters depend on the frames."""
    if result.model.name not in ("plain", "gain", "lateral"):
        what = f"has the model {result.model.name!r}, whose own parameters depend on the frames"
        raise InputError([Problem("run", what, "export it in the campaign's frames")])


_DECIMALS = {"mm": 4}  # of parameters in this unit
_MORE = 9  # of others, such as shares
_MOST_NAMES = 120  # measurements listed for a leg


def leg_section(
    campaign: Campaign,
    result: Result,
    leg: LegResult,
    model: LegModel | None,
    frames: DrawingFrames | None = None,
) -> dict[str, Any]:
    """`model`: None where it is not known here; then nothing is said of residuals. `frames`: of the drawing."""
    found = None if model is None else fitted(campaign, result, leg, model)
    names = measurement_names(campaign, support_numbers(campaign, leg))
    return {
        "number": leg.leg,
        "verdict": verdict_of(result, leg),
        "fit_sentence": fit_sentence(verdict_of(result, leg)),
        "sentence": leg_sentence(result, leg),
        "center": center_sentence(result, leg),
        "advice": _advice(campaign, advise(campaign, result, leg, model, found)),
        "fit_error": None if found is None or model is None else _fit_error(campaign, leg, model, found),
        "trials": [_trial(leg, trial) for trial in leg.trials],
        "parameters": _parameters(campaign, result, leg, found),
        "ranges": _ranges(result, leg),
        "enclosure": _enclosure(result, leg),
        "moved": None if frames is None else _moved(result, leg, frames),
        "bars": _bars(campaign, leg, found),
        "contractors": contractors_sentences(leg),
        "certified": leg.certified,
        "proved_point": leg.point is not None,
        "empty": leg.enclosure.is_empty,
        "support": names[:_MOST_NAMES],
        "more_support": max(0, len(names) - _MOST_NAMES),
        "figure": _figure(campaign, leg, model, found),
        "pairs": pairs(campaign, result, leg),
    }


def _advice(campaign: Campaign, advice: Advice) -> dict[str, Any]:
    return {"step": advice.step.value, "sentence": advice.sentence, "first": measurement_names(campaign, advice.first)}


def _fit_error(campaign: Campaign, leg: LegResult, model: LegModel, found: Fitted) -> float:
    """The smallest eps at which the fit is a solution, to first order: what readings in their sets cannot explain."""
    room = reading_sensitivity(campaign, leg.leg, found.x, model)
    return max(0.0, float(np.max(np.abs(found.residuals) - np.nan_to_num(room))))


def _trial(leg: LegResult, trial: Trial) -> tuple[str, ...]:
    """A row of the table of the solver's calls; its bounds have the digits of the leg's own, which end the table."""
    asked, lo = (bracket_text(value, leg.eps_hi)[0] for value in (trial.eps, trial.lo))
    hi = bracket_text(leg.eps_lo, trial.hi)[1]
    answer = (
        trial.answer.value if trial.checked or trial.answer is not TimeoutAnswer.INFEASIBLE else "infeasible, unchecked"
    )
    return (asked, about(trial.delay), answer, lo, hi, str(trial.nodes))


def _parameters(campaign: Campaign, result: Result, leg: LegResult, found: Fitted | None) -> list[dict[str, Any]]:
    """Name (with its unit, if that is not mm), nominal value, fit, proved point, range and its width, a row each."""
    nominal = [*campaign.robot.parameters[leg.leg - 1], *(0.0 for _ in result.model.extra)]
    rows = []
    for k, name in enumerate(result.parameters):
        unit = result.model.unit(name)
        decimals = _DECIMALS.get(unit, _MORE)
        fit = None if found is None else float(found.x[k])
        point = None if leg.point is None else leg.point[k]
        plain = ["—" if v is None else nearest(v, decimals) for v in (float(nominal[k]), fit, point)]
        sides = ("—", "—", "—") if leg.ranges is None else _sides(leg.ranges.box, k, decimals)
        exact = None if leg.ranges is None else _hex(leg.ranges.box, k)
        label = name if unit == "mm" else f"{name} [{unit}]"
        rows.append({"name": name, "label": label, "plain": plain, "range": sides, "exact": exact, "point": point})
    return rows


def _sides(box: Box, k: int, decimals: int) -> tuple[str, str, str]:
    """The bounds of one parameter and their distance, rounded outward."""
    lo, hi = float(box.lo[k]), float(box.hi[k])
    return rounded_down(lo, decimals), rounded_up(hi, decimals), plain_gap(lo, hi)


def _hex(box: Box, k: int) -> tuple[str, str]:
    """The bounds exactly, for programs that check the page."""
    return float(box.lo[k]).hex(), float(box.hi[k]).hex()


def _ranges(result: Result, leg: LegResult) -> dict[str, Any] | None:
    """To which eps the ranges belong, and who can check them."""
    if leg.ranges is None:
        return None
    eps = leg.ranges.eps
    return {
        "eps": eps_text(result, eps),
        "exact": eps.hex(),
        "margin": about(eps / leg.eps_hi) if 0.0 < leg.eps_hi < eps else None,
        "certificate": leg.ranges.certificate,
    }


def _enclosure(result: Result, leg: LegResult) -> list[dict[str, Any]]:
    """The rows of the table of all parameters that reach eps_hi."""
    rows = []
    for k, name in enumerate(result.parameters):
        unit = result.model.unit(name)
        decimals = 2 + _DECIMALS.get(unit, _MORE)
        label = name if unit == "mm" else f"{name} [{unit}]"
        sides = _sides(leg.enclosure, k, decimals)
        point = "—" if leg.point is None else nearest(leg.point[k], decimals)
        cells = (label, point, *sides)
        exact_point = None if leg.point is None else leg.point[k].hex()
        rows.append({"name": name, "cells": cells, "exact": _hex(leg.enclosure, k), "point": exact_point})
    return rows


def _moved(result: Result, leg: LegResult, frames: DrawingFrames) -> list[tuple[str, ...]] | None:
    """Certified values and ranges in the drawing's frames; None without them."""
    if leg.point is None or leg.ranges is None:
        return None
    point, (lo, hi) = frames.point(np.array(leg.point)), frames.box(leg.ranges.box.lo, leg.ranges.box.hi)
    box = Box(leg.ranges.box.names, lo, hi)
    decimals = _DECIMALS["mm"]
    return [
        (name, nearest(float(point[k]), decimals), *_sides(box, k, decimals))
        for k, name in enumerate(result.parameters)
    ]


def _bars(campaign: Campaign, leg: LegResult, found: Fitted | None) -> dict[str, Any]:
    """The plot of the ranges, or where there are none of the enclosure, against nominal values and fit."""
    box = leg.enclosure if leg.ranges is None else leg.ranges.box
    data = Enclosure(
        PARAMETERS,
        campaign.robot.parameters[leg.leg - 1],
        box.lo[:7],
        box.hi[:7],
        None if found is None else found.x[:7],
    )
    what = "enclosure" if leg.ranges is None else "range"
    label = f"Leg {leg.leg}: {what} of each parameter, relative to its nominal value"
    return {
        "svg": Markup(enclosure_svg(data, label=label)),  # made by us, as below
        "what": what,
        "empty": data.empty,
        "unbounded": data.unbounded,
        "fit": data.fit is not None,
        "fit_beyond": data.fit_beyond,
    }


def _figure(campaign: Campaign, leg: LegResult, model: LegModel | None, found: Fitted | None) -> dict[str, Any] | None:
    """The plot of the proved point's residuals and what its caption says; None without such a point, or model."""
    if leg.point is None or not math.isfinite(leg.eps_hi) or model is None:
        return None
    residual = model_residuals(campaign, leg.leg, leg.point, model)
    room = reading_sensitivity(campaign, leg.leg, leg.point, model)
    support, small = np.zeros(len(campaign), dtype=bool), len(leg.support) <= FEW
    support[list(support_numbers(campaign, leg))] = small
    names = measurement_names(campaign, tuple(range(len(campaign))))
    drawn = Residuals(residual, room, support, leg.eps_hi, None if found is None else found.residuals, names)
    svg = residual_svg(
        drawn, label=f"Leg {leg.leg}: residuals of the proved point over the measurements, and the band of eps_hi"
    )
    return {
        "svg": Markup(svg),  # made by us: text of the campaign in it is escaped
        "eps": bracket_text(leg.eps_hi, leg.eps_hi)[1],
        "exact": leg.eps_hi.hex(),
        "room": bool(room.any()),
        "beyond": int(np.sum(np.abs(residual) > leg.eps_hi)) if room.any() else 0,
        "envelope": len(residual) > MOST_POINTS,
        "support": bool(support.any()),
        "many": 0 if small else len(leg.support),
        "fit": None if found is None else about(found.largest),
    }
