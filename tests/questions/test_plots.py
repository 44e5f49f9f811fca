"""Figures and tables of results for notebooks: axes in, axes out."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

import cpcal
from cpcal.questions import Ranges
from tests.report.made import made_leg, made_result

CAMPAIGN = cpcal.simulate(seed=1)
NAMES = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")


def leg(number, eps_hi=0.2, **changes):
    x = CAMPAIGN.robot.parameters[number - 1]
    box = cpcal.Box(NAMES, x - 0.5, x + 1.0)
    return made_leg(number, 0.1, eps_hi, tuple(x), tuple(x + 0.1), box, 0.0, (), 1, 94, 0.25, **changes)


@pytest.fixture
def ax():
    return Figure().add_subplot()


def test_brackets_and_tolerance_are_drawn_on_the_axes_that_were_given(ax):
    result = made_result(CAMPAIGN, leg(1), leg(2, math.inf, point=None), tolerance=0.3)
    assert result.plot(ax) is ax
    assert [text.get_text() for text in ax.get_yticklabels()] == ["leg 1", "leg 2"]
    assert any(np.allclose(line.get_xdata(), 0.3) for line in ax.lines)


def test_residuals_of_point_and_center_are_drawn(ax):
    assert leg(1).plot_residuals(CAMPAIGN, ax) is ax
    center, point = (np.asarray(line.get_ydata(), dtype=np.float64) for line in ax.lines)
    assert len(center) == len(point) == len(CAMPAIGN)
    assert not np.allclose(center, point)
    with pytest.raises(ValueError, match="no proved point"):
        leg(1, point=None).plot_residuals(CAMPAIGN, ax)


def test_parameters_are_drawn_with_their_ranges(ax):
    x = CAMPAIGN.robot.parameters[0]
    wide = leg(1, ranges=Ranges(0.22, cpcal.Box(NAMES, x - 2.0, x + 3.0)))
    assert wide.plot_parameters(ax) is ax
    assert [bar.get_width() for bar in ax.patches] == pytest.approx([5.0] * 7)
    assert [text.get_text() for text in ax.get_yticklabels()] == list(NAMES)


def test_the_frame_has_a_row_a_leg_and_parameter():
    pytest.importorskip("pandas")
    frame = made_result(CAMPAIGN, leg(1), leg(2), tolerance=0.3).to_frame()
    assert len(frame) == 14
    assert list(frame["parameter"][:7]) == list(NAMES)
    assert frame["certified"].tolist()[:7] == CAMPAIGN.robot.parameters[0].tolist()
    assert frame["range_lo"].isna().all()
    assert set(frame["verdict"]) == {"pass"}
