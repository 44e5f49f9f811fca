"""What is wrong with the values of a campaign, one problem after the other."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import Problem, shown
from cpcal.common.names import IDENTIFIER_REMEDY, NAME_REMEDY, TEXT_REMEDY, is_identifier, is_name, is_text
from cpcal.robot.robot import LARGEST, good_numbers
from cpcal.robot.uncertainty import sizes

if TYPE_CHECKING:
    from cpcal.robot.campaign import Campaign

QUATERNION_TOLERANCE = 1e-6  # on | |q| - 1 |
ARRAYS = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")


def shape_problems(campaign: Campaign) -> Iterator[Problem]:
    """What is wrong with the sizes and the texts."""
    count, legs = len(campaign.pose), campaign.robot.legs
    remedy = f"give one row for each of the {count} measurements"
    if count == 0:
        yield Problem("campaign", "holds no measurements", "give at least one")
    if len(campaign.run) != count:
        yield Problem("campaign run", f"has {len(campaign.run)} names", remedy)
    for name, width in zip(ARRAYS, (3, 4, legs, 3, 3, legs), strict=True):
        shape = getattr(campaign, name).shape
        if shape != (count, width):
            yield Problem(f"campaign {name}", f"has the shape {shape}, not {(count, width)}", remedy)
    stated = campaign.uncertainty
    if stated is not None and stated.length.shape != (legs,):
        what = f"has {len(stated.length)} numbers for {legs} legs"
        yield Problem("campaign uncertainty.length", what, "give one for each leg")
    yield from provenance_problems("campaign", campaign.provenance)


def provenance_problems(where: str, provenance: Mapping[str, str]) -> Iterator[Problem]:
    """What is wrong with the texts of a provenance."""
    for key, text in provenance.items():
        if not is_name(key):
            yield Problem(f"{where} provenance", f"{shown(key)} cannot be a name", NAME_REMEDY)
        if not is_text(text):
            yield Problem(f"{where} provenance {shown(key)}", f"is {shown(text)}", TEXT_REMEDY)


def value_problems(campaign: Campaign) -> Iterator[Problem]:
    """What is wrong with the values, measurement by measurement."""
    for kind, names in (("pose", campaign.pose), ("run", campaign.run)):
        for bad in sorted({shown(name) for name in set(names) if not is_identifier(name)}):
            yield Problem(f"campaign {kind}", f"{bad} cannot be a name", IDENTIFIER_REMEDY)
    keys = list(zip(campaign.pose, campaign.run, strict=True))
    if len(set(keys)) < len(keys):
        for key, times in Counter(keys).items():
            if times > 1:
                yield Problem(f"measurement {'/'.join(key)}", f"is given {times} times", "give each pose and run once")
    for name in ARRAYS:
        array: Floats = getattr(campaign, name)
        allowed = sizes(array) if name.endswith("radius") else good_numbers(array)
        what = f"is {'negative, ' * name.endswith('radius')}NaN, infinite or above {LARGEST:g}"
        for row in np.flatnonzero(~allowed.all(axis=1)):
            yield Problem(f"measurement {'/'.join(keys[row])}", f"its {name} {what}", "correct it, or leave it out")
    with np.errstate(all="ignore"):  # what is not finite was named above
        far = np.abs(np.linalg.norm(campaign.quaternion, axis=1) - 1.0) > 0.5 * QUATERNION_TOLERANCE
    for row in np.flatnonzero(far):
        norm = math.hypot(*campaign.quaternion[row].tolist())
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            yield Problem(f"measurement {'/'.join(keys[row])}", *quaternion_problem(norm))


def quaternion_problem(norm: float) -> tuple[str, str]:
    """What is wrong with a quaternion of that norm, and the remedy."""
    if norm == 0.0:
        return (
            "the quaternion is zero, which is no rotation",
            "give qw,qx,qy,qz of norm 1 (no rotation: 1,0,0,0)",
        )
    what = f"the quaternion has the norm {norm:.9g}, not 1 (to within {QUATERNION_TOLERANCE:g})"
    return what, "divide it by its norm, and check the order qw,qx,qy,qz"
