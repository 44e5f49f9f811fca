"""Logs of trackers, motion capture and robot controllers: tables of numbers as text, whatever their separators.

    # comment lines
    header lines of any kind
    Frame;Tx;Ty;Tz;...          the names of the columns: the last line with as many cells as the rows have
    1;0,5132;-0,0021;0,8771;...

A separator is one of , ; tab and blanks; a decimal sign is a point or a comma. They are guessed: the pair with which
most cells are numbers.
"""

import csv
import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.documents import NUMBERS
from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, shown, unusable
from cpcal.common.files import TEXT_MAX, listed, small_file
from cpcal.common.numbers import about
from cpcal.common.values import ArrayLike, Floats, Names, Places, Texts
from cpcal.files.folders import Settings, campaign_of_table, load_settings
from cpcal.files.tables import QUATERNION, Table
from cpcal.robot import EXACT_OR_NOT, ROBOTS, Campaign, Robot, known_robot
from cpcal.robot.campaign import stated_uncertainty
from cpcal.robot.units import (
    ANGLES,
    FORMS,
    LENGTHS,
    ColumnSource,
    RotationForm,
    column_map,
    columns_by_name,
    leg_columns,
    override_columns,
    units_of,
)

LOG_MAX = 2**27  # bytes
_COMMENT = re.compile(r"\s*(#|%|//|!)")
_UNITS = re.compile(r"[\[(]?(mm|cm|m|um|µm|in|rad|deg|°|s|ms|-|)[\])]?")
_LEAST = 3  # numbers in a row of measurements
_LOOKED_AT = 2_000  # lines, to guess from


@dataclass(frozen=True)
class Log:
    """A table of text cells.

    header   the names of its columns, or their numbers from #1
    lines    those of the rows, from 1
    decimal  the sign that was guessed
    """

    where: str
    header: Names
    rows: tuple[Names, ...]
    lines: Places
    decimal: str


def frame_log(frame: Any) -> Log:
    """The table in a pandas DataFrame, as if it were a file; of numbers, all digits."""
    columns = [[str(value) for value in frame.iloc[:, place].tolist()] for place in range(len(frame.columns))]
    rows = tuple(zip(*columns, strict=True))
    return Log("DataFrame", tuple(map(str, frame.columns)), rows, tuple(range(1, len(rows) + 1)), ".")


def read_log(path: Path) -> Log:
    """The table in a log. Raises InputError: what cannot be a log, and every row of another number of cells."""
    problems, content = Problems(), small_file(path, "name the log", most=LOG_MAX)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("latin-1")  # the western single-byte code, which has no wrong bytes
    lines = text.splitlines()
    body = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not _COMMENT.match(line)]
    mark, sign, width = _guessed([line for _, line in body[:_LOOKED_AT]], str(path))
    rows = [(number, _cells(line, mark)) for number, line in body]
    each = [cell for _, cells in rows if _numbers(cells, ".") >= _LEAST for cell in cells]
    # cells are the halves of numbers: no point is in any, and some begin with zeros, as only decimals do
    halves = not any("." in cell or "," in cell for cell in each) and any(re.fullmatch("0[0-9]+", c) for c in each)
    if mark == "," and halves:
        what = "has decimal commas, and commas between columns too: no rule tells them apart"
        raise unusable(path, what, "export it with semicolons or tabs, or with decimal points")
    start = next(i for i, (_, cells) in enumerate(rows) if len(cells) == width and _numbers(cells, sign) >= _LEAST)
    kept = rows[start:]
    for number, cells in kept:
        if len(cells) != width:
            what = f"{len(cells)} cells, but the rows before have {width}"
            problems.wrong(path, what, "mend the line, or make it a comment with #", number)
    problems.raise_any()
    names = _header(lines, kept[0][0], width, mark, sign)
    return Log(str(path), names, tuple(tuple(c) for _, c in kept), tuple(n for n, _ in kept), sign)


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        cells = next(csv.reader((line,), delimiter=separator))
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _numbers(cells: list[str], sign: str) -> int:
    return sum(NUMBERS[sign].fullmatch(cell) is not None for cell in cells)


