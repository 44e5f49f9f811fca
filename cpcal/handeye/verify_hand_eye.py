"""A run of `cpcal handeye` checked again: certificates by the checker, everything else in exact arithmetic.

The checker decides whether a certificate proves what it claims of the constraints that it states. Here it is compared,
character by character, with the constraints that the run's own study gives; and every number of handeye.json that is
called proved is found in a claim or computed again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction as F
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cpcal.checker import Accepted, Refused, Unusable, check
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import stated
from cpcal.handeye.exact_errors import above, exact_errors, exact_rotation, largest
from cpcal.handeye.exact_rows import ExactRows, row_meaning, row_number, stated_line
from cpcal.handeye.frame_equations import EQUATIONS, R_F, R_X, SIZE, T_F, T_X, UNKNOWNS
from cpcal.handeye.frames_proof import box_of
from cpcal.handeye.hand_eye_files import load_hand_eye
from cpcal.handeye.hand_eye_result import AskedBox, HandEyeResult, load_hand_eye_result
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.parameter_ranges import parameter_ranges
from cpcal.solver.certificate.statement import number
from cpcal.solver.certificate.writer import line
from cpcal.solver.interval import Box

_Run = TypeVar("_Run")  # what a run says, as it was read
_WORK = 500_000_000  # what the check of one certificate may cost, in multiplications


class NotAsStated(Exception):
    """What is not as the run says."""


def verify_hand_eye(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """For each statement of the run in `folder`: whether it is accepted, and a sentence. Raises InputError."""
    run = Path(folder)
    study, result = load_hand_eye(run), load_hand_eye_result(run)
    checks = (_the_box, _the_lower_end, _the_point, _the_ranges, _the_classical_answer)
    return statements(checks, run, study, result, verb="handeye")


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
    if not result.lower:
        if result.eps_lo > 0.0 or result.support:
            raise NotAsStated("eps_lo is stated, and no certificate is there")
        return "lower end: NOT CERTIFIED, eps >= 0"
    accepted, last = certified(run, result.lower, study, box_of(result.asked.lo, result.asked.hi), result.eps_lo)
    if not accepted.claims.infeasible:
        raise NotAsStated("the certificate does not claim that there are no frames")
    if set(result.support) != last:
        raise NotAsStated("the support is not that of the last step")
    return f"lower end: PROVED, no frames explain every pixel to {result.eps_lo!r} px ({accepted.steps} steps)"


def _the_point(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    worst = largest(exact_errors(study, result.point))
    if worst is None or worst > F(result.eps_hi):
        raise NotAsStated("the point does not satisfy every pixel to eps_hi")
    return f"upper end: PROVED, the point explains every pixel to {result.eps_hi!r} px"


def _the_ranges(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    ranges = result.ranges
    if not ranges.certificates:
        return "ranges: NOT CERTIFIED, no certificate was written"
    accepted, _ = certified(run, ranges.certificates, study, box_of(result.asked.lo, result.asked.hi), ranges.eps)
    if ranges.empty:
        if not accepted.claims.infeasible:
            raise NotAsStated("the certificate does not claim that there are no frames")
        return f"ranges: PROVED, no frames explain every pixel to {ranges.eps!r} px"
    hull = accepted.claims.enclosure
    stated = tuple(map(F, ranges.lo)), tuple(map(F, ranges.hi))
    if hull is None or hull != stated:
        raise NotAsStated("the box of the unknowns is not the one that is proved")
    if parameter_ranges(ranges.lo, ranges.hi, result.point) != (ranges.low, ranges.high):
        raise NotAsStated("the ranges do not follow from the box of the unknowns")
    return f"ranges: PROVED for all frames that explain every pixel to {ranges.eps!r} px ({accepted.steps} steps)"


def _the_classical_answer(run: Path, study: HandEyeStudy, result: HandEyeResult) -> str:
    classical, tolerance = result.classical, F(result.ranges.eps)
    errors = exact_errors(study, classical.placed)
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


def certified(
    run: Path, names: tuple[str, ...], study: HandEyeStudy, box: Box, eps: float
) -> tuple[Accepted, set[tuple[str, str]]]:
    """What the last of some certificates proves of the study at eps, and image and point of its last step's rows.

    The first begins with `box`, each other one with the box that the one before leaves. Raises Refused, Unusable,
    NotAsStated.
    """
    for k, name in enumerate(names):
        if Path(name).name != name:
            raise NotAsStated(f"{name} is no name of a certificate")
        accepted, last = _certificate(run / name, study, box, eps)
        hull = accepted.claims.enclosure
        if k + 1 < len(names):
            if hull is None:
                raise NotAsStated(f"{name} does not claim where the next certificate begins")
            lo, hi = ([float(v) for v in side] for side in hull)
            if (tuple(map(F, lo)), tuple(map(F, hi))) != hull:
                raise NotAsStated(f"{name} claims a box that float64 does not hold")
            box = box_of(lo, hi)
    return accepted, last


def _certificate(path: Path, study: HandEyeStudy, domain: Box, eps: float) -> tuple[Accepted, set[tuple[str, str]]]:
    """What a certificate proves, once its constraints are found to be those of the study at eps, and its box `domain`.

    And image and point of the constraints that its last step speaks of. Raises Refused, Unusable, NotAsStated.
    """
    accepted = check(path, work=_WORK)
    box = tuple(number(v) for v in domain.lo), tuple(number(v) for v in domain.hi)
    if tuple(tuple(number(v) for v in side) for side in (accepted.lo, accepted.hi)) != box:
        raise NotAsStated(f"{path.name} speaks of another box")
    if accepted.unknowns != UNKNOWNS:
        raise NotAsStated(f"{path.name} speaks of other unknowns")
    known = _numbers(study)
    rows, stated = ExactRows(study, eps, domain), []
    with path.open(encoding="utf-8") as lines:
        next(lines)
        for text, _ in zip(lines, range(accepted.count), strict=False):
            k = known.get(str(json.loads(text)["name"]))
            if k is None or json.loads(text) != json.loads(line(stated_line(rows.stated(k)))):
                raise NotAsStated(f"{path.name} states a constraint that is not the study's at {eps!r} px")
            stated.append(k)
        *_, last = lines
    return accepted, set(_pixels(study, stated, json.loads(last)))


def _pixels(study: HandEyeStudy, stated: list[int], step: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for _, place in step.get("rows", []):
        meaning = row_meaning(stated[place], len(study.image))
        if meaning is not None:
            yield study.images[study.image[meaning[0]]], study.names[meaning[0]]


def _numbers(study: HandEyeStudy) -> dict[str, int]:
    """The number of each constraint by its name."""
    count = len(study.image)
    names = {f"rotation {k}": k for k in range(len(EQUATIONS))}
    for point in range(count):
        label = f"{study.images[study.image[point]]}/{study.names[point]}"
        for axis in (0, 1):
            for below in (False, True):
                name = f"{label} {'uv'[axis]} {'below' if below else 'above'}"
                names[name] = row_number(point, axis, below, count)
    return names
