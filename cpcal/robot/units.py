"""Units that data come in, by their usual abbreviations, and their size in mm and rad, which cpcal computes in."""

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import YOUR_DATA, Problems, refuse, shown, unusable
from cpcal.common.files import NAME_MAX
from cpcal.common.values import ArrayLike, Floats, Names, Texts, Value, as_floats, fill, frozen_mapping, norms
from cpcal.robot.kinematics import normalised, quaternion_from_matrix, quaternion_from_rotation_vector

LENGTHS = {"mm": Decimal(1), "cm": Decimal(10), "m": Decimal(1000), "um": Decimal("0.001"), "in": Decimal("25.4")}
NAMES = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "um": "micrometres", "in": "inches"}
ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}


# ------------------------------------------------------------------------------------------------------------------
# The forms that rotations come in, by name, and their way to unit quaternions, scalar first.
#
# quaternion-wxyz, quaternion-xyzw    scalar first, scalar last
# matrix                              R, which maps mobile to base; nine columns r11 r12 ... r33 are its rows
# vector-rad, vector-deg              rotation vector: axis times angle
# euler-xyz-deg, euler-ZYX-rad, ...   three angles in the order of the letters: small letters turn about the fixed
#                                     axes of the base frame, capitals about those of the turned one (as in scipy)
# kuka, yaskawa, fanuc, ur, abb       as a controller's poses are: `CONTROLLERS`

ROUNDED = 0.01  # logs round: a quaternion's norm, a matrix's R'R, may be this far from 1
TAIT_BRYAN = tuple("".join(p) for p in itertools.permutations("xyz"))
PROPER = tuple(a + b + a for a, b in itertools.permutations("xyz", 2))
SEQUENCES = tuple(s for name in TAIT_BRYAN + PROPER for s in (name, name.upper()))
CONTROLLERS = {  # form of rotations; unit of lengths where the table says none
    "kuka": ("euler-ZYX-deg", "mm"),  # A, B, C
    "yaskawa": ("euler-xyz-deg", "mm"),  # Rx, Ry, Rz
    "fanuc": ("euler-xyz-deg", "mm"),  # W, P, R
    "ur": ("vector-rad", "m"),  # rx, ry, rz
    "abb": ("quaternion-wxyz", "mm"),  # q1 to q4
}
FORMS = (
    "give quaternion-wxyz, quaternion-xyzw, matrix, vector-rad, vector-deg, Euler angles such as euler-xyz-deg "
    f"(fixed axes) or euler-ZYX-rad (turned axes), or a controller's form: {', '.join(CONTROLLERS)}"
)


@dataclass(frozen=True)
class RotationForm:
    """How rotations are written: the columns of a table that hold the numbers, and the unit of angles; and of lengths
    beside them, where a table says none."""

    name: str
    columns: Names
    unit: str = "rad"
    length: str = ""

    @classmethod
    def named(cls, name: str) -> "RotationForm":
        """The form of that name. Raises InputError, which lists the forms."""
        if name in CONTROLLERS:
            form, length = CONTROLLERS[name]
            return replace(cls.named(form), length=length)
        kind, *rest = str(name).split("-")
        if name in ("quaternion-wxyz", "quaternion-xyzw"):
            return cls(name, tuple(f"q{letter}" for letter in rest[0]))
        if name == "matrix":
            return cls(name, tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)))
        if kind == "vector" and len(rest) == 1 and rest[0] in ANGLES:
            return cls(name, ("rx", "ry", "rz"), rest[0])
        if kind == "euler" and len(rest) == 2 and rest[0] in SEQUENCES and rest[1] in ANGLES:
            return cls(name, ("r1", "r2", "r3"), rest[1])
        raise unusable("rotation", f"{shown(name)} is no form of rotations", FORMS)

    def quaternions(self, rotations: ArrayLike | Any) -> Floats:
        """(N, 4) unit quaternions of (N, 4), (N, 3, 3), (N, 9) or (N, 3) numbers, or of a scipy Rotation.

        Raises InputError for what is no rotation, with its row (from 0).
        """
        if hasattr(rotations, "as_quat"):
            return normalised(np.roll(np.atleast_2d(rotations.as_quat()), 1, axis=1))
        try:
            values = as_floats(rotations)
        except (TypeError, ValueError) as error:
            raise unusable("rotations", str(error)[:200], "give an array of numbers") from None
        width = len(self.columns)
        if width == 9 and values.shape[1:] == (3, 3):
            values = values.reshape(-1, 9)
        if values.ndim != 2 or values.shape[1] != width:
            what = f"have the shape {values.shape} for the form {self.name}"
            raise unusable("rotations", what, f"give one row of {width} numbers for each measurement")
        good = np.asarray(np.isfinite(values).all(axis=1))
        finite, off, what, remedy = np.where(good[:, None], values, 0.0), np.zeros(len(values)), "", "correct it"
        with np.errstate(all="ignore"):
            if width == 4:
                norm = norms(finite)[:, None]
                off, what = np.abs(norm[:, 0] - 1.0), "is a quaternion whose norm is not 1"
                remedy = "check the columns, or divide it by its norm"
                found = np.where(np.abs(norm - 1.0) <= 1e-12, finite, finite / norm)  # a norm of 1: bit for bit
                found = found if self.columns[0] == "qw" else np.roll(found, 1, axis=1)
            elif width == 9:
                matrix = finite.reshape(-1, 3, 3)
                off = np.abs(np.swapaxes(matrix, 1, 2) @ matrix - np.eye(3)).max(axis=(1, 2), initial=0.0)
                off = np.where(np.linalg.det(matrix) > 0.0, off, np.inf)
                what = "is no rotation matrix: its columns are not at right angles, not of length 1, or left-handed"
                found, remedy = quaternion_from_matrix(matrix), "check the columns and the frames"
            elif self.columns[0] == "rx":
                found = quaternion_from_rotation_vector(finite * ANGLES[self.unit])
            else:
                found = quaternion_from_euler(self.name.split("-")[1], finite * ANGLES[self.unit])
        problems = Problems()
        for row in np.flatnonzero(~(good & (off <= ROUNDED))).tolist():
            wrong = what if good[row] else "holds a number that is not finite"
            problems.wrong(f"rotation of row {row}", wrong, remedy)
        problems.raise_any()
        return found


