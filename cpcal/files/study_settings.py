"""Reads study.toml: every problem with its line number, whatever the state of the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import Problems, shown
from cpcal.files.campaign_settings import SettingsReader
from cpcal.files.study_writer import STUDY_FORMAT
from cpcal.files.toml_reader import Table
from cpcal.robot import Mechanisms, Pose, Robot, Truth
from cpcal.robot.campaign_problems import QUATERNION_TOLERANCE, quaternion_problem
from cpcal.robot.mechanisms import FIELDS, wrong_value

_SECTIONS = ("robot", "provenance", "truth")
_TRUTH_KEYS = ("seed", "parameters", "camera", "target", "mechanisms")


@dataclass(frozen=True)
class StudySettings:
    """What study.toml says; `robot` is None where it is unusable. `legs`: their number, as far as it can be told."""

    robot: Robot | None
    legs: int | None
    truth: Truth | None
    provenance: dict[str, str]


def read_study_settings(content: bytes, where: str, problems: Problems) -> StudySettings:
    """The settings in the bytes of a study.toml called `where`; adds to `problems`."""
    reader = _StudyReader.of(content, where, STUDY_FORMAT, _SECTIONS, problems)
    if reader is None:
        return StudySettings(None, None, None, {})
    robot, legs = reader.robot()
    return StudySettings(robot, legs, reader.true_values(robot, legs), reader.provenance())


class _StudyReader(SettingsReader):
    def true_values(self, robot: Robot | None, legs: int | None) -> Truth | None:
        """The section [truth]; None where there is none, or a problem."""
        table = self.section("truth")
        if table is None:
            return None
        before = len(self.problems)
        self.whole_part(("truth",), table, _TRUTH_KEYS)
        seed = table.get("seed", 0)
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            self.wrong(("truth", "seed"), f"seed is {shown(seed)}", "give a whole number from 0")
            seed = 0
        meaning = "ax, ay, az, bx, by, bz, l in mm"
        parameters = self.rows(("truth", "parameters"), table, 7, meaning, by_leg=True, legs=legs)
        camera, target = self.pose("camera", table), self.pose("target", table)
        mechanisms = self.mechanisms(table, legs)
        if len(self.problems) > before or robot is None or camera is None or target is None or mechanisms is None:
            return None
        return Truth(seed, Robot.from_parameters(robot.name, parameters), mechanisms, camera, target)

    def whole_part(self, path: tuple[str, ...], table: Table, keys: tuple[str, ...]) -> None:
        """Take note of keys that mean nothing, and of those that are missing."""
        self.known(path, table, keys)
        self.complete(path, table, keys, "add {key}, or take [truth] out")

    def part(self, name: str, table: Table, keys: tuple[str, ...]) -> Table | None:
        """The section [truth.name]."""
        if name not in table:
            return None
        values = table[name]
        if not isinstance(values, dict):
            self.wrong(("truth", name), f"{name!r} is not a section", f"write a section [truth.{name}]")
            return None
        self.whole_part(("truth", name), values, keys)
        return values

    def pose(self, name: str, table: Table) -> Pose | None:
        values = self.part(name, table, ("position", "quaternion"))
        if values is None:
            return None
        before, path = len(self.problems), ("truth", name)
        position = self.numbers((*path, "position"), values, 3, "x, y and z in mm", signed=True)
        quaternion = self.numbers((*path, "quaternion"), values, 4, "qw, qx, qy and qz", signed=True)
        if len(self.problems) > before:
            return None
        norm = math.hypot(*quaternion)
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            self.wrong((*path, "quaternion"), *quaternion_problem(norm))
        return Pose(np.array(position, dtype=np.float64), np.array(quaternion, dtype=np.float64))

    def mechanisms(self, table: Table, legs: int | None) -> Mechanisms | None:
        values = self.part("mechanisms", table, tuple(FIELDS))
        if values is None:
            return None
        before = len(self.problems)
        read = {name: self.field(name, width, values, legs) for name, width in FIELDS.items() if name in values}
        whole = legs is not None and len(read) == len(FIELDS) and len(self.problems) == before
        return Mechanisms(**read) if whole else None  # type: ignore[arg-type]

    def field(self, name: str, width: int | None, values: Table, legs: int | None) -> Floats | float:
        """One value of the mechanisms: a number, one number a leg, or one row a leg."""
        path, before = ("truth", "mechanisms", name), len(self.problems)
        read: object
        if width is None:
            read = self.number(path, name, values[name], signed=True)
        elif width == 1:
            read = self.numbers(path, values, legs, "one for each leg", signed=True)
        else:
            read = self.rows(path, values, width, f"{width} numbers for each leg", by_leg=True, legs=legs)
        if len(self.problems) > before:
            return np.zeros(0)
        array = np.array(read, dtype=np.float64)
        if (wrong := wrong_value(name, array)) is not None:
            self.wrong(path, f"{name} {wrong[0]}", wrong[1])
        return float(array) if width is None else array
