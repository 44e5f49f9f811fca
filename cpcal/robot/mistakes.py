"""The table of mistakes that people make when they enter data, each with what undoes it.

The drawing of a robot is off by manufacturing errors only, so legs are as long as the readings say to within a few
percent. Where they are not, every mistake of the table is undone on trial; the one after which drawing and readings
agree is named. A name is a likely cause; nothing of it is proved.

A mistake is a function of what is `Given` that yields, for each of its variants, a sentence and what would be given
without it. One that chooses or fits numbers to make things agree also fits what is no mistake: it must leave less than
one that does not choose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cpcal.robot.given import Given
from cpcal.robot.mistaken_frames import inverse_poses, other_axes, other_frames
from cpcal.robot.mistaken_legs import (
    counts,
    inches_in_one_leg,
    lost_offset,
    other_order,
    shifted_joints,
    shifted_rows,
    whole_lengths,
    wrong_sign,
)
from cpcal.robot.mistaken_rotations import (
    degrees_as_radians,
    euler_order,
    radians_as_degrees,
    scalar_last,
    transposed,
)
from cpcal.robot.units import LENGTHS, NAMES

Variants = Iterator[tuple[str, Given]]

SHARE = 0.05  # of the leg length: larger nominal residuals are suspicious
_BETTER = 0.34  # a mistake is named when it leaves at most this share of the residuals
_ROWS = 400  # of a campaign suffice to tell
_CLEAR = 0.1  # of the residuals: with so little left no other mistake needs to be tried
_FITTED = 0.02  # what a mistake that fits numbers may leave at most
_EQUAL = 1.0 - 1e-6  # two that differ by rounding are the same: the first one counts


@dataclass(frozen=True)
class Mistake:
    """See the module. What is left is multiplied by `handicap`. A `unit` mistake may come together with another."""

    undone: Callable[[Given], Variants]
    handicap: float = 1.0
    limit: float = SHARE
    unit: bool = False


def units(given: Given) -> Variants:
    """Lengths in another unit than mm."""
    place, quaternion = given.pose.position, given.pose.quaternion
    for unit, size in LENGTHS.items():
        factor = float(size)
        if factor == 1.0:
            continue
        name, scaled = NAMES[unit], given.posed(factor * place, quaternion)
        yield f"positions are in {name}, not mm", scaled
        yield f"leg readings are in {name}, not mm", given.read(factor * given.length)
        yield f"positions and leg readings are in {name}, not mm", scaled.read(factor * given.length)
        yield f"the drawing is in {name}, not mm", given.drawn(factor * given.robot.parameters)


MISTAKES = (
    Mistake(units, unit=True),
    Mistake(scalar_last),
    Mistake(transposed),
    Mistake(inverse_poses),
    Mistake(other_axes),
    Mistake(whole_lengths),
    Mistake(wrong_sign),
    Mistake(shifted_joints),
    Mistake(inches_in_one_leg),
    Mistake(shifted_rows),
    Mistake(other_order, 1.5),
    Mistake(euler_order, 1.5),
    Mistake(radians_as_degrees, 1.5),
    Mistake(degrees_as_radians, 4.0, _FITTED),
    Mistake(lost_offset, 8.0, _FITTED),
    Mistake(counts, 8.0, _FITTED),
)
_LAST = (Mistake(other_frames, 8.0, _FITTED),)  # twelve numbers, and slow: tried when nothing else helps


def likely_cause(given: Given) -> str | None:
    """The mistake that, undone, leaves the smallest residuals, if they are small then."""
    few = given.sampled(_ROWS)
    typical = few.most
    with np.errstate(all="ignore"):
        return _best(given, few, MISTAKES, typical) or _pair(few, typical) or _best(given, few, _LAST, typical)


def _best(given: Given, few: Given, mistakes: tuple[Mistake, ...], typical: float) -> str | None:
    best, cause = math.inf, None
    for mistake in mistakes:
        if mistake.limit < SHARE >= typical:
            continue  # what is small can be fitted away, and is what calibration is for
        start = given if mistake.undone is shifted_rows else few  # neighbours must stay together
        for name, without in mistake.undone(start):
            left = without.most
            if left < min(mistake.limit, _BETTER * typical) and left * mistake.handicap < best * _EQUAL:
                best, cause = left * mistake.handicap, name
        if best < min(_FITTED, _CLEAR * typical):
            break  # the table has what is simple first
    return cause


def _pair(given: Given, typical: float) -> str | None:
    """A wrong unit and one more mistake."""
    best, cause = min(SHARE, _BETTER * typical), None
    for unit in (mistake for mistake in MISTAKES if mistake.unit):
        for first, scaled in unit.undone(given):
            for other in (mistake for mistake in MISTAKES if not mistake.unit and mistake.handicap == 1.0):
                for second, without in other.undone(scaled):
                    left = without.most
                    if left < best:
                        best, cause = left, f"{first}, and {second}"
    return cause
