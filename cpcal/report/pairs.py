"""What the page says of a leg's parameters two at a time, from the proved half-planes of the result."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.numbers import about, bracket_text, plain_gap, stated
from cpcal.legs import PARAMETERS
from cpcal.report.panels import Panel, in_view, panel_svg
from cpcal.results import LegResult, Result
from cpcal.robot import Campaign


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
