"""The two figures of the first screen: every leg's error against the tolerance, and the platform with its poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

from cpcal.calibration.statistics import kept
from cpcal.common.errors import CpcalError
from cpcal.common.numbers import about, stated
from cpcal.common.values import Floats
from cpcal.legs import PLAIN, LegModel, ModelResiduals, fit_model, leg_model, model_jacobian, model_residuals
from cpcal.questions import (
    Bounded,
    Explained,
    LegResult,
    LegVerdict,
    Result,
    Uncompared,
    Undecided,
    Undetermined,
    verdict_of,
)
from cpcal.report.svg import DASHES, GRID, INK, SUPPORT, Axes, Figure, ticks
from cpcal.robot import Campaign, rotation_matrix, small_rotation

# ------------------------------------------------------------------------------------------------------------------
# The least-squares fit of a leg, which stands beside what was proved. Plain floating point.


@dataclass(frozen=True, eq=False)
class Fitted:
    """Its parameters (n,), residuals (N,) in mm at the centres of the reading sets, and their Jacobian (N, n)."""

    x: Floats
    residuals: Floats
    jacobian: Floats

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.residuals)))


def fitted(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> Fitted:
    """The fit that was the center of the box, or else one made now."""
    known = result.options.center == "fit"
    x = np.array(leg.center) if known else fit_model(campaign, leg.leg, model)
    with np.errstate(all="ignore"):  # the center of a damaged result may be anywhere
        values, slopes = model_residuals(campaign, leg.leg, x, model), model_jacobian(campaign, leg.leg, x, model)
        return Fitted(x, np.nan_to_num(values), np.nan_to_num(slopes))


# ------------------------------------------------------------------------------------------------------------------
# What to do about a leg: which measurements to look at first, and the next step.
#
# Estimates from the least-squares fit and the linearised equations, in floating point: help for a person, no proof.

FIRST = 3  # measurements to look at
FEW = 20  # a larger support points at nothing
_OTHER_MODELS = ("gain", "lateral", "linear")  # the simplest first
_HELPS = 0.6  # another model is named when its largest residual is below this share of the model's own
_FORCED = 0.5  # measurements are to be taken again when without them the largest residual is below this share
_ENOUGH = 500  # measurements, for the fits of other models
_SURELY = 1.5  # times that share: another model is not even fitted when its linearised equations leave more
_NEARLY = 1.3  # times the best: a simpler model is as good


class NextStep(StrEnum):
    """The next step, as a title and in the terminal."""

    ACCEPT = "accept"
    MODEL = "use another model"
    REMEASURE = "re-measure"
    ADD = "add poses"
    TOLERANCE = "state a tolerance"
    WAIT = "give it more time"
    MECHANICS = "look at the leg"
    COMPARE = "compare the constraints"


@dataclass(frozen=True)
class Advice:
    """`first`: measurements counted from 0, the most telling first. `short` is for one line, `sentence` for a page."""

    step: NextStep
    short: str
    sentence: str
    first: tuple[int, ...]


def advise(campaign: Campaign, result: Result, leg: LegResult, model: LegModel | None, found: Fitted | None) -> Advice:
    """`model`: the result's, and its fit, None where it is not known here: then no residuals can be looked at."""
    verdict = verdict_of(result, leg)
    if isinstance(verdict, Uncompared) and verdict.fits:
        return Advice(*_by_verdict(verdict), first=_of_support(campaign, leg))
    verdict = verdict.found if isinstance(verdict, Uncompared) else verdict
    if model is None or found is None:
        return Advice(*_by_verdict(verdict), first=_of_support(campaign, leg))
    first = _first(found, _of_support(campaign, leg, FEW))
    if isinstance(verdict, Explained):
        return Advice(*_by_verdict(verdict), first=first)
    if isinstance(verdict, Undetermined):
        return Advice(NextStep.ADD, "add poses", _where(campaign, verdict.names, found), first)
    if isinstance(verdict, Undecided):
        return Advice(*_by_verdict(verdict), first=first)
    better = _another_model(campaign, leg, model, found) or _without(campaign, found, first)
    if better is None:
        better = (
            NextStep.MECHANICS,
            "look at the leg",
            (
                "Neither another leg model nor leaving out these measurements helps: look for play, sag, or joints off "
                "their axes in this leg, or allow the error."
            ),
        )
    if isinstance(verdict, Bounded):
        step, short, sentence = better
        ask = "State with --tolerance which error you can accept."
        if step is NextStep.MECHANICS:
            return Advice(NextStep.TOLERANCE, "state a tolerance", ask, first)
        return Advice(step, short, f"{ask} If this one is too large: {sentence[0].lower()}{sentence[1:]}", first)
    return Advice(*better, first=first)


