"""Reads campaign.toml: every problem with its line number, whatever the state of the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.errors import InputError, Problems, shown
from cpcal.common.names import NAME_MAX
from cpcal.files.campaign_writer import FORMAT
from cpcal.files.toml_reader import Table, TomlReader
from cpcal.robot import EXACT_OR_NOT, ModelChoice, Robot, Uncertainty

_SECTIONS = ("robot", "uncertainty", "model", "provenance")
_ROBOT_KEYS = ("name", "base", "mobile", "offset")
_SIGMA_KEYS = ("position_sigma", "rotation_sigma", "length_sigma")
_WIDTH_KEYS = ("position_half_width", "rotation_half_width", "length_half_width")
_UNITS = {"position": "mm", "rotation": "rad", "length": "mm"}


@dataclass(frozen=True)
class Settings:
    """What campaign.toml says; `robot` is None where it is unusable, `uncertainty` also where readings are exact.

    `legs` is the number of legs as far as it can be told (to read on), or None.
    """

    robot: Robot | None
    legs: int | None
    uncertainty: Uncertainty | None
    provenance: dict[str, str]
    model: ModelChoice | None = None


def read_settings(content: bytes, where: str, problems: Problems) -> Settings:
    """The settings in the bytes of a campaign.toml called `where`; adds to `problems`."""
    reader = SettingsReader.of(content, where, FORMAT, _SECTIONS, problems)
    if reader is None:
        return Settings(None, None, None, {})
    robot, legs = reader.robot()
    return Settings(robot, legs, reader.uncertainty(legs), reader.provenance(), reader.model())


class SettingsReader(TomlReader):
    """Reads the sections of campaign.toml, of which study.toml has some too."""

    def robot(self) -> tuple[Robot | None, int | None]:
        """The robot, or None; and the number of its legs, as far as it can be told."""
        before, path = len(self.problems), ("robot",)
        table = self.required("robot", _ROBOT_KEYS)
        if table is None:
            return None, None
        name = self.name(("robot", "name"), table)
        counts = [len(value) for key in _ROBOT_KEYS[1:] if isinstance(value := table.get(key), list)]
        legs = counts[0] if counts else None
        meaning = "x, y and z in mm"
        base, mobile = (self.rows((*path, key), table, 3, meaning, by_leg=True, legs=legs) for key in _ROBOT_KEYS[1:3])
        offset = self.numbers(("robot", "offset"), table, legs, "one for each leg", signed=True)
        if len(self.problems) > before:
            return None, legs or None
        return Robot(name, np.array(base), np.array(mobile), np.array(offset)), legs

    def uncertainty(self, legs: int | None) -> Uncertainty | None:
        """The section [uncertainty], which says how far readings may be off, or that they are exact: None."""
        before, path = len(self.problems), ("uncertainty",)
        table = self.section("uncertainty")
        if table is None and "uncertainty" not in self.document:
            self.wrong((), "the section [uncertainty] is missing", EXACT_OR_NOT)
        if table is None:
            return None
        self.known(path, table, ("exact", "factor", *_SIGMA_KEYS, *_WIDTH_KEYS))
        if "exact" in table:
            self._exactly(path, table)
            return None
        direct = any(key in table for key in _WIDTH_KEYS)
        if direct and any(key in table for key in ("factor", *_SIGMA_KEYS)):
            remedy = "give either factor and three *_sigma, or three *_half_width"
            self.wrong(path, "half-widths are given both directly and as factor * sigma", remedy)
            return None
        keys = _WIDTH_KEYS if direct else _SIGMA_KEYS
        self.complete(path, table, keys if direct else ("factor", *keys), f"add {{key}}; {EXACT_OR_NOT}")
        values = [self._kind(key.partition("_")[0], (*path, key), table, legs) for key in keys]
        factor = None if direct else self.number((*path, "factor"), "factor", table.get("factor", 0), signed=False)
        if len(self.problems) > before or legs is None:
            return None
        position, rotation, length = (np.array(row) for row in values)
        try:
            return Uncertainty(position, rotation, length, factor)
        except InputError:  # single values were checked: a product overflows
            self.wrong(path, "factor * sigma is too large for a number", "give smaller ones")
            return None

    def _exactly(self, path: tuple[str, ...], table: Table) -> None:
        """Check that `exact` is true, and alone."""
        if table["exact"] is not True:
            self.wrong((*path, "exact"), f"exact is {shown(table['exact'])}", EXACT_OR_NOT)
        elif len(table) > 1:
            other = next(key for key in table if key != "exact")
            self.wrong((*path, other), f"readings are exact, and {shown(other)} is given too", EXACT_OR_NOT)

    def _kind(self, kind: str, path: tuple[str, ...], table: Table, legs: int | None) -> list[float]:
        """The numbers of one kind of reading."""
        if kind == "length":
            return self.numbers(path, table, legs, f"one for each leg, {_UNITS[kind]}", signed=False)
        return self.numbers(path, table, 3, f"three, {_UNITS[kind]}", signed=False)

    def model(self) -> ModelChoice | None:
        """The table [model]: its form. Which models there are is known where they are used."""
        table = self.section("model")
        if table is None:
            return None
        before, path = len(self.problems), ("model",)
        self.known(path, table, ("name", "half_widths"))
        name, widths = table.get("name"), table.get("half_widths", {})
        if not (isinstance(name, str) and name.isidentifier() and len(name) <= NAME_MAX):
            what = f"the model's name {shown(name)} cannot be one" if "name" in table else "[model] has no name"
            self.wrong((*path, "name"), what, 'add a name, such as name = "gain"')
        if not isinstance(widths, dict):
            self.wrong((*path, "half_widths"), "half_widths is not a table", "write half_widths = { s = 0.05 }")
            return None
        numbers = {}
        for key, value in widths.items():
            if not (key.isidentifier() and len(key) <= NAME_MAX):
                self.wrong((*path, "half_widths"), f"{shown(key)} cannot be a parameter", "give its name, such as s")
            numbers[key] = self.number((*path, "half_widths"), f"the half-width of {shown(key)}", value, signed=False)
        return None if len(self.problems) > before else ModelChoice(str(name), numbers)
