"""Logs of trackers, motion capture and robot controllers: tables of numbers as text, whatever their separators.

    # comment lines
    header lines of any kind
    Frame;Tx;Ty;Tz;...          the names of the columns: the last line with as many cells as the rows have
    1;0,5132;-0,0021;0,8771;...

A separator is one of , ; tab and blanks; a decimal sign is a point or a comma. What is not stated is guessed: the pair
with which most cells are numbers.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, shown, unusable
from cpcal.common.files import TEXT_MAX, small_file
from cpcal.common.values import Floats
from cpcal.files.folders import load_settings
from cpcal.files.settings import Settings
from cpcal.robot import EXACT_OR_NOT, ROBOTS, Campaign, Robot, known_robot
from cpcal.robot.campaign import mapped, stated_uncertainty, table_arguments, unit_factor
from cpcal.robot.units import LENGTHS, ColumnSource, RotationForm, units_of

LOG_MAX = 2**27  # bytes
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
_SIGNS = {"point": ".", "comma": ","}
_COMMENT = re.compile(r"\s*(#|%|//|!)")
_NUMBERS = {sign: re.compile(rf"[-+]?(\d+(\{sign}\d*)?|\{sign}\d+)([eE][-+]?\d+)?") for sign in ".,"}
_UNITS = re.compile(r"[\[(]?(mm|cm|m|um|µm|in|rad|deg|°|s|ms|-|)[\])]?")
_LEAST = 3  # numbers in a row of measurements
_LOOKED_AT = 2_000  # lines, to guess from


@dataclass(frozen=True)
class Log:
    """A table of text cells. `header` is empty where there is none; `lines` are those of the rows, from 1.

    separator, decimal  as they were stated or guessed
    """

    where: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    separator: str
    decimal: str


def frame_log(frame: Any) -> Log:
    """The table in a pandas DataFrame, as if it were a file; of numbers, all digits."""
    columns = [[str(value) for value in frame.iloc[:, place].tolist()] for place in range(len(frame.columns))]
    rows = tuple(zip(*columns, strict=True))
    return Log("DataFrame", tuple(map(str, frame.columns)), rows, tuple(range(1, len(rows) + 1)), ",", ".")


def read_log(path: Path, *, separator: str | None = None, decimal: str | None = None, header: int | None = None) -> Log:
    """The table in a log.

    separator  comma, semicolon, tab or blank; decimal: point or comma; header: the line, from 1, that names the columns

    Raises InputError: every row below the first one that has another number of cells, and what cannot be a log.
    """
    problems = Problems()
    content = small_file(path, problems, "name the log", most=LOG_MAX)
    problems.raise_any()
    assert content is not None
    lines = _text(content).splitlines()
    first = header or 0
    body = [(number, line) for number, line in enumerate(lines, 1) if number > first and not _COMMENT.match(line)]
    body = [(number, line) for number, line in body if line.strip()]
    mark, sign, width = _guessed(body[:_LOOKED_AT], separator, decimal, str(path))
    rows = [(number, _cells(line, mark)) for number, line in body]
    if mark == "," and _decimals_apart([cells for _, cells in rows]):
        what = "has decimal commas, and commas between columns too: no rule tells them apart"
        raise unusable(str(path), what, "export it with semicolons or tabs, or with decimal points")
    start = next(i for i, (_, cells) in enumerate(rows) if len(cells) == width and _numbers(cells, sign) >= _LEAST)
    for number, cells in rows[start:]:
        if len(cells) != width:
            what = f"{len(cells)} cells, but the rows before have {width}"
            problems.add(Problem(str(path), what, "mend the line, or make it a comment with #", number))
    problems.raise_any()
    names = _header(lines, rows[start][0] if header is None else header + 1, width, mark, sign)
    kept = rows[start:]
    return Log(str(path), names, tuple(tuple(c) for _, c in kept), tuple(n for n, _ in kept), mark, sign)


def _text(content: bytes) -> str:
    """As the bytes say: UTF-8, UTF-16 with a mark, else the western single-byte code, which has no wrong bytes."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        cells = next(csv.reader((line,), delimiter=separator))
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _numbers(cells: list[str], sign: str) -> int:
    return sum(_NUMBERS[sign].fullmatch(cell) is not None for cell in cells)


def _guessed(
    body: list[tuple[int, str]], separator: str | None, decimal: str | None, where: str
) -> tuple[str, str, int]:
    """Separator, decimal sign, and how many cells a row has: with which most cells are numbers."""
    best = (0, "", "", 0)
    for name, mark in SEPARATORS.items():
        for label, sign in _SIGNS.items():
            if separator not in (None, name) or decimal not in (None, label):
                continue  # where both are commas, quotes tell them apart
            counts = [(len(cells), _numbers(cells, sign)) for cells in (_cells(line, mark) for _, line in body)]
            widths = Counter(width for width, numbers in counts if numbers >= _LEAST)
            if not widths:
                continue
            width = widths.most_common(1)[0][0]
            score = sum(numbers for wide, numbers in counts if wide == width and numbers >= _LEAST)
            if score > best[0]:
                best = (score, mark, sign, width)
    if not best[0]:
        stated = f"--separator ({', '.join(SEPARATORS)}) and --decimal (point, comma)"
        remedy = f"give a table with at least {_LEAST} numbers in a row, or state {stated}"
        raise unusable(where, "holds no rows of numbers", remedy)
    return best[1:]