def _guessed(lines: list[str], where: str) -> tuple[str, str, int]:
    """Separator, decimal sign, and how many cells a row has: with which most cells are numbers."""
    best = (0, "", "", 0)
    for mark, sign in itertools.product(",;\t ", ".,"):  # where both are commas, quotes tell them apart
        counts = [(len(cells), _numbers(cells, sign)) for cells in (_cells(line, mark) for line in lines)]
        widths = Counter(width for width, numbers in counts if numbers >= _LEAST)
        if not widths:
            continue
        width = widths.most_common(1)[0][0]
        score = sum(numbers for wide, numbers in counts if wide == width and numbers >= _LEAST)
        if score > best[0]:
            best = (score, mark, sign, width)
    if not best[0]:
        remedy = f"give a table with at least {_LEAST} numbers in a row, separated by comma, semicolon, tab or blanks"
        raise unusable(where, "holds no rows of numbers", remedy)
    return best[1:]


def _header(lines: list[str], before: int, width: int, mark: str, sign: str) -> Names:
    """The names of the columns: the last line above that has as many cells and no numbers; a row of units is none."""
    for line in reversed(lines[: before - 1]):
        cells = _cells(_COMMENT.sub("", line, count=1), mark)
        units = all(_UNITS.fullmatch(cell) for cell in cells)
        if len(cells) == width and not units and not _numbers(cells, sign):
            return tuple(cells)
    return tuple(f"#{number}" for number in range(1, width + 1))


# ------------------------------------------------------------------------------------------------------------------
# What a log does not say of itself: of which robot it is, and how far its readings may be off.


def log_settings(
    robot: Robot | str, sigmas: Mapping[str, ArrayLike | None], factor: float, exact: bool
) -> tuple[Settings, bool]:
    """The robot, and how far readings may be off; whether that was stated. What is given by kind in `sigmas` counts
    before what a campaign.toml says. Raises InputError."""
    given = any(value is not None for value in sigmas.values())
    if exact and given:
        raise unusable("uncertainty", "is given, and readings are called exact", "give one of the two")
    of_file = isinstance(robot, str) and Path(robot).exists()
    if of_file:
        settings = load_settings(str(robot))
    else:
        if isinstance(robot, str) and robot.casefold() not in ROBOTS and re.search(r"[./\\]", robot):
            raise unusable(robot, "does not exist", "make it with `cpcal robot init`")
        known = known_robot(robot).robot if isinstance(robot, str) else robot
        settings = Settings(known, known.legs)
    if exact:
        return replace(settings, uncertainty=None), True
    if given:
        settings = replace(settings, uncertainty=stated_uncertainty(settings.legs or 0, sigmas, factor, None))
    return settings, given or of_file


def unstated(residual: str) -> InputError:
    """Nothing says how far readings may be off."""
    what = (
        f"is not stated; a least-squares fit leaves residuals of {residual} (robust standard deviation), "
        "which readings and model make together"
    )
    remedy = (
        "state the standard deviations of a reading, from data sheets or repeats: --sigma "
        '"position=...[mm], rotation=...[deg], length=...[mm]" (Python: position_sigma=, rotation_sigma=, '
        f"length_sigma=), or --exact; or a campaign.toml as --robot: {EXACT_OR_NOT}"
    )
    return unusable("uncertainty", what, remedy)


# ------------------------------------------------------------------------------------------------------------------
# From a log to a campaign: columns by a map, units and rotation form by name, what the log lacks from elsewhere.


_TURNS = [
    column
    for form in ("quaternion-wxyz", "matrix", "vector-rad", "euler-xyz-rad")
    for column in RotationForm.named(form).columns
]


