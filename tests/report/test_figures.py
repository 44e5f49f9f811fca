"""Figures: drawn from arrays, of a leg's residuals, parameters and polygons, of all legs; for pages and notebooks."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.models import PARAMETERS
from cpcal.questions import Projection, Ranges
from cpcal.report import errors_svg, parameters_drawing, residuals_drawing
from cpcal.report.figures import FARTHEST, MOST_POINTS, Bar, bars_svg, pair_svg, polygon, worst_of_neighbours
from cpcal.report.run_page import render
from cpcal.report.svg import INK, Plot, evenly, tick_labels
from tests.report.made import made_leg, made_result

CAMPAIGN = cpcal.simulate(seed=1, joint_error=1.0)


def leg(number=1, eps_hi=0.2, **changes):
    x = CAMPAIGN.robot.parameters[number - 1]
    box = cpcal.Box(PARAMETERS, x - 0.5, x + 1.0)
    return made_leg(number, 0.1, eps_hi, tuple(x), tuple(x + 0.1), box, 0.0, (), 1, 94, 0.25, **changes)


# ------------------------------------------------------------------------------------------------------------------
# Ticks are round numbers in the range, data land where they belong, words are no markup.


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6), st.integers(2, 9))
def test_ticks_lie_in_the_range_evenly_and_not_too_many(lo, width, most):
    hi = lo + width
    if hi - lo < 1e-6 * abs(lo):  # digits that float64 has not
        return
    found = evenly(lo, hi, most)
    assert len(found) <= most + 1
    assert len(found) >= 1 or most < 4
    slack = 1e-6 * (hi - lo)
    assert all(lo - slack <= t <= hi + slack for t in found)
    steps = np.diff(found)
    assert np.allclose(steps, steps[:1], rtol=1e-6)


@given(st.integers(1, 10**6), st.integers(2, 9))
def test_whole_ticks_are_integers(count, most):
    assert all(t == round(t) for t in evenly(0.0, count + 1.0, most, whole=True))


def test_labels_say_the_numbers_with_few_digits():
    assert tick_labels([-0.5, 0.0, 0.5]) == ["−0.5", "0.0", "0.5"]
    assert tick_labels([0.0, 0.25]) == ["0.00", "0.25"]
    assert tick_labels([-2e-9, 0.0]) == ["−2e−9", "0"]
    assert tick_labels([0.0, 2e7]) == ["0", "2e7"]
    assert tick_labels([k * 0.1 for k in range(4)]) == ["0.0", "0.1", "0.2", "0.3"]


@pytest.mark.parametrize("equal", [False, True])
def test_the_corners_of_the_data_are_those_of_the_frame_and_words_are_no_markup(equal):
    plot = Plot((200.0, 100.0), (-1.0, 1.0), (0.0, 2.0), ("<b>&", "y"), equal=equal)
    left, top, right, bottom = plot.frame
    assert plot.at([(-1.0, 0.0), (1.0, 2.0)]).tolist() == [[left, bottom], [right, top]]
    assert (right - left == bottom - top) is equal
    plot.line(INK, [(-1.0, 0.0), (1.0, 2.0)])
    assert ">&lt;b&gt;&amp;</text>" in plot.svg("x")
    assert f'd="M{left:g} {bottom:g}L{right:g} {top:g}"' in plot.svg("x")


def test_marks_off_the_frame_and_those_that_are_no_numbers_are_not_drawn():
    plot = Plot((200.0, 100.0), (0.0, 1.0), (0.0, 1.0), ("x", "y"))
    before = len(plot.elements)
    plot.marks([(1.1, 0.5), (0.5, -0.1), (math.nan, 0.5), (0.5, math.inf)], "x", INK, 5.0)
    assert len(plot.elements) == before
    plot.marks([(1.0, 0.0), (1.1, 0.5)], "dot", INK, 5.0)
    assert plot.elements[-1].count("M") == 1


# ------------------------------------------------------------------------------------------------------------------
# Two parameters at a time: corners from half-planes, units, marks, and what the page says of them.


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


@pytest.mark.parametrize(("width", "unit"), [(1e-8, "nm"), (1e-3, "µm"), (1.0, "mm"), (5e4, "m")])
def test_units_are_easy_to_read_and_points_off_the_panel_are_not_drawn(width, unit):
    lo = np.array([10.0, -3.0])

    def drawn(nominal):
        points = (nominal, None, lo)
        return pair_svg(("a_x", "l"), lo, lo + width, (), points, "x")

    assert f"Δa_x [{unit}]" in drawn(lo)
    assert f"Δl [{unit}]" in drawn(lo)
    assert not re.search(r">[^<]*[0-9]e[^<]*</text>", drawn(lo))
    assert drawn(lo).count("<path") == drawn(lo + 9.0 * width).count("<path") + 1


def test_the_page_says_to_which_eps_the_polygons_belong():
    x = CAMPAIGN.robot.parameters[0]
    box = cpcal.Box(PARAMETERS, x - 0.5, x + 0.5)

    def page(eps, asked=None, **changes):
        pair = Projection(("a_z", "l"), ((1.0, 1.0, float(x[2] + x[6])),))
        one = leg(1, 0.1, eps_lo=0.099, enclosure=box, ranges=Ranges(eps, box, projections=(pair,)), **changes)
        return " ".join(render(CAMPAIGN, made_result(CAMPAIGN, one, eps=asked)).split())

    text = page(1.1 * 0.1)
    assert "to within eps = 0.110 mm" in text
    assert "Δ counts from the proved point" in text
    assert 'aria-label="Leg 1: polygon that holds a_z and l, in a rectangle of 1.0 by 1.0 mm"' in text
    assert "to within eps = 0.3 mm" in page(0.3, asked=0.3)
    assert "Δ counts from the middle of the bounds" in page(0.1, point=None)
    assert "to within eps = 0.109 mm" in page(math.nextafter(0.11, 0.0))  # rounded to the proved side


# ------------------------------------------------------------------------------------------------------------------
# The enclosure as bars: thin, wide, unbounded and empty ones, with and without a fit.

NAN = math.nan


def drawn(*bars, **options):
    """The figure of bounds and estimates, one bar each, with the widths at the right."""
    made = [Bar(f"p{k}", lo, hi, estimate, "width") for k, (lo, hi, estimate) in enumerate(bars)]
    svg = bars_svg(made, "axis", "x", words=(math.inf, "head"), **options)
    assert "nan" not in svg.lower()
    assert svg.count(">width</text>") == len(bars)
    return svg


def marks(svg, variable):
    """Ticks, arrows and crosses (two lines each) of that colour."""
    paths = re.findall(rf'<path d="([^"Z]*)" style="fill: none; stroke: var\(--{variable}\)', svg)
    return sum(path.count("M") for path in paths)


@pytest.mark.parametrize(
    ("bar", "ticks_and_arrows", "crosses"),
    [
        ((1.0, 1.0 + 2.0**-30, 0.0), 2, 1),  # so thin that only its ticks are seen
        ((0.0, 0.0, NAN), 2, 0),
        ((-2.0, 1.0, math.inf), 2, 0),
        ((NAN, NAN, 1.0), 0, 1),  # nothing is enclosed
        ((-math.inf, math.inf, 0.5), 2, 1),  # two arrows
        ((-1.0, 1e300, 2.0 * FARTHEST), 2, 0),  # a tick and an arrow
    ],
)
def test_a_bar_has_ticks_at_its_ends_arrows_to_what_is_too_far_and_a_cross_if_it_is_in_view(
    bar, ticks_and_arrows, crosses
):
    svg = drawn(bar, (-1.0, 1.0, NAN))
    assert (marks(svg, "edge"), marks(svg, "support")) == (2 + ticks_and_arrows, 2 * crosses)
    assert svg.count("Z") == 2 - math.isnan(bar[0])  # the bars themselves


# ------------------------------------------------------------------------------------------------------------------
# For notebooks and files.


def test_a_figure_is_a_document_of_its_own_in_colours_that_a_viewer_knows(tmp_path):
    svg = errors_svg(made_result(CAMPAIGN, leg(1), leg(2, math.inf, point=None), tolerance=0.3))
    assert ">leg 2</text>" in svg
    assert "tolerance 0.3 mm" in svg
    text = svg.save(tmp_path / "errors.svg").read_text(encoding="utf-8")
    assert text == svg._repr_svg_()
    assert text.startswith('<svg xmlns="http://www.w3.org/2000/svg" ')
    assert "var(--" not in text
    assert "#17693a" in text


def test_residuals_of_the_proved_point_are_drawn_where_there_is_one():
    found = residuals_drawing(CAMPAIGN, leg())
    assert found is not None
    assert found._repr_html_().count(f"<title>{len(CAMPAIGN)} ") == 1
    assert residuals_drawing(CAMPAIGN, leg(point=None)) is None


def test_of_many_measurements_the_worst_of_each_run_of_neighbours_are_drawn_and_the_support():
    size = np.random.default_rng(1).uniform(0.0, 1.0, 10 * MOST_POINTS)
    size[[1234, 3210]] = 2.0, 0.0
    shown = worst_of_neighbours(size, np.arange(len(size)) == 3210)
    assert {1234, 3210} <= set(shown)
    assert MOST_POINTS <= len(shown) <= MOST_POINTS + 1
    assert worst_of_neighbours(size[:MOST_POINTS], np.zeros(MOST_POINTS)) == list(range(MOST_POINTS))


def test_parameters_are_drawn_with_their_ranges():
    x = CAMPAIGN.robot.parameters[0]
    wide = leg(ranges=Ranges(0.22, cpcal.Box(PARAMETERS, x - 2.0, x + 3.0)))
    (svg,) = parameters_drawing(CAMPAIGN, wide).figures
    assert re.findall(r">([\d.]+)</text>", svg)[-7:] == ["5.0"] * 7  # widths


def test_the_frame_has_a_row_a_leg_and_parameter():
    pytest.importorskip("pandas")
    frame = made_result(CAMPAIGN, leg(1), leg(2), tolerance=0.3).to_frame()
    assert len(frame) == 14
    assert list(frame["parameter"][:7]) == list(PARAMETERS)
    assert frame["certified"].tolist()[:7] == CAMPAIGN.robot.parameters[0].tolist()
    assert frame["range_lo"].isna().all()
    assert set(frame["verdict"]) == {"pass"}
