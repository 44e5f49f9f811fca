"""The columns of a table of measurements, and how the columns of a foreign table are mapped to them.

    x = Tx[m], y = Ty[m], z = Tz[m], r1 = A[deg], L1 = "leg 1", L2 = #14

A target, "=", and the name of a column in the table, or "#" and its number from 1; in brackets its unit. A name that
holds a comma, a bracket or a space at an end stands in double quotes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, shown
from cpcal.robot.units import ANGLES, LENGTHS

SHARED_COLUMNS = [f"shared_s{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")]  # of a study's tables, see PoseTable

_ENTRY = re.compile(r'\s*([A-Za-z]\w*)\s*=\s*(?:"([^"]*)"|([^,\["]*?))\s*(?:\[\s*(\w*)\s*\])?\s*(?:,|$)')


def reading_columns(legs: int) -> list[str]:
    """The columns that every measurements.csv has, for n legs."""
    return ["pose", "run", "x", "y", "z", "qw", "qx", "qy", "qz", *(f"L{i}" for i in range(1, legs + 1))]


def override_columns(legs: int) -> list[str]:
    """The optional columns: half-widths (mm, rad, mm) that replace those of campaign.toml row by row."""
    return ["dx", "dy", "dz", "drx", "dry", "drz", *(f"dL{i}" for i in range(1, legs + 1))]


@dataclass(frozen=True)
class ColumnSource:
    """A column of a foreign table: its name, or its number from 1; and its unit, where one is given."""

    name: str
    unit: str | None = None

    def place(self, header: Sequence[str]) -> int | None:
        """Which column it is, from 0; None where there is none, or several of that name."""
        if re.fullmatch(r"#[1-9][0-9]{0,4}", self.name):
            number = int(self.name[1:]) - 1
            return number if number < len(header) else None
        places = [place for place, name in enumerate(header) if name == self.name]
        return places[0] if len(places) == 1 else None


def column_map(text: str | Mapping[str, str], known: Iterable[str]) -> dict[str, ColumnSource]:
    """The map in a text as above, or in a mapping such as {"x": "Tx[m]"}; targets must be among `known`.

    Raises InputError with every entry that cannot be read.
    """
    whole = text if isinstance(text, str) else ", ".join(f"{target}={source}" for target, source in text.items())
    problems, found, place = Problems(), dict[str, ColumnSource](), 0
    names = list(known)
    while place < len(whole) and not whole[place:].isspace():
        match = _ENTRY.match(whole, place)
        if match is None:
            what = f"cannot be read from {shown(whole[place:].strip())} on"
            problems.add(Problem("map", what, 'write target=column[unit], such as "x=Tx[m], y=Ty[m]"'))
            break
        place = match.end()
        target, quoted, plain, unit = match.groups()
        name = plain if quoted is None else quoted
        if target not in names:
            problems.add_unknown("map", f"unknown column {shown(target)}", target, names, _known(names), None)
        elif target in found:
            problems.add(Problem("map", f"{target} is given twice", "give it once"))
        if not name:
            problems.add(Problem("map", f"{target} has no column", "name the table's column after the ="))
        if unit is not None and unit not in {*LENGTHS, *ANGLES}:
            remedy = "give one of " + ", ".join([*LENGTHS, *ANGLES])
            problems.add(Problem("map", f"{target} has the unknown unit {shown(unit)}", remedy))
        found[target] = ColumnSource(name, unit)
    problems.raise_any(YOUR_DATA)
    return found


def _known(names: list[str]) -> str:
    return "the columns of a campaign are " + ", ".join(names)


def is_angle(target: str) -> bool:
    """Whether a column is an angle; else it is a length, a name, or a number without a unit."""
    return target in ("r1", "r2", "r3", "rx", "ry", "rz", "drx", "dry", "drz")


def is_length(target: str) -> bool:
    return target in ("x", "y", "z", "dx", "dy", "dz") or re.fullmatch(r"d?L[1-9][0-9]*", target) is not None


def unit_problem(target: str, unit: str | None) -> Problem | None:
    """What is wrong with the unit that a column was given."""
    if unit is None:
        return None
    allowed = list(ANGLES) if is_angle(target) else list(LENGTHS) if is_length(target) else []
    if unit in allowed:
        return None
    remedy = "give one of " + ", ".join(allowed) if allowed else "give no unit"
    return Problem("map", f"{target} cannot be in {unit}", remedy)


def half_widths(stated: Floats, values: Mapping[str, Floats], legs: int, count: int) -> Floats:
    """(N, 6 + n): the half-widths `stated` (6 + n,) for all rows, and those of override columns where not NaN."""
    radii = np.tile(stated, (count, 1))
    for column, name in enumerate(override_columns(legs)):
        if name in values:
            own = ~np.isnan(values[name])
            radii[own, column] = values[name][own]
    return radii


def require(found: Iterable[str], needed: Iterable[str], where: str) -> None:
    """InputError with each column that is needed and not there."""
    have = set(found)
    missing = [name for name in needed if name not in have]
    if missing:
        remedy = "map the table's columns to these names"
        raise InputError([Problem(where, f"the column {name!r} is missing", remedy) for name in missing], see=YOUR_DATA)
