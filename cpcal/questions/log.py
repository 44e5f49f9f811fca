"""What campaign is in a log: the form of its rotations and a tracker's frames by what the robot's drawing explains."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpcal.calibration.frames import Drawn, drawn_poses, first_frames, in_base_frame, redefined
from cpcal.common.errors import InputError, unusable
from cpcal.common.files import StrPath
from cpcal.common.numbers import about
from cpcal.common.values import ArrayLike, Texts
from cpcal.files import Log, Settings
from cpcal.files.log import campaign_of_log, frame_log, log_settings, read_log, unstated
from cpcal.robot import Campaign, KinematicsError, Robot
from cpcal.robot.campaign import Given
from cpcal.robot.mistakes import SHARE, spread_of
from cpcal.robot.units import SEQUENCES

if TYPE_CHECKING:
    from pandas import DataFrame

FRAME_NOTES = ("frames", "tracker_in_base", "target_in_mobile", "residuals", "left_out")  # of a provenance
_TRIED = 60  # rows tell frames
_EXPLAINED = 0.01  # of a leg's length: what manufacturing errors may leave
_FORMS = [
    f"{form}-{unit}" for unit in ("deg", "rad") for form in ("vector", *(f"euler-{order}" for order in SEQUENCES))
]


def _rotation(log: Log, settings: Settings, columns: str | Texts, stated: str | None, base: bool) -> InputError | None:
    """The problem that names the form of rotations with which the drawing explains the readings, in frames of a
    tracker; None where none does, or one does without such frames (unless `base`)."""
    step = -(-len(log.rows) // _TRIED)
    few = replace(log, rows=log.rows[::step], lines=log.lines[::step])
    tried = []
    drawn = None
    for name in _FORMS:
        try:
            campaign = campaign_of_log(few, settings, columns, name)
            drawn = drawn or drawn_poses(campaign.robot, campaign.length)
        except (InputError, KinematicsError):
            continue
        typical = Given.of(campaign).share()
        if typical <= SHARE and not base:
            return None
        tried.append((min(_by_drawing(campaign, drawn), typical), name))
    least = min(tried, default=(math.inf, ""))[0]
    if least > _EXPLAINED:
        return None
    alike = 1.01 * least + np.finfo(np.float64).eps  # two may be names of the same: the first one counts
    best, rest = next(one for one in tried if one[0] <= alike), [one for one in tried if one[0] > alike]
    what = "is not stated" if stated is None else f"is not {stated}"
    more = f"; the next best, {min(rest)[1]}, {about(100.0 * min(rest)[0], 2)} %" if rest else ""
    what += f": with {best[1]} readings and drawing differ by {about(100.0 * best[0], 2)} % of a leg's length{more}"
    return unusable("rotation", what, f"say --rotation {best[1]} (rotation= in Python) if the tracker's manual agrees")


def _by_drawing(campaign: Campaign, drawn: list[Drawn] | None = None) -> float:
    """By how much of a leg's length readings differ from the drawing's joints in frames of a tracker (the median over
    the measurements, of the worst leg); infinite where the poses determine no frames."""
    try:
        first = first_frames(campaign.robot, campaign.length, campaign.poses, drawn)
    except (InputError, KinematicsError):
        return math.inf
    robot = redefined(campaign.robot, *first)
    return Given.of(replace(campaign, robot=robot)).share()


def load_log(
    path: StrPath | DataFrame,
    *,
    robot: Robot | str,
    columns: str | Texts = "",
    rotation: str | None = None,
    frames: Literal["base", "tracker"] | None = None,
    position_sigma: ArrayLike | None = None,
    rotation_sigma: ArrayLike | None = None,
    length_sigma: ArrayLike | None = None,
    factor: float = 3.0,
    exact: bool = False,
) -> Campaign:
    """The campaign, in the base frame, of a log of poses and leg readings, each read once or several times: a file, or
    a table of pandas.

    robot      a Robot, the name of one in the catalogue, or a campaign.toml, which may state the uncertainty too
    columns    which columns are which, as `cpcal import --map` has it; left out: told by their names and units
    rotation   see `Campaign.from_arrays`; left out: told by the columns, for quaternions and matrices
    frames     "base": poses are of the mobile frame in the base frame. "tracker": of a target in a tracker's frame, and
               both frames are fitted. Left out: the drawing tells, where frames make it explain the readings; another
               mistake is not hidden in frames
    ..._sigma  standard deviations: position mm, rotation rad, lengths mm; one number, or one an axis or leg

    `campaign.provenance` says what was estimated. Raises InputError with everything that is wrong, KinematicsError
    where the drawing cannot reach the readings.
    """
    sigmas = {"position": position_sigma, "rotation": rotation_sigma, "length": length_sigma}
    settings, stated = log_settings(robot, sigmas, factor, exact)
    log = read_log(Path(path)) if isinstance(path, str | os.PathLike) else frame_log(path)
    older = {k: v for k, v in settings.provenance.items() if k.removesuffix("_pose") not in FRAME_NOTES}
    settings = replace(settings, provenance=older)
    try:
        read = campaign_of_log(log, settings, columns, rotation)
    except InputError as error:
        if rotation is not None or any(problem.where != "rotation" for problem in error.problems):
            raise
        raise _rotation(log, settings, columns, rotation, True) or error from None
    few = read.sampled(_TRIED)
    if frames is None and (typical := Given.of(few).share()) > SHARE:  # frames that explain it, and much better?
        frames = "tracker" if _by_drawing(few) <= min(_EXPLAINED, 0.1 * typical) else "base"
        if frames == "base" and (other := _rotation(log, settings, columns, rotation, False)) is not None:
            raise other
    campaign = in_base_frame(read) if frames == "tracker" else read
    if not stated:
        raise unstated(f"{about(float(np.median(spread_of(campaign).left)), 2)} mm")
    return campaign
