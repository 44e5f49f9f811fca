"""What users have in memory, as the arguments of a campaign: arrays or tables, in their units and rotation forms."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, as_floats
from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, shown
from cpcal.robot.columns import (
    ColumnSource,
    column_map,
    half_widths,
    is_angle,
    is_length,
    override_columns,
    reading_columns,
    require,
    unit_problem,
)
from cpcal.robot.known_robots import known_robot
from cpcal.robot.robot import Robot
from cpcal.robot.rotation_form import RotationForm
from cpcal.robot.uncertainty import KINDS, Uncertainty
from cpcal.robot.units import ANGLES, LENGTHS, length_factor


class DataFrame(Protocol):
    """What is used of a pandas DataFrame."""

    @property
    def columns(self) -> Any: ...

    @property
    def iloc(self) -> Any: ...


def stated_robot(
    robot: Robot | str | None,
    base: npt.ArrayLike | None,
    mobile: npt.ArrayLike | None,
    offset: npt.ArrayLike | None,
    name: str | None,
) -> Robot:
    """The robot that was given, whole, by its name in the catalogue, or by its joint centres."""
    parts = {"base": base, "mobile": mobile, "offset": offset}
    given = [key for key, value in parts.items() if value is not None]
    if robot is not None:
        if given:
            raise InputError([Problem("robot", f"is given, and {given[0]} too", "give one of the two")])
        return known_robot(robot).robot if isinstance(robot, str) else robot
    missing = [key for key in parts if key not in given]
    if missing:
        remedy = "give base=(n, 3), mobile=(n, 3) and offset=(n,) in mm, or robot="
        raise InputError([Problem("robot", f"{' and '.join(missing)} missing", remedy)])
    return Robot("robot" if name is None else name, *(np.asanyarray(value) for value in parts.values()))


def stated_uncertainty(
    legs: int,
    sigmas: Mapping[str, npt.ArrayLike | None],
    factor: float,
    uncertainty: Uncertainty | None,
) -> Uncertainty | None:
    """The uncertainty that standard deviations state; one number stands for all axes, or all legs."""
    given = {kind: value for kind in KINDS if (value := sigmas[kind]) is not None}
    if not given:
        return uncertainty
    if uncertainty is not None:
        what = f"is given, and {next(iter(given))}_sigma too"
        raise InputError([Problem("campaign uncertainty", what, "give one of the two")])
    missing = [f"{kind}_sigma" for kind in KINDS if kind not in given]
    if missing:
        what = f"{' and '.join(missing)} missing"
        raise InputError([Problem("campaign uncertainty", what, "give all three; 0 is exact")])
    shapes = {"position": 3, "rotation": 3, "length": legs}
    try:
        rows = [np.broadcast_to(as_floats(given[kind]), shapes[kind]) for kind in KINDS]
    except (TypeError, ValueError) as error:
        remedy = f"give one number, or 3, 3 and {legs}"
        raise InputError([Problem("campaign uncertainty", str(error)[:200], remedy)]) from None
    return Uncertainty(rows[0], rows[1], rows[2], factor)


def in_mm(values: npt.ArrayLike, unit: str, where: str) -> Floats:
    """An array of lengths. Raises InputError."""
    if isinstance(values, Robot):
        remedy = "give positions, rotations and lengths first, and the robot as robot=; or use Campaign.of"
        raise InputError([Problem(where, "are a Robot, not numbers", remedy)])
    factor = length_factor(unit, where)
    if isinstance(factor, Problem):
        raise InputError([factor])
    try:
        array = as_floats(values)
    except (TypeError, ValueError) as error:
        raise InputError([Problem(where, str(error)[:200], "give an array of numbers")]) from None
    return array if factor == 1.0 else np.asarray(factor * array)


def targets(legs: int, form: RotationForm) -> list[str]:
    """The names that columns can be mapped to."""
    fixed = [name for name in reading_columns(legs) if name not in ("qw", "qx", "qy", "qz")]
    return [*fixed, *form.columns, *override_columns(legs)]


def mapped(
    columns: str | Mapping[str, str], header: Sequence[str], legs: int, form: RotationForm
) -> dict[str, ColumnSource]:
    """The map of a table with this header; columns that are not mapped count under their own names.

    Raises InputError for columns that are not there, and units that cannot be.
    """
    names = targets(legs, form)
    found = column_map(columns, names)
    taken = {source.name for source in found.values()}
    for name in names:
        if name not in found and name not in taken and name in header:
            found[name] = ColumnSource(name)
    problems = Problems()
    for target, source in found.items():
        if source.place(header) is None and source.name in header:
            problems.add(Problem("map", f"{source.name!r} is there twice", 'give its number, as in "#2"'))
        elif source.place(header) is None:
            what = f"{target}: there is no column {shown(source.name)}"
            problems.add(Problem("map", what, "the columns are " + ", ".join(map(shown, header[:40]))))
        if (wrong := unit_problem(target, source.unit)) is not None:
            problems.add(wrong)
        if source.unit is None and is_angle(target) and target not in form.columns and source.name != target:
            problems.add(Problem("map", f"{target} has no unit", f"write {target}={source.name}[deg] or [rad]"))
    for one, other in itertools.combinations([name for name in found if re.fullmatch("L[0-9]+", name)], 2):
        if found[one].place(header) == found[other].place(header) is not None:
            what = f"{one} and {other} are the same column, {shown(found[one].name)}"
            problems.add(Problem("map", what, "map each leg to its own"))
    problems.raise_any(YOUR_DATA)
    require(found, [*(n for n in names[: 5 + legs] if n not in ("pose", "run")), *form.columns], "map")
    return found


def unit_factor(target: str, source: ColumnSource, form: RotationForm) -> float:
    """What a column's numbers are multiplied by to be in mm or rad, or as the rotation form takes them."""
    if is_length(target):
        return float(LENGTHS[source.unit or "mm"])
    if is_angle(target):
        own = form.unit if target in form.columns else "rad"
        return 1.0 if source.unit in (None, own) else ANGLES[str(source.unit)] / ANGLES[own]
    return 1.0