def _mapped(
    columns: str | Texts, header: Sequence[str], legs: int, rotation: str | None
) -> tuple[dict[str, ColumnSource], RotationForm]:
    """The map of a table with this header, and the form of its rotations; columns that are not mapped count under their
    own names. Without a map the columns' names tell, where they leave no doubt of what they are and of their units.

    Raises InputError for columns that are not there, and units that cannot be; and with the columns and a proposal.
    """
    form = None if rotation is None else RotationForm.named(rotation)
    needed, widths, problems = [*"xyz", *leg_columns(legs)], override_columns(legs), Problems()
    there = listed([*map(shown, header)], 40)
    if columns:
        found = column_map(columns, ["pose", "run", *needed, *_TURNS, *widths])
        if form is None and found.keys().isdisjoint(("r1", "rx")):
            form = RotationForm.named("matrix" if "r11" in found else "quaternion-wxyz")
        taken = {source.name for source in found.values()}
    else:
        found, form = columns_by_name(header, legs, form)
        taken = {*header} - {*widths}
    if form is None:
        problems.wrong("rotation", "is not told by the columns", f"state --rotation: {FORMS}")
    turns = () if form is None else form.columns
    needed += turns
    own = [name for name in ("pose", "run", *needed, *widths) if name in header]
    found |= {name: ColumnSource(name) for name in own if name not in {*found, *taken}}
    missing = [name for name in needed if name not in found]
    bare = [name for name, of in found.items() if units_of(name) and name not in turns and of.unit is None]
    bare = [name for name in bare if found[name].name != name and not (form and form.length and name in "xyz")]
    if not columns and (missing or bare):
        marks = {name: f"[{of.unit or 'mm'}]" if name in bare or of.unit else "" for name, of in found.items()}
        proposed = ", ".join(f'{name}="{of.name}"{marks[name]}' for name, of in found.items())
        rest = f"; add {', '.join(missing)}" if missing else ""
        what = f"columns have no names or units that tell what they are; they are {there}"
        problems.wrong("map", what, f"check this one, and its units: --map '{proposed}'{rest}")
        missing = []
    places: dict[int, str] = {}
    for target, source in found.items():
        units, place = units_of(target), source.place(header)
        if place is None and source.name in header:
            problems.wrong("map", f"{source.name!r} is there twice", 'give its number, as in "#2"')
        elif place is None:
            what = f"{target}: there is no column {shown(source.name)}"
            problems.wrong("map", what, f"the columns are {there}")
        elif (first := places.setdefault(place, target)) != target:
            what = f"{first} and {target} are the same column, {shown(source.name)}"
            problems.wrong("map", what, "map each to its own")
        if source.unit is not None and source.unit not in units:
            remedy = "give one of " + ", ".join(units) if units else "give no unit"
            problems.wrong("map", f"{target} cannot be in {source.unit}", remedy)
        if columns and target in bare and units is ANGLES:
            problems.wrong("map", f"{target} has no unit", f"write {target}={source.name}[deg] or [rad]")
    for name in missing:
        problems.wrong("map", f"the column {name!r} is missing", "map the table's columns to these names")
    problems.raise_any(YOUR_DATA)
    assert form is not None  # what keeps it from being known is a problem, and was raised
    return found, form


def _table(log: Log, found: Mapping[str, ColumnSource], form: RotationForm) -> Table:
    """The names in a log, and its numbers in mm and rad. Raises InputError with every cell that is no number, by its
    line."""
    table, problems, number = Table(), Problems(), NUMBERS[log.decimal]
    for target, source in found.items():
        place, units, texts = source.place(log.header), units_of(target), []
        assert place is not None  # who found it raised otherwise
        if target in ("pose", "run"):
            table.names[target] = [row[place] for row in log.rows]
            continue
        for line, row in zip(log.lines, log.rows, strict=True):
            good = number.fullmatch(row[place])
            texts.append(row[place].replace(log.decimal, ".") if good else "nan")
            if not good:
                what = f"{target}: {shown(row[place])} is not a number" if row[place] else f"{target} is empty"
                problems.wrong(log.where, what, "mend the cell, or make the line a comment with #", line)
        if "mm" in units:
            size = LENGTHS[source.unit or (form.length if target in "xyz" else "") or "mm"]
            table.values[target] = np.array([float(Decimal(text) * size) for text in texts])
        else:
            unit = source.unit or (form.unit if target in form.columns else "rad")
            table.values[target] = units.get(unit, 1.0) * np.array([float(text) for text in texts])
    problems.raise_any(YOUR_DATA)
    return table


def _quaternions(log: Log, form: RotationForm, table: Table) -> Floats:
    """(N, 4). Raises InputError, with the log's line instead of a row's number."""
    try:
        return replace(form, unit="rad").quaternions(table.columns(*form.columns))
    except InputError as error:
        rows = [int(one.where.rpartition(" ")[2]) for one in error.problems]  # "rotation of row 5"
        lined = [
            Problem(log.where, f"the rotation {one.what}", one.remedy, log.lines[row])
            for one, row in zip(error.problems, rows, strict=True)
        ]
        raise InputError(lined, omitted=error.omitted) from None


