"""The two figures of the first screen: every leg's error against the tolerance, and the platform with its poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.numbers import about, stated
from cpcal.report.advice import FEW, measurement_names, support_numbers
from cpcal.report.svg import DASHES, GRID, INK, SUPPORT, Axes, Figure, ticks
from cpcal.results import LegResult, Result, verdict_of
from cpcal.robot import Campaign, rotation_matrix

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