def quaternion_from_euler(sequence: str, angles: Floats) -> Floats:
    """(N, 4) of three angles (N, 3) in rad, in the order of the letters: see above."""
    from scipy.spatial.transform import Rotation  # here: it takes a while to load

    return normalised(Rotation.from_euler(sequence, angles).as_quat(scalar_first=True))


# ------------------------------------------------------------------------------------------------------------------
# The columns of a table of measurements, and how the columns of a foreign table are mapped to them.
#
#     x = Tx[m], y = Ty[m], z = Tz[m], r1 = A[deg], L1 = "leg 1", L2 = #14
#
# A target, "=", and the name of a column in the table, or "#" and its number from 1; in brackets its unit. A name that
# holds a comma, a bracket or a space at an end stands in double quotes.

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")  # mm; a unit quaternion
AXES = ("x", "y", "z", "rx", "ry", "rz")  # mm; a rotation vector, rad
SHARED_COLUMNS = [f"shared_s{axis}" for axis in AXES]  # of a study's tables, see PoseTable

_ENTRY = re.compile(r'\s*([A-Za-z]\w*)\s*=\s*(?:"([^"]*)"|([^,\["]*?))\s*(?:\[\s*(\w*)\s*\])?\s*(?:,|$)')


def leg_columns(legs: int) -> list[str]:
    """Those of the readings of n legs, mm."""
    return [f"L{leg}" for leg in range(1, legs + 1)]


def reading_columns(legs: int) -> list[str]:
    """The columns that every measurements.csv has, for n legs."""
    return ["pose", "run", *POSE, *leg_columns(legs)]


def override_columns(legs: int) -> list[str]:
    """The optional columns: half-widths (mm, rad, mm) that replace those of campaign.toml row by row."""
    return [f"d{name}" for name in (*AXES, *leg_columns(legs))]


class ColumnSource(NamedTuple):
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


def column_map(text: str | Texts, known: Iterable[str]) -> dict[str, ColumnSource]:
    """The map in a text as above, or in a mapping such as {"x": "Tx[m]"}; targets must be among `known`.

    Raises InputError with every entry that cannot be read.
    """
    whole = text if isinstance(text, str) else ", ".join(f"{target}={source}" for target, source in text.items())
    problems, found, place = Problems(), {}, 0
    names = list(known)
    while place < len(whole) and not whole[place:].isspace():
        match = _ENTRY.match(whole, place)
        if match is None:
            what = f"cannot be read from {shown(whole[place:].strip())} on"
            problems.wrong("map", what, 'write target=column[unit], such as "x=Tx[m], y=Ty[m]"')
            break
        place = match.end()
        target, quoted, plain, unit = match.groups()
        name = plain if quoted is None else quoted
        if target not in names:
            known_ones = "the columns of a campaign are " + ", ".join(names)
            problems.add_unknown("map", f"unknown column {shown(target)}", target, names, known_ones, None)
        elif target in found:
            problems.wrong("map", f"{target} is given twice", "give it once")
        if not name:
            problems.wrong("map", f"{target} has no column", "name the table's column after the =")
        if unit is not None and unit not in {*LENGTHS, *ANGLES}:
            remedy = "give one of " + ", ".join([*LENGTHS, *ANGLES])
            problems.wrong("map", f"{target} has the unknown unit {shown(unit)}", remedy)
        found[target] = ColumnSource(name, unit)
    problems.raise_any(YOUR_DATA)
    return found


