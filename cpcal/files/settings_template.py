"""A commented campaign.toml to fill in: for a robot of the catalogue, or for one's own."""

from __future__ import annotations

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.files.campaign_writer import FORMAT, matrix, quoted, vector
from cpcal.robot import ROBOTS, KnownRobot

_LEGS_MAX = 1_000
_START = """\
# A campaign: what was measured on one robot. Beside this file stands measurements.csv; docs/your-data.md explains both.
# Every nan is to be replaced by a number. Lengths are in mm, angles in radians.
"""
_BASE = "# centres of the joints on the base, one row x, y, z a leg, mm, in the base frame"
_MOBILE = "# centres of the joints on the moving platform, one row a leg in the same order, mm, in the mobile frame"
_OFFSET = "# what a reading lacks of the leg's length, mm: length = reading + offset; 0 where whole lengths are read"
_UNCERTAINTY = """
[uncertainty]
# How far readings may be off: half-width = factor * standard deviation. Or put the one line `exact = true` here.
factor = 3.0
position_sigma = [nan, nan, nan]    # x, y, z of the pose, mm
rotation_sigma = [nan, nan, nan]    # rotation vector in the base frame, rad (0.01 degrees are 0.000175)
"""
_REST = """
# [model]                             # the leg model; without it the plain one: see docs/models.md
# name = "gain"

[provenance]                          # free text, shown in reports
# date = "2026-01-31"
# operator = ""
# serial = ""
"""


def settings_template(name: str, legs: int) -> str:
    """The text of a campaign.toml: the drawing of a known robot, or nan for `legs` legs of one called `name`.

    Raises InputError for a name or a number of legs that cannot be.
    """
    known = ROBOTS.get(name.casefold())
    if known is None and not 1 <= legs <= _LEGS_MAX:
        raise InputError([Problem("option legs", f"has no meaning: {legs}", f"give 1 to {_LEGS_MAX}")])
    return (
        "\n".join([_START + f"format = {quoted(FORMAT)}", "", *_robot(name, legs, known)]) + "\n" + _rest(legs, known)
    )


def _robot(name: str, legs: int, known: KnownRobot | None) -> list[str]:
    if known is None:
        blank = np.full((legs, 3), np.nan)
        title, base, mobile, offset = name, blank, blank, blank[:, 0]
    else:
        robot = known.robot
        title, base, mobile, offset = robot.name, robot.base, robot.mobile, robot.offset
    source = [] if known is None else [f"# Dimensions: {known.source}"]
    drawing = [_BASE, f"base = {matrix(base)}", _MOBILE, f"mobile = {matrix(mobile)}"]
    return ["[robot]", *source, f"name = {quoted(title)}", *drawing, _OFFSET, f"offset = {vector(offset)}"]


def _rest(legs: int, known: KnownRobot | None) -> str:
    count = legs if known is None else known.robot.legs
    line = f"length_sigma = {vector(np.full(count, np.nan))}    # leg readings, mm, one for each leg\n"
    return _UNCERTAINTY + line + _REST