def measurement_names(campaign: Campaign, numbers: tuple[int, ...]) -> list[str]:
    """Measurements counted from 1, each with its id."""
    ids = campaign.measurement_ids
    return [f"{k + 1} ({ids[k]})" for k in numbers]


def support_numbers(campaign: Campaign, leg: LegResult) -> tuple[int, ...]:
    """The support, counted from 0, in the order of the campaign."""
    chosen = set(leg.support)
    return tuple(k for k, name in enumerate(campaign.measurement_ids) if name in chosen)


def _first(found: Fitted, support: tuple[int, ...]) -> tuple[int, ...]:
    """Of the support, or of all where that is empty, those with the largest residuals."""
    among = np.array(support or range(len(found.residuals)))
    order = np.argsort(-np.abs(found.residuals[among]), kind="stable")
    return tuple(int(k) for k in among[order[:FIRST]])


def _largest_without(found: Fitted, dropped: tuple[int, ...]) -> float:
    """The largest residual of a fit of the other measurements, from the linearised equations."""
    kept = np.delete(np.arange(len(found.residuals)), dropped)
    if len(kept) <= found.jacobian.shape[1]:
        return math.inf
    rows, values = found.jacobian[kept], found.residuals[kept]
    step = np.linalg.lstsq(rows, -values, rcond=1e-12)[0]
    return float(np.max(np.abs(values + rows @ step)))


def _of_support(campaign: Campaign, leg: LegResult, most: int = FIRST) -> tuple[int, ...]:
    """A small support; nothing of a large one."""
    return support_numbers(campaign, leg) if len(leg.support) <= most else ()


def _by_verdict(verdict: LegVerdict) -> tuple[NextStep, str, str]:
    if isinstance(verdict, Uncompared):
        what = "Compare the constraints that the certificates state with the model: no program has."
        return NextStep.COMPARE, "compare the constraints", what
    if isinstance(verdict, Explained):
        return NextStep.ACCEPT, "accept", "Accept the parameters."
    if isinstance(verdict, Undetermined):
        return NextStep.ADD, "add poses", "Add poses with other positions and rotations."
    if isinstance(verdict, Undecided):
        return (
            NextStep.WAIT,
            "more time",
            ("Certify again with a longer --time-limit, or with a --tolerance clearly above or below these bounds."),
        )
    return NextStep.TOLERANCE, "state a tolerance", "State with --tolerance which error you can accept."


def _another_model(
    campaign: Campaign, leg: LegResult, model: LegModel, own: Fitted
) -> tuple[NextStep, str, str] | None:
    """The simplest model whose fit is much better, if there is one."""
    if model.name != PLAIN.name or len(campaign) < 2 * len(PLAIN.parameters):
        return None
    largest: dict[str, float] = {}
    some = _some(campaign)
    for name in _OTHER_MODELS:
        other = leg_model(name)
        try:
            residuals = ModelResiduals(campaign, leg.leg, other)
            if _at_least(residuals, own, other) > _SURELY * _HELPS * own.largest:
                continue
            x = fit_model(some, leg.leg, other, residuals if some is campaign else None)
            largest[name] = float(np.max(np.abs(residuals.values(x))))
        except (CpcalError, ValueError, np.linalg.LinAlgError):  # a fit that does not exist helps nobody
            continue
    best = min(largest.values(), default=math.inf)
    if not best < _HELPS * own.largest:
        return None
    name = next(name for name in largest if largest[name] <= max(_NEARLY * best, 0.0))
    sentence = (
        f"Use model “{name}”: its least-squares fit leaves {about(largest[name])} mm at most, this one's "
        f"{about(own.largest)} mm. `cpcal certify --model A,B` proves which models hold."
    )
    return NextStep.MODEL, f"model “{name}”", sentence


