"""The certified answer: eps* between two bounds, ranges of the parameters, verdicts of the classical answer.

S(eps) = { (X, F) in the box : for every point a pixel within its half-width is met to within eps on both axes }
eps*   = min { eps : S(eps) is not empty }
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_most
from cpcal.common.version import __version__
from cpcal.handeye.classical_answer import ClassicalAnswer, classical_answer
from cpcal.handeye.exact_errors import PlacedFrames, Reading, above, exact_errors, largest
from cpcal.handeye.frames_chain import Chain, ChainProof, prove_chain
from cpcal.handeye.hand_eye_result import (
    LOWER,
    RANGES,
    AskedBox,
    Classical,
    FrameRanges,
    HandEyeResult,
    ImageVerdict,
    Information,
)
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.lower_end import lower_end, support
from cpcal.handeye.minimax_fit import minimax_fit
from cpcal.handeye.parameter_ranges import parameter_ranges
from cpcal.handeye.pixel_model import PixelModel
from cpcal.handeye.pose_readings import ReadFrames, ReadingModel

REACH = 2000.0  # mm: the box around the classical positions
GAP = 1e-6
_BEYOND = 1.1  # of eps_hi: the tolerance of the ranges

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Within:
    """The box: positions within `reach` mm of the classical ones, rotations within `angle` degrees (None: any)."""

    reach: float = REACH
    angle: float | None = None

    @staticmethod
    def parsed(text: str) -> Within:
        """Of `DEGREES,MM`, or `any,MM`. Raises InputError."""
        parts = [part.strip() for part in text.split(",")]
        try:
            angle = None if parts[0] == "any" else float(parts[0])
            reach = float(parts[1]) if len(parts) == 2 else math.nan
        except ValueError:
            reach, angle = math.nan, None
        if not 0.0 < reach < 1e6 or (angle is not None and not 0.0 < angle <= 180.0):
            remedy = "give degrees and mm, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("option --within", f"is {text!r:.60}", remedy)])
        return Within(reach, angle)

    def about(self, center: PlacedFrames) -> AskedBox:
        """The box about the classical answer. Raises InputError for a reach or an angle that is none."""
        return AskedBox(center, self.reach, self.angle)


def certify_hand_eye(
    study: HandEyeStudy,
    *,
    within: Within | None = None,
    tolerance: float | None = None,
    gap: float = GAP,
    certificates: Path | None = None,
    time_limit: float = math.inf,
    tell: Tell = lambda text: None,
) -> HandEyeResult:
    """Bracket eps* of a study, and the ranges of its parameters.

    within        the box; default any rotation, positions within 2 m of the classical answer on each axis
    tolerance     px: are there frames that explain every pixel to it, and in which ranges? Default: ranges at 1.1 eps*
    gap           relative width of the bracket that is asked for
    certificates  a folder that exists, for `lower-1.cert.jsonl` and `ranges-1.cert.jsonl`, and so on
    time_limit    seconds for each of the proofs; what is proved until then is stated

    Raises InputError for studies without a classical answer, and where its points lie outside of the box.
    """
    began = time.monotonic()
    if tolerance is not None and not 0.0 <= tolerance < math.inf:
        raise InputError([Problem("tolerance", f"is {tolerance}", "give pixels, from 0")])
    classical = classical_answer(study)
    center = PlacedFrames.of(classical.frames)
    asked = (within or Within()).about(center)
    best = best_frames(study, classical)
    point, readings = PlacedFrames.of(best.frames), stated_readings(study, best.readings)
    worst = largest(exact_errors(study, point, readings))
    assert worst is not None  # the fit keeps all points in front of the camera
    eps_hi = above(worst)
    domain = asked.box
    check_inside(asked, point)
    tell(f"some frames explain every pixel to {at_most(eps_hi, 7)} px")
    at = ranges_tolerance(eps_hi, tolerance)
    about = about_study(study)
    wide = prove_chain(study, at, domain, center, about=about, time_limit=time_limit, tell=tell)
    eps_lo, lower = lower_end(study, wide, center, best, eps_hi, gap, about=about, time_limit=time_limit, tell=tell)
    return HandEyeResult(
        setup=study.setup,
        images=len(study.images),
        points=len(study.image),
        asked=asked,
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        point=point,
        readings=readings,
        support=support(study, lower),
        lower=Chain((), (), ()) if lower is None else lower.written(LOWER, certificates),
        tolerance=tolerance,
        ranges=_ranges(wide, point, wide.written(RANGES, certificates)),
        classical=judged(study, center, stated_readings(study, classical.readings), at),
        information=Information(
            version=__version__,
            gap=gap,
            rms=classical.rms,
            sigma=tuple(np.sqrt(np.diagonal(classical.covariance)).tolist()),
            remarks=classical.remarks,
            programs=sum(proof.programs for proof in (wide, lower) if proof is not None),
            seconds=time.monotonic() - began,
        ),
    )


def ranges_tolerance(eps_hi: float, tolerance: float | None) -> float:
    """px: of the ranges, where a tolerance was asked for or none (None) was."""
    return _BEYOND * eps_hi if tolerance is None else tolerance


def best_frames(study: HandEyeStudy, classical: ClassicalAnswer) -> ReadFrames:
    """The frames of the least largest error near the classical answer, and the readings of uncertain poses."""
    if not study.pose_half_width.any():
        return ReadFrames.stated(minimax_fit(PixelModel(study), classical.frames)[0], study)
    return minimax_fit(ReadingModel(study), ReadFrames(classical.frames, classical.readings))[0]


def stated_readings(study: HandEyeStudy, values: Floats) -> tuple[Reading, ...]:
    """As a result states them; none of exact poses."""
    return tuple(map(tuple, values.tolist())) if study.pose_half_width.any() else ()


def check_inside(asked: AskedBox, point: PlacedFrames) -> None:
    """Raises InputError for frames outside of the box."""
    if not asked.holds(point):
        raise InputError([Problem("option --within", "leaves out the best frames found", "give a larger box")])


def about_study(study: HandEyeStudy) -> str:
    """What certificates say of themselves."""
    return (
        f"cpcal hand-eye, {study.setup}: X camera in {'hand' if study.setup == 'eye-in-hand' else 'base'}, "
        f"F target in {'base' if study.setup == 'eye-in-hand' else 'hand'}, mm"
    )


# ranges and verdicts -----------------------------------------------------------------------------------------------


def _ranges(wide: ChainProof, point: PlacedFrames, chain: Chain) -> FrameRanges:
    if wide.refuted:
        return FrameRanges(wide.eps, (), (), (), (), chain)
    lo, hi = tuple(wide.left.lo.tolist()), tuple(wide.left.hi.tolist())
    low, high = parameter_ranges(lo, hi, point)
    return FrameRanges(wide.eps, low, high, lo, hi, chain)


def judged(study: HandEyeStudy, placed: PlacedFrames, readings: tuple[Reading, ...], tolerance: float) -> Classical:
    """Frames, exactly, image by image. Raises InputError where they put a point behind the camera."""
    errors = exact_errors(study, placed, readings)
    verdicts = []
    for k, name in enumerate(study.images):
        worst = largest([errors[n] for n in np.flatnonzero(study.image == k)])
        if worst is None:
            what = f"puts points of {name} behind the camera"
            raise InputError([Problem("the least-squares answer", what, "check the setup, and the poses")])
        verdicts.append(ImageVerdict(name, above(worst), worst <= F(tolerance)))
    return Classical(readings, max((verdict.largest for verdict in verdicts), default=0.0), tuple(verdicts))
