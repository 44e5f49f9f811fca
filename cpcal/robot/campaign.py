"""Campaigns: a robot, the poses and leg readings measured on it, and how far each reading may be off.

A campaign is a value: arrays are private copies and read-only. `cpcal.files` reads and writes them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.names import IDENTIFIER_REMEDY, NAME_REMEDY, TEXT_REMEDY, is_identifier, is_name, is_text
from cpcal.common.values import Value, frozen_array, frozen_mapping
from cpcal.robot.model_choice import ModelChoice
from cpcal.robot.robot import LARGEST, Robot, good_numbers
from cpcal.robot.uncertainty import Uncertainty, sizes

QUATERNION_TOLERANCE = 1e-6  # on | |q| - 1 |
_ARRAYS = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")


@dataclass(frozen=True, eq=False)
class Campaign(Value):
    """N measurements of a robot with n legs; use `Campaign.from_arrays`, `load_campaign` or `simulate`.

    pose, run        N names each; `pose/run` is unique
    position         (N, 3) mm, P in the base frame
    quaternion       (N, 4) unit, scalar first; `P + R(q) b` maps mobile to base
    length           (N, n) mm, the readings L
    position_radius  (N, 3) mm, rotation_radius (N, 3) rad, length_radius (N, n) mm: half-widths of
                     the reading sets of DESIGN section 1: |P - P_k| <= p, R = R(1, s) R(q_k),
                     |2 s_i| <= r_i, |L - L_k| <= lambda
    uncertainty      what campaign.toml declares for all rows; None: `exact = true`; rows may differ
    provenance       free text
    model            the leg model that is asked for (None: the plain one)

    Raises InputError, with every problem found, when the values make no campaign.
    """

    robot: Robot
    pose: tuple[str, ...]
    run: tuple[str, ...]
    position: Floats
    quaternion: Floats
    length: Floats
    position_radius: Floats
    rotation_radius: Floats
    length_radius: Floats
    uncertainty: Uncertainty | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    model: ModelChoice | None = None
    # names and SHA-256 of the files that it was read from; set by the readers, not carried over by replace()
    files: tuple[tuple[str, str], ...] = field(default=(), init=False, compare=False)

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        object.__setattr__(self, "pose", tuple(self.pose))
        object.__setattr__(self, "run", tuple(self.run))
        object.__setattr__(self, "provenance", frozen_mapping(self.provenance))
        problems = Problems()
        for problem in shape_problems(self):
            problems.add(problem)
        if not problems:
            for problem in value_problems(self):
                problems.add(problem)
        problems.raise_any()

    @classmethod
    def from_arrays(
        cls,
        robot: Robot,
        position: npt.ArrayLike,
        quaternion: npt.ArrayLike,
        length: npt.ArrayLike,
        *,
        pose: Sequence[str] | None = None,
        run: Sequence[str] | None = None,
        uncertainty: Uncertainty | None = None,
        exact: bool = False,
        position_radius: npt.ArrayLike | None = None,
        rotation_radius: npt.ArrayLike | None = None,
        length_radius: npt.ArrayLike | None = None,
        provenance: Mapping[str, str] | None = None,
        model: ModelChoice | None = None,
    ) -> Campaign:
        """A campaign in memory. Half-widths left out come from `uncertainty`, or are zero with `exact=True`.

        One of the two, or all three half-widths, must be given: whether readings are exact changes every answer.
        position (N, 3) mm, quaternion (N, 4), length (N, n) mm; half-widths broadcast to these shapes.
        Poses left out are named p0, p1, ...; runs left out are all "1". Raises InputError.
        """
        radii_given = [values is not None for values in (position_radius, rotation_radius, length_radius)]
        _check_choice(uncertainty, exact, radii_given)
        try:
            arrays = [np.asarray(values, dtype=np.float64) for values in (position, quaternion, length)]
            given = [
                None if values is None else np.asarray(values, dtype=np.float64)
                for values in (position_radius, rotation_radius, length_radius)
            ]
        except (TypeError, ValueError) as error:
            raise InputError([Problem("campaign", str(error), "give arrays of numbers")]) from None
        count = len(arrays[0]) if arrays[0].ndim else 0
        shapes = ((count, 3), (count, 3), (count, robot.legs))
        declared = (None, None, None) if uncertainty is None else (np.split(uncertainty.half_widths, [3, 6]))
        radii = [_radius(*row) for row in zip(given, declared, shapes, strict=True)]
        return cls(
            robot,
            tuple(f"p{k}" for k in range(count)) if pose is None else tuple(pose),
            ("1",) * count if run is None else tuple(run),
            arrays[0],
            arrays[1],
            arrays[2],
            radii[0],
            radii[1],
            radii[2],
            uncertainty,
            dict(provenance or {}),
            model,
        )

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return self.robot.legs

    def __len__(self) -> int:
        """The number of measurements, N."""
        return len(self.pose)

    @property
    def measurement_ids(self) -> list[str]:
        """`pose/run` of every measurement, in order."""
        return [f"{pose}/{run}" for pose, run in zip(self.pose, self.run, strict=True)]

    @property
    def exact(self) -> bool:
        """Whether every reading set is a single point."""
        return not (self.position_radius.any() or self.rotation_radius.any() or self.length_radius.any())

    def __repr__(self) -> str:
        return f"<Campaign of {self.robot.name!r}: {len(self)} measurements, {self.legs} legs>"


def _check_choice(uncertainty: Uncertainty | None, exact: bool, radii_given: list[bool]) -> None:
    """InputError unless it was said how far readings may be off."""
    if exact and uncertainty is not None:
        what = "is given, and readings are called exact"
    elif exact or uncertainty is not None or all(radii_given):
        return
    else:
        what = "is missing"
    remedy = "give uncertainty=Uncertainty(...), or exact=True, or position_radius, rotation_radius and length_radius"
    raise InputError([Problem("campaign uncertainty", what, remedy)])


def _radius(given: Floats | None, declared: Floats | None, shape: tuple[int, int]) -> Floats:
    """Half-widths of that shape; what cannot be broadcast is left for the validation to report."""
    values = given if given is not None else declared
    if values is None:
        return np.zeros(shape)
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        return values


def shape_problems(campaign: Campaign) -> Iterator[Problem]:
    """What is wrong with the sizes and the texts."""
    count, legs = len(campaign.pose), campaign.robot.legs
    remedy = f"give one row for each of the {count} measurements"
    if count == 0:
        yield Problem("campaign", "holds no measurements", "give at least one")
    if len(campaign.run) != count:
        yield Problem("campaign run", f"has {len(campaign.run)} names", remedy)
    for name, width in zip(_ARRAYS, (3, 4, legs, 3, 3, legs), strict=True):
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
        for bad in sorted({shown(name) for name in names if not is_identifier(name)}):
            yield Problem(f"campaign {kind}", f"{bad} cannot be a name", IDENTIFIER_REMEDY)
    keys = campaign.measurement_ids
    for key, times in Counter(keys).items():
        if times > 1:
            yield Problem(f"measurement {key}", f"is given {times} times", "give each pose and run once")
    for name in _ARRAYS:
        array: Floats = getattr(campaign, name)
        allowed = sizes(array) if name.endswith("radius") else good_numbers(array)
        what = f"is {'negative, ' * name.endswith('radius')}NaN, infinite or above {LARGEST:g}"
        for row in np.flatnonzero(~allowed.all(axis=1)):
            yield Problem(f"measurement {keys[row]}", f"its {name} {what}", "correct it, or leave it out")
    for key, row in zip(keys, campaign.quaternion.tolist(), strict=True):
        norm = math.hypot(*row)
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            yield Problem(f"measurement {key}", *quaternion_problem(norm))


def quaternion_problem(norm: float) -> tuple[str, str]:
    """What is wrong with a quaternion of that norm, and the remedy."""
    if norm == 0.0:
        return (
            "the quaternion is zero, which is no rotation",
            "give qw,qx,qy,qz of norm 1 (no rotation: 1,0,0,0)",
        )
    what = f"the quaternion has the norm {norm:.9g}, not 1 (to within {QUATERNION_TOLERANCE:g})"
    return what, "divide it by its norm, and check the order qw,qx,qy,qz"
