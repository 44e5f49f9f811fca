"""Campaigns: a robot, the poses and leg readings measured on it, and how far each reading may be off.

A campaign is a value: arrays are private copies and read-only. `cpcal.files` reads and writes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, as_floats
from cpcal.common.errors import InputError, Problem, Problems
from cpcal.common.values import Value, frozen_array, frozen_mapping
from cpcal.robot.campaign_arrays import (
    DataFrame,
    frame_columns,
    in_mm,
    stated_robot,
    stated_uncertainty,
    table_arguments,
)
from cpcal.robot.campaign_problems import ARRAYS, shape_problems, value_problems
from cpcal.robot.columns import override_columns, reading_columns
from cpcal.robot.model_choice import ModelChoice
from cpcal.robot.robot import Robot
from cpcal.robot.rotation_form import RotationForm
from cpcal.robot.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class Campaign(Value):
    """N measurements of a robot with n legs.

    Use `load_campaign`, `Campaign.from_arrays`, `Campaign.from_frame` or `simulate`; `Campaign.of` takes what is in
    cpcal's own units and frames already.

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
        for name in ARRAYS:
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
    def of(
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
        check_choice(uncertainty, exact, radii_given)
        try:
            arrays = [as_floats(values) for values in (position, quaternion, length)]
            given = [
                None if values is None else as_floats(values)
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

    @classmethod
    def from_arrays(
        cls,
        positions: npt.ArrayLike,
        rotations: npt.ArrayLike | Any,
        lengths: npt.ArrayLike,
        *,
        base: npt.ArrayLike | None = None,
        mobile: npt.ArrayLike | None = None,
        offset: npt.ArrayLike | None = None,
        name: str | None = None,
        robot: Robot | str | None = None,
        rotation: str = "quaternion-wxyz",
        position_unit: str = "mm",
        length_unit: str = "mm",
        position_sigma: npt.ArrayLike | None = None,
        rotation_sigma: npt.ArrayLike | None = None,
        length_sigma: npt.ArrayLike | None = None,
        factor: float = 3.0,
        uncertainty: Uncertainty | None = None,
        exact: bool = False,
        pose: Sequence[str] | None = None,
        run: Sequence[str] | None = None,
        provenance: Mapping[str, str] | None = None,
        model: ModelChoice | None = None,
    ) -> Campaign:
        """A campaign of N measurements of n legs in memory, in the units and the rotation form that are named.

        positions      (N, 3), P in the base frame; `position_unit` mm, cm, m, um or in
        rotations      (N, ...) in the form `rotation`: quaternion-wxyz or quaternion-xyzw (N, 4), matrix (N, 3, 3),
                       vector-rad or vector-deg (N, 3), euler-xyz-deg, euler-ZYX-rad, ... (N, 3), or a scipy Rotation.
                       `P + R b` maps mobile to base
        lengths        (N, n), the readings; `length_unit` as for positions
        base, mobile   (n, 3) mm, joint centres; offset (n,) mm, what a reading lacks of the leg's length; name
        robot          instead of these four: a Robot, or one of the catalogue (`cpcal robot list`)
        ..._sigma      standard deviations: position (3,) mm, rotation (3,) rad, lengths (n,) mm, or one number for all.
                       Half-widths are `factor` times them. Or give an `uncertainty`, or say that readings are `exact`
        pose, run      N names; left out: p0, p1, ... and all "1"

        Raises InputError, with every problem found.
        """
        form = RotationForm.named(rotation)
        position, length = in_mm(positions, position_unit, "positions"), in_mm(lengths, length_unit, "lengths")
        built = stated_robot(robot, base, mobile, offset, name)
        sigmas = {"position": position_sigma, "rotation": rotation_sigma, "length": length_sigma}
        return cls.of(
            built,
            position,
            form.quaternions(rotations),
            length,
            pose=pose,
            run=run,
            uncertainty=stated_uncertainty(built.legs, sigmas, factor, uncertainty),
            exact=exact,
            provenance=provenance,
            model=model,
        )

    @classmethod
    def from_frame(
        cls,
        frame: DataFrame,
        *,
        robot: Robot | str,
        columns: str | Mapping[str, str] = "",
        rotation: str = "quaternion-wxyz",
        position_sigma: npt.ArrayLike | None = None,
        rotation_sigma: npt.ArrayLike | None = None,
        length_sigma: npt.ArrayLike | None = None,
        factor: float = 3.0,
        uncertainty: Uncertainty | None = None,
        exact: bool = False,
        provenance: Mapping[str, str] | None = None,
        model: ModelChoice | None = None,
    ) -> Campaign:
        """A campaign of a pandas DataFrame: one row for each measurement.

        columns  how its columns are called and what their units are, as `cpcal import --map` has it: "x=Tx[m], ..."
                 or {"x": "Tx[m]", ...}. Columns with the names of measurements.csv need no entry
        rotation and the rest: see `from_arrays`

        Raises InputError, with every problem found.
        """
        form = RotationForm.named(rotation)
        built = stated_robot(robot, None, None, None, None)
        names, values = frame_columns(frame, columns, built.legs, form)
        sigmas = {"position": position_sigma, "rotation": rotation_sigma, "length": length_sigma}
        stated = stated_uncertainty(built.legs, sigmas, factor, uncertainty)
        arguments = table_arguments(names, values, built, form, stated)
        if stated is None and not exact and not set(override_columns(built.legs)) <= set(values):
            check_choice(None, False, [False])
        return cls.of(**arguments, exact=exact, provenance=provenance, model=model)

    def to_frame(self) -> Any:
        """A pandas DataFrame with the columns of measurements.csv, all half-widths included; needs pandas.

        `Campaign.from_frame(frame, robot=campaign.robot, uncertainty=campaign.uncertainty)` gives it back.
        """
        try:
            import pandas
        except ImportError:
            raise InputError([Problem("to_frame", "needs pandas", "pip install 'cpcal[frames]'")]) from None
        parts = (self.position, self.quaternion, self.length)
        radii = (self.position_radius, self.rotation_radius, self.length_radius)
        numbers = np.concatenate([*parts, *radii], axis=1)
        titles = [*reading_columns(self.legs)[2:], *override_columns(self.legs)]
        frame = pandas.DataFrame(numbers, columns=titles)
        frame.insert(0, "pose", list(self.pose))
        frame.insert(1, "run", list(self.run))
        return frame

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


def check_choice(uncertainty: Uncertainty | None, exact: bool, radii_given: list[bool]) -> None:
    """InputError unless it was said how far readings may be off."""
    if exact and uncertainty is not None:
        what = "is given, and readings are called exact"
    elif exact or uncertainty is not None or all(radii_given):
        return
    else:
        what = "is missing"
    remedy = (
        "give the standard deviations (position_sigma=, rotation_sigma=, length_sigma=), uncertainty=Uncertainty(...), "
        "all three half-widths, or exact=True"
    )
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