_TITLE = re.compile(r"(.*?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])]|[\s_/]+(mm|cm|m|um|µm|in|rad|deg|degrees|°))?\s*")
_SPELLED = {"µm": "um", "°": "deg", "degree": "deg", "degrees": "deg", "radians": "rad"} | {
    v: k for k, v in NAMES.items()
}
_TITLES = {
    "pose": "pose|image|photo|file|frame|name|id|no|nr|number|index|point|config|configuration|measurement",
    "run": "run|repeat|repetition",
    **{axis: f"(t|p|pos|position|trans|translation|point|target)?{axis}(pos|position)?" for axis in "xyz"},
    **{f"q{letter}": f"(q|quat|quaternion){letter}" for letter in "wxyz"},
    **{f"r{row}{column}": f"(r|m|rot){row}{column}" for row in "123" for column in "123"},
    **{f"r{axis}": f"(r|rot|rotation|angle|v){axis}" for axis in "xyz"},
}
_ANGLES = {"x": "roll", "y": "pitch", "z": "yaw"}


def columns_by_name(
    header: Sequence[str], legs: int, form: RotationForm | None
) -> tuple[dict[str, ColumnSource], RotationForm | None]:
    """What the names of a table's columns, such as "X [m]" or "leg 3 (mm)", say that they are, with the units in them;
    and the form of rotations, which quaternions and matrices tell. Nothing is said where two columns could be meant."""
    keys, units = [], []
    for name in header:
        match = _TITLE.fullmatch(name)
        plain, one, other = match.groups() if match else (name, None, None)
        unit = (one or other or "").casefold()
        unit = _SPELLED.get(unit, unit)
        units.append(unit if unit in {*LENGTHS, *ANGLES} else None)
        keys.append("" if name in override_columns(legs) else re.sub("[^a-z0-9]", "", plain.casefold()))

    def named(target: str, pattern: str) -> dict[str, ColumnSource]:
        places = [place for place, key in enumerate(keys) if re.fullmatch(pattern, key)]
        if len(places) != 1:
            return {}
        name = header[places[0]]
        return {target: ColumnSource(name if header.count(name) == 1 else f"#{places[0] + 1}", units[places[0]])}

    found: dict[str, ColumnSource] = {}
    for target in ("pose", "run", *"xyz"):
        found |= named(target, _TITLES[target])
    stated = form is not None
    for try_form in [form] if form else [RotationForm.named(name) for name in ("quaternion-wxyz", "matrix")]:
        order = try_form.name.split("-")[1].lower() if try_form.columns[0] == "r1" else ""
        turned: dict[str, ColumnSource] = {}
        for k, target in enumerate(try_form.columns):
            letter = order[k : k + 1]
            axis = f"{_TITLES[f'r{letter}']}|{_ANGLES[letter]}" if letter and len(set(order)) == 3 else ""
            names = _TITLES.get(target, f"{axis}|{'abc'[k % 3]}|{'wpr'[k % 3]}|(r|e|euler|angle){k + 1}")
            turned |= named(target, f"{names}|q{k + 1}" if stated and target[0] == "q" else names)
        if len(turned) == len(try_form.columns):
            found, form = found | turned, try_form
    prefixes = {match[1] for key in keys if (match := re.fullmatch("([a-z]+)[0-9]+", key))}
    counted = [[f"{prefix}0*{leg + first}" for leg in range(legs)] for prefix in prefixes for first in (0, 1) if legs]
    full = [each for each in counted if all(named("", pattern) for pattern in each)]
    usual = [each for each in full if re.match("(l|leg|length)0", each[0])]
    if len(full) == 1 or len(usual) == 1:
        for leg, pattern in enumerate((usual or full)[0], start=1):
            found |= named(f"L{leg}", pattern)
    return found, form


def units_of(target: str) -> Mapping[str, float]:
    """The units that a column may be in, and their sizes in mm or rad; none of names, and of numbers without a unit."""
    if re.fullmatch(r"d?([xyz]|L[1-9][0-9]*)", target):
        return {unit: float(size) for unit, size in LENGTHS.items()}
    return ANGLES if re.fullmatch(r"r[123]|d?r[xyz]", target) else {}


# ------------------------------------------------------------------------------------------------------------------
# Which leg model a campaign asks for: [model] in campaign.toml. What the names mean stands in `cpcal.calibration`.


@dataclass(frozen=True, eq=False)
class ModelChoice(Value):
    """A model's name, and half-widths of its extra parameters, in their units, where they are not the default.

    Raises InputError for what can belong to no model.
    """

    name: str
    half_widths: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        widths = {str(k): float(v) for k, v in self.half_widths.items()}
        fill(self, half_widths=frozen_mapping(widths))
        named = {name: name.isidentifier() and len(name) <= NAME_MAX for name in (self.name, *widths)}
        refuse(
            (not named[self.name], "model", f"{shown(self.name)} cannot be a name", 'give one such as "gain"'),
            *((not named[k], "model", f"{shown(k)} cannot be a parameter", "give its name, such as s") for k in widths),
            *(
                (not 0.0 <= v < math.inf, "model", f"the half-width of {shown(k)} is {v}", "give a number, 0 or more")
                for k, v in widths.items()
            ),
        )
