"""Figures: drawn from arrays, of a leg's residuals and parameters, of all legs; for pages and notebooks."""

import math
import re

import pytest

import cpcal
from cpcal.models import PARAMETERS
from cpcal.report import errors_svg
from cpcal.report.figures import FARTHEST
from tests.report.made import made_leg, made_result

CAMPAIGN = cpcal.simulate(seed=1, joint_error=1.0)


def leg(number=1, eps_hi=0.2, **changes):
    x = CAMPAIGN.robot.parameters[number - 1]
    box = cpcal.Box(PARAMETERS, x - 0.5, x + 1.0)
    return made_leg(number, 0.1, eps_hi, tuple(x), tuple(x + 0.1), box, 0.0, (), 1, 94, 0.25, **changes)


# ------------------------------------------------------------------------------------------------------------------
# Ticks are round numbers in the range, data land where they belong, words are no markup.


# ------------------------------------------------------------------------------------------------------------------
# The tolerances of legs as bars: thin, unbounded and unproved ones.


def marks(svg, variable):
    """Ticks, arrows and crosses (two lines each) of that colour."""
    paths = re.findall(rf'<path d="([^"Z]*)" style="fill: none; stroke: var\(--{variable}\)', svg)
    return sum(path.count("M") for path in paths)


@pytest.mark.parametrize(
    ("lo", "hi", "ticks_and_arrows", "crosses"),
    [
        (1.0, 1.0 + 2.0**-30, 2, 1),  # so thin that only its ticks are seen
        (0.1, math.inf, 2, 0),  # a tick and an arrow
        (math.inf, math.inf, 1, 0),  # nothing fits
        (0.1, 2.0 * FARTHEST, 2, 0),
    ],
)
def test_a_bar_has_ticks_at_its_ends_an_arrow_to_what_is_too_far_and_a_cross_in_view(lo, hi, ticks_and_arrows, crosses):
    point = None if hi == math.inf else (0.0,) * 7
    svg = errors_svg(made_result(CAMPAIGN, leg(1, hi, eps_lo=lo, point=point)))
    assert "nan" not in svg.lower()
    ends = sum(marks(svg, kind) for kind in ("known", "open", "bad"))
    assert (ends, marks(svg, "support")) == (ticks_and_arrows, 2 * crosses)


# ------------------------------------------------------------------------------------------------------------------
# For notebooks and files.


def test_a_figure_is_a_document_of_its_own_in_colours_that_a_viewer_knows():
    svg = errors_svg(made_result(CAMPAIGN, leg(1), leg(2, math.inf, point=None), tolerance=0.3))
    assert ">leg 2</text>" in svg
    assert "tolerance 0.3 mm" in svg
    text = svg._repr_svg_()
    assert text.startswith('<svg xmlns="http://www.w3.org/2000/svg" ')
    assert "var(--" not in text
    assert "#17693a" in text