def _at_least(residuals: ModelResiduals, own: Fitted, other: LegModel) -> float:
    """About the largest residual of a fit of another model, from its equations linearised at the fit of the plain one.

    What is linear in the extra parameters, which are small, needs no fit to be ruled out.
    """
    at = np.append(own.x, np.zeros(len(other.extra)))
    with np.errstate(all="ignore"):  # a damaged result may be anywhere
        values, rows = residuals.values(at), residuals.jacobian(at)
    step = np.linalg.lstsq(rows, -values, rcond=1e-12)[0]
    return float(np.max(np.abs(values + rows @ step)))


def _some(campaign: Campaign) -> Campaign:
    """Of a large campaign some measurements, evenly spread: enough for the fit of an estimate."""
    step = -(-len(campaign) // _ENOUGH)
    return campaign if step == 1 else kept(campaign, np.arange(len(campaign)) % step == 0)


def _without(campaign: Campaign, own: Fitted, first: tuple[int, ...]) -> tuple[NextStep, str, str] | None:
    """To measure again what alone makes the error large."""
    for count in range(1, len(first) + 1):
        again, left = first[:count], _largest_without(own, first[:count])
        if left < _FORCED * own.largest:
            sentence = (
                f"Re-measure {', '.join(measurement_names(campaign, again))}: without "
                f"{'it' if count == 1 else 'them'} the least-squares fit leaves {about(left)} mm at most, "
                f"not {about(own.largest)} mm."
            )
            return NextStep.REMEASURE, f"re-measure {', '.join(str(k + 1) for k in again)}", sentence
    return None


def _where(campaign: Campaign, names: tuple[str, ...], found: Fitted) -> str:
    """A pose, of the corners of the workspace and a little beyond, that the undetermined parameters would show in."""
    scale = np.sqrt(np.mean(found.jacobian**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    weakest = np.linalg.svd(found.jacobian / scale, full_matrices=len(found.jacobian) < len(scale))[2][-1][:7]
    reach = np.maximum(0.5 * np.ptp(campaign.position, axis=0), 0.1 * float(np.mean(campaign.length)))
    middle = 0.5 * (campaign.position.min(axis=0) + campaign.position.max(axis=0))
    best, share = (middle, np.zeros(3)), -1.0
    for moved, turned in product(product((-1.0, 1.0), repeat=3), product((-0.2, 0.0, 0.2), repeat=3)):
        position, turn = middle + reach * np.array(moved), np.array(turned)
        row = _row(position, turn, found.x) / scale[:7]
        if abs(float(row @ weakest)) > share:
            best, share = (position, turn), abs(float(row @ weakest))
    what = f"Add poses that show {', '.join(names)}" if names else "Add poses"
    at, turned_by = (", ".join(about(v) for v in values) for values in (best[0], np.degrees(best[1])))
    return f"{what}, such as one near ({at}) mm, turned by ({turned_by}) degrees."


def _row(position: Floats, turn: Floats, x: Floats) -> Floats:
    """The derivative (7,) of the plain equation at a pose; `turn` is a rotation vector, rad."""
    rotation = rotation_matrix(small_rotation(turn[None]))[0]
    vector = position + rotation @ x[3:6] - x[:3]
    along = vector / max(float(np.linalg.norm(vector)), 1e-300)
    return np.concatenate([-along, rotation.T @ along, [-1.0]])


COLOURS = {"explained": "good", "unexplained": "bad", "bounded": "known", "undecided": "open", "undetermined": "poor"}
COLOURS |= {"uncompared": "open"}
_WIDTH, _ROW, _LEFT, _TOP, _BELOW = 330.0, 18.0, 40.0, 18.0, 32.0  # points, of the figure of errors
_PADDING = 20.0  # of the platform's drawing
_TURN, _TILT = math.radians(-30.0), math.radians(18.0)  # from where the platform is seen
_LETTER = 11.0  # points: room for a number
_MOST_POSES = 400  # dots that are drawn
_SOFT, _PANEL = "var(--soft)", "var(--panel)"


def errors_svg(result: Result, least_squares: Sequence[float | None]) -> str:
    """A row a leg: grey what is proved impossible, the bracket, the error of the least-squares fit, the tolerance.

    `least_squares`: of each leg, in mm, None where it is not known.
    """
    asked = result.options.tolerance
    known = [v for leg in result.legs for v in (leg.eps_lo, leg.eps_hi)]
    known += [v for v in (*least_squares, asked, result.options.eps) if v is not None]
    most = 1.06 * max((v for v in known if math.isfinite(v)), default=0.0) or 1.0
    count = len(result.legs)
    figure = Figure(_WIDTH, _TOP + _ROW * count + _BELOW)
    frame = (_LEFT, _TOP, _WIDTH - 12.0, _TOP + _ROW * count)
    axes = Axes(figure, frame, (0.0, most), (count - 0.5, -0.5))
    axes.x_axis(ticks(0.0, most, 6), "model error eps [mm]", grid=True)
    axes.rows([f"leg {leg.leg}" for leg in result.legs])
    for row, (leg, fit) in enumerate(zip(result.legs, least_squares, strict=True)):
        _bracket(axes, row, leg, f"var(--{COLOURS[verdict_of(result, leg).kind]})", most)
        if fit is not None and math.isfinite(fit):
            axes.marks([(fit, row)], "x", SUPPORT, 6.0, width=1.5)
    if asked is not None:
        axes.line([(asked, -0.5), (asked, count - 0.5)], INK, 1.2, DASHES)
        anchor = "end" if asked > 0.6 * most else "start"
        figure.text(float(axes.at([(asked, 0.0)])[0, 0]), 8.0, f"tolerance {stated(asked)} mm", anchor=anchor)
    return figure.svg("The model error of each leg, from zero, against the tolerance")


def _bracket(axes: Axes, row: int, leg: LegResult, colour: str, most: float) -> None:
    if math.isinf(leg.eps_lo):
        axes.area(_bar(0.0, most, row, 0.22), GRID)
        return
    axes.area(_bar(0.0, leg.eps_lo, row, 0.22), GRID)
    if leg.point is None or not math.isfinite(leg.eps_hi):
        axes.marks([(leg.eps_lo, row)], ">", colour, 9.0)
        return
    width = max(leg.eps_hi - leg.eps_lo, 0.012 * most)  # the narrowest is still seen
    axes.area(_bar(leg.eps_lo, leg.eps_lo + width, row, 0.36), colour)


def _bar(lo: float, hi: float, row: int, half: float) -> list[tuple[float, float]]:
    return [(lo, row - half), (hi, row - half), (hi, row + half), (lo, row + half)]


def platform_svg(campaign: Campaign, result: Result) -> str:
    """The nominal robot at the measured pose nearest to the middle, legs in the colour of their verdicts, all poses."""
    view = _View.of(campaign)
    kinds = {leg.leg: COLOURS[verdict_of(result, leg).kind] for leg in result.legs}
    base, mobile = (view.flat(p) for p in (campaign.robot.base, _mobile(campaign, view.nearest)))
    low, extent = view.low, np.maximum(view.extent, 1e-9)
    scale = (_WIDTH - 2.0 * _PADDING) / float(max(extent[0], 1.3 * extent[1]))
    width, height = scale * extent
    figure = Figure(_WIDTH, float(height) + 2.0 * _PADDING + 28.0)
    left = 0.5 * (_WIDTH - float(width))
    frame = (left, _PADDING, left + float(width), _PADDING + float(height))
    axes = Axes(figure, frame, (low[0], low[0] + extent[0]), (low[1], low[1] + extent[1]))
    axes.area(base, "none", INK)
    for k, (foot, head) in enumerate(zip(base, mobile, strict=True)):
        axes.line([foot, head], f"var(--{kinds.get(k + 1, 'shade')})", 2.4)
    _number(axes, base)
    axes.area(mobile, _PANEL, INK)
    forcing, at = forcing_numbers(campaign, result), view.flat(campaign.position)
    step = max(1, math.ceil(len(campaign) / _MOST_POSES))
    axes.dots([at[k] for k in range(0, len(campaign), step)], _SOFT, 3.0)
    axes.dots([at[k] for k in forcing], SUPPORT, 6.0)
    axes.hover([at[k] for k in forcing], measurement_names(campaign, forcing))
    length = ticks(0.0, 0.3 * float(extent[0]), 3)[-1]
    start = (low[0], low[1] - 30.0 / scale)
    axes.line([start, (start[0] + length, start[1])], INK, 1.6)
    x, y = axes.at([(start[0] + length, start[1])])[0]
    figure.text(float(x) + 5.0, float(y), f"{about(length)} mm")
    return figure.svg("The platform seen from the side, and the poses that were measured")


def _number(axes: Axes, feet: Floats) -> None:
    """The number of each leg below its foot, or further down where another number stands."""
    taken: list[tuple[float, float]] = []
    for k, (x, y) in enumerate(axes.at(feet).tolist()):
        down = y + _LETTER
        while any(abs(x - left) < _LETTER and abs(down - above) < _LETTER for left, above in taken):
            down += 1.0
        taken.append((x, down))
        axes.figure.text(x, down, str(k + 1), anchor="middle")


def forcing_numbers(campaign: Campaign, result: Result) -> tuple[int, ...]:
    """The measurements, from 0, of the small supports of all legs: they force eps."""
    small = [support_numbers(campaign, leg) for leg in result.legs if len(leg.support) <= FEW]
    return tuple(sorted({k for numbers in small for k in numbers}))


@dataclass(frozen=True, eq=False)
class _View:
    """From where the robot is seen: `axes` (2, 3) take a point of space to the sheet; `nearest`: the pose drawn."""

    axes: Floats
    low: Floats  # (2,) of all that is drawn
    extent: Floats
    nearest: int

    @classmethod
    def of(cls, campaign: Campaign) -> _View:
        middle = campaign.position.mean(axis=0)
        nearest = int(np.argmin(np.linalg.norm(campaign.position - middle, axis=1)))
        mobile, base = _mobile(campaign, nearest), campaign.robot.base
        up = _direction(mobile.mean(axis=0) - base.mean(axis=0), np.array([0.0, 0.0, 1.0]))
        side = np.cross(up, [0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0])
        side = _direction(side, np.array([1.0, 0.0, 0.0]))
        deep = np.cross(up, side)
        right = math.cos(_TURN) * side + math.sin(_TURN) * deep
        into = -math.sin(_TURN) * side + math.cos(_TURN) * deep
        axes = np.array([right, math.cos(_TILT) * up + math.sin(_TILT) * into])
        flat = np.concatenate([base, mobile, campaign.position]) @ axes.T
        return cls(axes, flat.min(axis=0), np.ptp(flat, axis=0), nearest)

    def flat(self, points: Floats) -> Floats:
        """Points (n, 3) on the sheet (n, 2)."""
        return np.asarray(points @ self.axes.T)


def _mobile(campaign: Campaign, k: int) -> Floats:
    """The mobile joint centres (n, 3) at measurement k, base frame."""
    rotation = rotation_matrix(campaign.quaternion[k : k + 1])[0]
    return np.asarray(campaign.position[k] + campaign.robot.mobile @ rotation.T)


def _direction(vector: Floats, otherwise: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return np.asarray(vector / length) if length > 0.0 else otherwise