def campaign_of_log(log: Log, settings: Settings, columns: str | Texts = "", rotation: str | None = None) -> Campaign:
    """The campaign in a log: `settings` say what it lacks (a robot; how far readings may be off, or None: exact),
    `columns` which columns are which, `rotation` the form of the rotations; left out, the columns' names tell.

    Lengths are converted in decimal, so that 0.1 m is the float nearest to 100 mm. Poses that are not named are p1, p2,
    ... in the order of the rows; runs that are not named tell equal poses apart. Raises InputError with every cell that
    is no number, by its line.
    """
    assert settings.robot is not None  # what keeps it from being read was raised
    found, form = _mapped(columns, log.header, settings.robot.legs, rotation)
    table = _table(log, found, form)
    table.values |= zip(QUATERNION, _quaternions(log, form, table).T, strict=True)
    pose = table.names.setdefault("pose", [f"p{row}" for row in range(1, len(log.rows) + 1)])
    counts: dict[str, Iterator[int]] = defaultdict(lambda: itertools.count(1))
    table.names.setdefault("run", [str(next(counts[name])) for name in pose])
    entries = (f'{target}="{source.name}"[{source.unit or ""}]' for target, source in found.items())
    told = "".join(c for c in ", ".join(entries).replace("[]", "") if c.isprintable())[:TEXT_MAX]
    made = {"imported_from": Path(log.where).name, "rotation_form": form.name, "columns": told}
    return campaign_of_table(table, replace(settings, provenance={**settings.provenance, **made}))


# ------------------------------------------------------------------------------------------------------------------
# Poses alone, of a robot's hand: as a table, or as matrices one after the other.

_MATRIX = ("r11", "r12", "r13", "x", "r21", "r22", "r23", "y", "r31", "r32", "r33", "z", *("last row",) * 4)
_NEAR, _FAR = 10.0, 1e5  # mm: a hand that stays nearer to its base, or gets farther, was stated in another unit


def poses_of_log(log: Log, rotation: str | None = None, unit: str = "") -> tuple[list[str], Floats, Floats]:
    """Names (n; none where the log has none), positions (n, 3) mm, and unit quaternions (n, 4) in a log.

    rotation  the form of the rotations; left out, the columns' names tell
    unit      of lengths, where the columns' names tell none: "mm" unless the form is a controller's in "m"

    Without names of columns the order is name, x, y, z, rotation, or x, y, z, rotation; or the rows are matrices, four
    lines each or one, with the translation in the last column. Raises InputError.
    """
    form = None if rotation is None else RotationForm.named(rotation)
    if log.header[0] == "#1":
        log = _titled(log, form)
    found, form = columns_by_name(log.header, 0, form)
    if form is None or not {*"xyz", *form.columns} <= set(found):
        what = f"columns do not tell which are x, y, z and the rotation; they are {listed(log.header, 40)}"
        named = f"call them image, x, y, z, {', '.join(form.columns)}" if form else f"state --rotation: {FORMS}"
        raise unusable(log.where, what, named)
    table = _table(log, found, replace(form, length=unit or form.length))
    place = table.columns(*"xyz")
    largest = float(np.abs(place).max())
    if not unit and not any(found[axis].unit for axis in "xyz") and not _NEAR <= largest < _FAR:
        what = f"has the hand at most {about(largest, 2)} mm from the base, if its lengths are in {form.length or 'mm'}"
        raise unusable(log.where, what, "say the unit in the names, as in x_m, or with --unit")
    return table.names.get("pose", []), place, _quaternions(log, form, table)


def _titled(log: Log, form: RotationForm | None) -> Log:
    """The log with names for its columns, by their order; a matrix becomes one row."""
    rows, lines, width = log.rows, log.lines, len(log.rows[0])
    if width == 4 and len(rows) % 4 == 0:
        rows = tuple(tuple(itertools.chain(*rows[k : k + 4])) for k in range(0, len(rows), 4))
        lines, width = lines[::4], 16
    matrices = form is None or len(form.columns) == 9
    header = _MATRIX if form is None or matrices else (*"xyz", *form.columns)
    if width - len(header) not in (0, 1):
        what = f"has no names of columns, and {width} of them"
        raise unusable(log.where, what, f"add a line such as image,x,y,z,rx,ry,rz, and state --rotation: {FORMS}")
    number = NUMBERS[log.decimal]
    for line, row in zip(lines, rows, strict=True) if matrices else ():
        last = [float(cell.replace(log.decimal, ".")) for cell in row[-4:] if number.fullmatch(cell)]
        if last != [0.0, 0.0, 0.0, 1.0]:
            what = "is no matrix whose last row is 0 0 0 1"
            raise unusable(log.where, what, "write the translation in the last column", line)
    return replace(log, header=("pose",) * (width - len(header)) + header, rows=rows, lines=lines)