def _decimals_apart(rows: list[list[str]]) -> bool:
    """Whether cells are the halves of numbers: no point is in any, and some begin with zeros, as only decimals do."""
    cells = [cell for row in rows if _numbers(row, ".") >= _LEAST for cell in row]
    return not any("." in cell or "," in cell for cell in cells) and any(re.fullmatch("0[0-9]+", c) for c in cells)


def _header(lines: list[str], before: int, width: int, mark: str, sign: str) -> tuple[str, ...]:
    """The names of the columns: the last line above that has as many cells and no numbers; a row of units is none."""
    for line in reversed(lines[: before - 1]):
        cells = _cells(_COMMENT.sub("", line, count=1), mark)
        units = all(_UNITS.fullmatch(cell) for cell in cells)
        if len(cells) == width and not units and not _numbers(cells, sign):
            return tuple(cells)
    return ()


def number_texts(log: Log, place: int, target: str, problems: Problems) -> Iterator[str]:
    """The cells of a column with points as decimal signs; what is no number is a problem, and nan."""
    pattern = _NUMBERS[log.decimal]
    for line, row in zip(log.lines, log.rows, strict=True):
        if pattern.fullmatch(row[place]):
            yield row[place].replace(log.decimal, ".")
            continue
        what = f"{target}: {shown(row[place])} is not a number" if row[place] else f"{target} is empty"
        problems.add(Problem(log.where, what, "mend the cell, or make the line a comment with #", line))
        yield "nan"


# ------------------------------------------------------------------------------------------------------------------
# What a log does not say of itself: of which robot it is, and how far its readings may be off.


def log_settings(
    robot: Robot | str, sigmas: Mapping[str, npt.ArrayLike | None], factor: float, exact: bool
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


def campaign_of_log(
    log: Log, settings: Settings, columns: str | Mapping[str, str] = "", rotation: str | None = None
) -> Campaign:
    """The campaign in a log: `settings` say what it lacks (a robot; how far readings may be off, or None: exact),
    `columns` which columns are which, `rotation` the form of the rotations; left out, the columns' names tell.

    Lengths are converted in decimal, so that 0.1 m is the float nearest to 100 mm.

    Poses are named p1, p2, ... in the order of the rows unless a column is mapped to `pose`. Raises InputError with
    every cell that is no number, by its line.
    """
    robot = settings.robot
    assert robot is not None  # what keeps it from being read was raised
    header = log.header or tuple(f"#{i}" for i in range(1, len(log.rows[0]) + 1))

    def span(place: int) -> tuple[float, float] | None:
        cells = [row[place] for row in log.rows]
        if not all(map(_NUMBERS[log.decimal].fullmatch, cells)):
            return None
        numbers = [float(cell.replace(log.decimal, ".")) for cell in cells]
        return min(numbers), max(numbers)

    found, form = mapped(columns, header, robot, rotation, span)
    names: dict[str, list[str]] = {}
    values: dict[str, Floats] = {}
    problems = Problems()
    for target, source in found.items():
        place = source.place(header)
        assert place is not None  # `mapped` raised otherwise
        if target in ("pose", "run"):
            names[target] = [row[place] for row in log.rows]
        else:
            values[target] = _column(log, place, target, source, form, problems)
    problems.raise_any(YOUR_DATA)
    try:
        arguments = table_arguments(names, values, robot, form, settings.uncertainty)
    except InputError as error:
        raise _by_line(error, log) from None
    told = {"imported_from": Path(log.where).name, "rotation_form": form.name, "columns": _told(found)}
    provenance = dict(settings.provenance) | told
    return Campaign.of(**arguments, exact=settings.uncertainty is None, provenance=provenance, model=settings.model)


def _column(log: Log, place: int, target: str, source: ColumnSource, form: RotationForm, problems: Problems) -> Floats:
    texts = number_texts(log, place, target, problems)
    if "mm" in units_of(target):
        size = LENGTHS[source.unit or "mm"]
        return np.array([float(Decimal(text) * size) for text in texts])
    return unit_factor(target, source, form) * np.array([float(text) for text in texts])


def _told(found: Mapping[str, ColumnSource]) -> str:
    entries = (f'{target}="{source.name}"[{source.unit or ""}]' for target, source in found.items())
    return "".join(c for c in ", ".join(entries).replace("[]", "") if c.isprintable())[:TEXT_MAX]


def _by_line(error: InputError, log: Log) -> InputError:
    """The same problems, with the log's line instead of a row's number."""
    problems = []
    for problem in error.problems:
        start, _, row = problem.where.rpartition(" ")
        if start == "rotation of row":
            problem = type(problem)(log.where, f"the rotation {problem.what}", problem.remedy, log.lines[int(row)])
        problems.append(problem)
    return InputError(problems, omitted=error.omitted)
