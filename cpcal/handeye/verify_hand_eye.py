"""A run of `cpcal handeye` checked again: certificates by the checker, everything else in exact arithmetic.

Every number of handeye.json that is called proved is found in a claim (`verify_chain`) or computed again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from fractions import Fraction as F
from pathlib import Path
from typing import TypeVar

import numpy as np

from cpcal.checker import Refused, Unusable
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import stated
from cpcal.handeye.exact_errors import Reading, above, exact_errors, exact_rotation, largest
from cpcal.handeye.frame_equations import R_F, R_X, SIZE, T_F, T_X, UNKNOWNS
from cpcal.handeye.frames_proof import box_of
from cpcal.handeye.hand_eye_files import load_hand_eye
from cpcal.handeye.hand_eye_result import AskedBox, HandEyeResult, load_hand_eye_result
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.parameter_ranges import parameter_ranges
from cpcal.handeye.verify_chain import NotAsStated, claimed

_Run = TypeVar("_Run")  # what a run says, as it was read


def verify_hand_eye(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """For each statement of the run in `folder`: whether it is accepted, and a sentence. Raises InputError."""
    run = Path(folder)
    study, result = load_hand_eye(run), load_hand_eye_result(run)
    checks = (_the_box, _the_lower_end, _the_point, _the_ranges, _the_classical_answer)
    found = statements(checks, run, study, result, verb="handeye")
    if not result.ranges.empty and not found[checks.index(_the_ranges)][0] and result.lower.certificates:
        found[checks.index(_the_lower_end)] = False, "lower end: REFUSED, it begins with ranges that are not proved"
    return found


def statements(
    checks: Iterable[Callable[[Path, HandEyeStudy, _Run], str]],
    run: Path,
    study: HandEyeStudy,
    result: _Run,
    *,
    verb: str,
) -> list[tuple[bool, str]]:
    """For each check of a run of `cpcal VERB`: whether it is passed, and its sentence. Raises InputError."""
    found = []
    for one in checks:
        try:
            found.append((True, one(run, study, result)))
        except (NotAsStated, Refused) as reason:
            found.append((False, f"{one.__name__.strip('_').replace('_', ' ')}: REFUSED, {reason}"))
        except Unusable as reason:
            raise InputError([Problem(str(run), str(reason), f"run cpcal {verb} again")]) from None
    return found


def _the_box(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    if (len(study.images), len(study.image), study.setup) != (result.images, result.points, result.setup):
        raise NotAsStated("the study is another one")
    return check_box(result.asked)


def check_box(asked: AskedBox) -> str:
    """A sentence on the box, whose bounds hold all that it says. Raises NotAsStated."""
    if not len(asked.lo) == len(asked.hi) == SIZE:
        raise NotAsStated("it is not 24 unknowns")
    center = asked.center
    placed = ((R_X, T_X, center.camera_quaternion, center.camera_position),
              (R_F, T_F, center.target_quaternion, center.target_position))  # fmt: skip
    reach = F(asked.reach)
    # 2 sin(angle / 2), from above: what the box must hold
    span = F(2) if asked.angle is None else F(2.0 * np.sin(np.radians(asked.angle) / 2.0) * (1.0 + 1e-14))
    for turn, shift, quaternion, position in placed:
        entries = [value for row in exact_rotation(quaternion) for value in row]
        for i, value in zip(turn, entries, strict=True):
            if F(asked.lo[i]) > max(value - span, F(-1)) or F(asked.hi[i]) < min(value + span, F(1)):
                raise NotAsStated(f"{UNKNOWNS[i]} leaves out rotations that it should hold")
        for i, at in zip(shift, position, strict=True):
            if F(asked.lo[i]) > F(at) - reach or F(asked.hi[i]) < F(at) + reach:
                raise NotAsStated(f"{UNKNOWNS[i]} leaves out positions that it should hold")
    turned = "any rotation" if asked.angle is None else f"rotations within {stated(asked.angle)} degrees"
    return f"box: {turned}, positions within {stated(asked.reach)} mm of the classical answer"


def _the_lower_end(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    if not result.lower.certificates:
        if result.eps_lo > 0.0 or result.support:
            raise NotAsStated("eps_lo is stated, and no certificate is there")
        return "lower end: NOT CERTIFIED, eps >= 0"
    ranges = result.ranges
    begins = (result.asked.lo, result.asked.hi) if ranges.empty else (ranges.lo, ranges.hi)
    if not ranges.empty and result.eps_lo > ranges.eps:
        raise NotAsStated("it begins with ranges at a smaller tolerance")
    claim = claimed(run, result.lower, study, box_of(*begins), result.eps_lo, result.asked.center)
    if not claim.infeasible:
        raise NotAsStated("the certificate does not claim that there are no frames")
    if set(result.support) != claim.last:
        raise NotAsStated("the support is not that of the last step")
    return f"lower end: PROVED, no frames explain every pixel to {result.eps_lo!r} px ({claim.steps} steps)"


def _the_point(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    check_readings(study, result.readings)
    worst = largest(exact_errors(study, result.point, result.readings))
    if worst is None or worst > F(result.eps_hi):
        raise NotAsStated("the point does not satisfy every pixel to eps_hi")
    return f"upper end: PROVED, the point explains every pixel to {result.eps_hi!r} px"


def check_readings(study: HandEyeStudy, readings: tuple[Reading, ...]) -> None:
    """Raises NotAsStated for readings of poses beyond their half-widths."""
    if not study.pose_half_width.any() and readings:
        raise NotAsStated("readings are stated of poses that are exact")
    if readings and np.shape(readings) != study.pose_half_width.shape:
        raise NotAsStated("the readings are not those of the study's poses")
    if readings and not (np.abs(np.array(readings)) <= study.pose_half_width).all():
        raise NotAsStated("a reading of a pose is beyond its half-width")


def _the_ranges(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    ranges, asked = result.ranges, result.asked
    if not ranges.chain.certificates:
        return "ranges: NOT CERTIFIED, no certificate was written"
    claim = claimed(run, ranges.chain, study, box_of(asked.lo, asked.hi), ranges.eps, asked.center)
    if ranges.empty:
        if not claim.infeasible:
            raise NotAsStated("the certificate does not claim that there are no frames")
        return f"ranges: PROVED, no frames explain every pixel to {ranges.eps!r} px"
    if claim.infeasible or (claim.lo, claim.hi) != (tuple(map(F, ranges.lo)), tuple(map(F, ranges.hi))):
        raise NotAsStated("the box of the unknowns is not the one that is proved")
    if parameter_ranges(ranges.lo, ranges.hi, result.point) != (ranges.low, ranges.high):
        raise NotAsStated("the ranges do not follow from the box of the unknowns")
    return f"ranges: PROVED for all frames that explain every pixel to {ranges.eps!r} px ({claim.steps} steps)"


def _the_classical_answer(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    classical, tolerance = result.classical, F(result.ranges.eps)
    check_readings(study, classical.readings)
    errors = exact_errors(study, classical.placed, classical.readings)
    if tuple(verdict.image for verdict in classical.images) != study.images:
        raise NotAsStated("it does not speak of the study's images")
    for k, verdict in enumerate(classical.images):
        worst = largest([errors[n] for n in np.flatnonzero(study.image == k)])
        said = np.inf if worst is None else above(worst)
        if (verdict.largest, verdict.ok) != (said, worst is not None and worst <= tolerance):
            raise NotAsStated(f"it is other in {verdict.image}")
    if classical.largest != max(verdict.largest for verdict in classical.images):
        raise NotAsStated("its largest error is another one")
    failing = sum(not verdict.ok for verdict in classical.images)
    return f"classical answer: PROVED, over {result.ranges.eps!r} px in {failing} of {len(study.images)} images"
