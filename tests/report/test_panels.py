"""Two parameters at a time: corners from half-planes, units, marks, and what the page says of them."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.legs import PARAMETERS
from cpcal.questions import Projection, Projections
from cpcal.report.figures import Panel, in_view, panel_svg, polygon
from cpcal.report.run_page import render
from tests.changed import leg_with
from tests.report.made import made_leg, made_result

CAMPAIGN = cpcal.simulate(seed=1, joint_error=1.0)


@given(st.integers(0, 2**32 - 1))
def test_corners_bound_just_what_the_half_planes_leave(seed):
    rng = np.random.default_rng(seed)
    lo = rng.uniform(-100, 100, 2)
    hi = lo + 10.0 ** rng.uniform(-6, 3, 2)
    normals = rng.normal(0, 1, (8, 2)) / (hi - lo)
    offsets = normals @ (0.5 * (lo + hi)) + rng.uniform(0.05, 1.0, 8)
    planes = [(u, v, c) for (u, v), c in zip(normals.tolist(), offsets.tolist(), strict=True)]
    corners = polygon(lo, hi, planes)
    tolerance = 1e-6 * (hi - lo)
    assert ((corners >= lo - tolerance) & (corners <= hi + tolerance)).all()
    assert (corners @ normals.T <= offsets + 1e-6).all()
    # the polygon is convex and turns to the left: a point is in it if and only if it is left of every edge
    points = lo + rng.uniform(0, 1, (200, 2)) * (hi - lo)
    left = np.ones(len(points), dtype=bool)
    for k in range(len(corners)):
        (dx, dy), from_corner = (corners[k] - corners[k - 1]) / (hi - lo), (points - corners[k - 1]) / (hi - lo)
        left &= dx * from_corner[:, 1] - dy * from_corner[:, 0] >= -1e-9
    excess = (points @ normals.T - offsets).max(axis=1)
    clear = np.abs(excess) > 1e-5
    assert (left == (excess <= 0.0))[clear].all()


def test_contradictory_half_planes_leave_nothing():
    assert polygon(np.zeros(2), np.ones(2), [(1.0, 0.0, 0.2), (-1.0, 0.0, -0.8)]).shape == (0, 2)


def panel(width, **changes):
    lo = np.array([10.0, -3.0])
    points = {"point": lo, "fit": lo + 0.5 * width, "nominal": lo + 9 * width}
    return Panel(("a_x", "l"), lo, lo + width, (), lo, **(points | changes))


@pytest.mark.parametrize(("width", "unit"), [(1e-8, "nm"), (1e-3, "µm"), (1.0, "mm"), (5e4, "m")])
def test_units_are_easy_to_read(width, unit):
    svg = panel_svg(panel(width), label="x")
    assert f"Δa_x [{unit}]" in svg
    assert f"Δl [{unit}]" in svg
    assert not re.search(r">[^<]*[0-9]e[^<]*</text>", svg)


def test_points_off_the_panel_are_not_drawn():
    assert in_view(panel(1.0), panel(1.0).fit)
    assert not in_view(panel(1.0), panel(1.0).nominal)
    assert not in_view(panel(1.0), None)
    assert "var(--support)" in panel_svg(panel(1.0), label="x")
    assert "var(--support)" not in panel_svg(panel(1.0, fit=None), label="x")


def page(eps, **changes):
    x = CAMPAIGN.robot.parameters[0]
    box = cpcal.Box(PARAMETERS, x - 0.5, x + 0.5)
    projections = Projections(eps, box, (Projection(("a_z", "l"), ((1.0, 1.0, float(x[2] + x[6])),)),))
    numbers = (0.099, 0.1, tuple(x), tuple(x), box, 0.0, (), 1, 94, 0.25)
    leg = made_leg(1, *numbers, projections=projections)
    result = made_result(CAMPAIGN, leg, eps=changes.pop("asked", None))
    return " ".join(render(CAMPAIGN, dataclasses.replace(result, legs=(leg_with(leg, **changes),))).split())


def test_the_page_says_to_which_eps_the_polygons_belong():
    text = page(1.1 * 0.1)
    assert "to within eps = 0.1100000 mm" in text
    assert "for some readings: 1.1 times eps_hi" in text
    assert "Δ counts from the proved point" in text
    assert 'aria-label="Leg 1: polygon that holds a_z and l, in a rectangle of 1.0 by 1.0 mm"' in text
    assert "times eps_hi" not in page(0.1)
    assert "times eps_hi" not in page(0.3, asked=0.3)
    assert "times eps_hi" not in page(0.3, eps_hi=math.inf)
    without = page(0.1, point=None)
    assert "Δ counts from the middle of the bounds" in without
    assert "to within eps = 0.1099999 mm" in page(math.nextafter(0.11, 0.0))  # rounded to the proved side
