"""Figures of results for notebooks and files, and the table of pandas."""

import math
import re

import pytest

import cpcal
from cpcal.questions import Ranges
from cpcal.report import errors_svg, parameters_drawing, residuals_drawing
from tests.report.made import made_leg, made_result

CAMPAIGN = cpcal.simulate(seed=1)
NAMES = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")


def leg(number, eps_hi=0.2, **changes):
    x = CAMPAIGN.robot.parameters[number - 1]
    box = cpcal.Box(NAMES, x - 0.5, x + 1.0)
    return made_leg(number, 0.1, eps_hi, tuple(x), tuple(x + 0.1), box, 0.0, (), 1, 94, 0.25, **changes)


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
    found = residuals_drawing(CAMPAIGN, leg(1))
    assert found is not None
    assert found._repr_html_().count(f"<title>{len(CAMPAIGN)} ") == 1
    assert residuals_drawing(CAMPAIGN, leg(1, point=None)) is None


def test_parameters_are_drawn_with_their_ranges():
    x = CAMPAIGN.robot.parameters[0]
    wide = leg(1, ranges=Ranges(0.22, cpcal.Box(NAMES, x - 2.0, x + 3.0)))
    (svg,) = parameters_drawing(CAMPAIGN, wide).figures
    assert re.findall(r">([\d.]+)</text>", svg)[-7:] == ["5.0"] * 7  # widths


def test_the_frame_has_a_row_a_leg_and_parameter():
    pytest.importorskip("pandas")
    frame = made_result(CAMPAIGN, leg(1), leg(2), tolerance=0.3).to_frame()
    assert len(frame) == 14
    assert list(frame["parameter"][:7]) == list(NAMES)
    assert frame["certified"].tolist()[:7] == CAMPAIGN.robot.parameters[0].tolist()
    assert frame["range_lo"].isna().all()
    assert set(frame["verdict"]) == {"pass"}