def table_arguments(
    names: Mapping[str, Sequence[str]],
    values: Mapping[str, Floats],
    robot: Robot,
    form: RotationForm,
    uncertainty: Uncertainty | None,
) -> dict[str, Any]:
    """The arguments of `Campaign.of` for columns by target, in mm and in the form's numbers."""
    legs, count = robot.legs, len(values["x"])
    stated = np.zeros(6 + legs) if uncertainty is None else uncertainty.half_widths
    radii = half_widths(stated, values, legs, count)
    rotations = np.stack([values[name] for name in form.columns], axis=1)
    arguments: dict[str, Any] = {
        "robot": robot,
        "position": np.stack([values[name] for name in "xyz"], axis=1),
        "quaternion": form.quaternions(rotations),
        "length": np.stack([values[f"L{i}"] for i in range(1, legs + 1)], axis=1),
        "uncertainty": uncertainty,
        "position_radius": radii[:, :3],
        "rotation_radius": radii[:, 3:6],
        "length_radius": radii[:, 6:],
    }
    return arguments | {key: list(column) for key, column in named_rows(names, count).items()}


def named_rows(names: Mapping[str, Sequence[str]], count: int) -> dict[str, Sequence[str]]:
    """Poses p1, p2, ... where none are named; runs that tell equal poses apart where none are named."""
    pose = names.get("pose") or [f"p{row}" for row in range(1, count + 1)]
    if "run" in names:
        return {"pose": pose, "run": names["run"]}
    counters: dict[str, itertools.count[int]] = {}
    return {"pose": pose, "run": [str(next(counters.setdefault(name, itertools.count(1)))) for name in pose]}


def frame_columns(
    frame: DataFrame, columns: str | Mapping[str, str], legs: int, form: RotationForm
) -> tuple[dict[str, list[str]], dict[str, Floats]]:
    """Names and numbers of a DataFrame, by target. Raises InputError."""
    header = [str(name) for name in frame.columns]
    names: dict[str, list[str]] = {}
    values: dict[str, Floats] = {}
    problems = Problems()
    for target, source in mapped(columns, header, legs, form).items():
        column = frame.iloc[:, source.place(header)]
        if target in ("pose", "run"):
            names[target] = [str(value) for value in column]
            continue
        try:
            values[target] = unit_factor(target, source, form) * as_floats(column)
        except (TypeError, ValueError) as error:
            problems.add(Problem(f"column {source.name!r}", str(error)[:200], "give numbers"))
    problems.raise_any(YOUR_DATA)
    return names, values
