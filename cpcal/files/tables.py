"""Tables of measurements, readings and poses: every bad cell with its line number, in bounded memory and time."""

import codecs
import csv
import hashlib
import io
import math
import re
import warnings
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from cpcal.common.documents import NUMBERS, csv_table, unguarded
from cpcal.common.errors import Problems, shown, unusable
from cpcal.common.files import IDENTIFIER_REMEDY, StrPath, is_identifier, small_file
from cpcal.common.values import LARGEST, Floats, Names
from cpcal.robot import Pose, PoseTable
from cpcal.robot.campaign import QUATERNION_TOLERANCE, quaternion_problem
from cpcal.robot.units import POSE, leg_columns, override_columns, reading_columns

Columns = Callable[[int], list[str]]  # their names, for n legs

BAD_ROWS_MAX = 1_000  # reading stops after so many
LINE_MAX = 2**16  # bytes in a line
ROWS_MAX = 1_000_000  # measurements in a table: some 60 s and 2 GB to read and check
TABLE_MAX = 2**30  # bytes

_IDENTIFIERS = ("pose", "run", "image", "point")
QUATERNION = POSE[3:]


@dataclass
class Table:
    """The rows of a measurements.csv: columns of `names` (pose, run; of other tables image, point), and of `values`, in
    which an empty override cell is NaN. `sha256`: of the file.
    """

    names: dict[str, list[str]] = field(default_factory=dict)
    values: dict[str, Floats] = field(default_factory=dict)
    sha256: str = ""

    def columns(self, *names: str) -> Floats:
        """Some of the numbers, (N, len(names))."""
        return np.stack([self.values[name] for name in names], axis=1)


def read_table(
    path: Path,
    legs: int | None,
    problems: Problems,
    absent: str,
    *,
    required: Columns = reading_columns,
    optional: Columns = override_columns,
) -> Table:
    """The table in a file, for a robot of `legs` legs (None: not known); adds to `problems`.

    `absent` is the remedy when there is no such file. `required` names the columns for n legs that must be there,
    `optional` those that may: those of half-widths, or "image", which names a row together with pose and run.
    """
    content = problems.of(partial(small_file, path, absent, most=TABLE_MAX))
    if content is None:
        return Table()
    reader, before = _Reader(content, str(path), problems), len(problems)
    header = next(lines := reader.lines(), None)
    if header is None:  # with an unreadable header what follows would make no sense
        if len(problems) == before:
            reader.line = 1
            reader.wrong("is empty", "write a header and one line for each measurement")
        return Table()
    columns = reader.header([cell.strip() for cell in header], legs, required, optional)
    table = Table(sha256=hashlib.sha256(content).hexdigest())
    if columns:
        reader.rows(lines, columns, table)
    if table.values and not content.endswith(b"\n"):
        cell = shown(content.decode().rpartition(",")[2])
        what = f"the last line has no line end; if the file was cut, so may be its last number, {cell}"
        where = f"{path}:{reader.line}: {what}"
        warnings.warn(f"{where} -> compare it with what was measured, and end the line", stacklevel=2)
    return table


@dataclass
class _Reader:
    """Checks the header, then checks and gathers the rows below it."""

    content: bytes
    where: str
    problems: Problems
    line: int = 0

    def wrong(self, what: str, remedy: str, *, always: bool = False) -> None:
        """Of the line that was read last."""
        self.problems.wrong(self.where, what, remedy, self.line, always=always)

    def lines(self) -> Iterator[list[str] | None]:
        """The cells of the lines that are not blank; None for a line that cannot be read at all."""
        stream = io.BytesIO(self.content)
        stream.seek(len(codecs.BOM_UTF8) * self.content.startswith(codecs.BOM_UTF8))
        while raw := stream.readline(LINE_MAX):
            self.line += 1
            if len(raw) == LINE_MAX:
                what = f"the line is longer than {LINE_MAX:,} bytes; the rest of the file was not read"
                self.wrong(what, "is this a CSV file? end each measurement's line", always=True)
                return
            cells = None
            try:
                if (text := raw.decode()).isspace():
                    continue
                cells = next(csv.reader((text,), strict=True))
            except UnicodeDecodeError:
                self.wrong("the line is not UTF-8 text", "save the file as UTF-8 text")
            except csv.Error as error:
                remedy = "one measurement a line, cells separated by commas, quotes and line ends in order"
                self.wrong(f"the line is not CSV: {str(error).partition(' - ')[0]}", remedy)
            yield cells

    def header(
        self,
        names: list[str],
        legs: int | None,
        required_for: Columns,
        optional: Columns,
    ) -> list[str]:
        """The name of each column, empty where it is unknown or a repetition; no list when none is known."""
        if legs is None:
            legs = len({name for name in names if re.fullmatch(r"L[1-9][0-9]{0,3}", name)})
        required = required_for(legs)
        known = {*required, *optional(legs)}
        if not known.intersection(names):
            start, what = f"start with the line {','.join(required):.100}", f"no header: {shown(','.join(names))}"
            foreign = len(names) == 1 and known.intersection(re.split("[;\t]", names[0]))
            if foreign:
                what = f"the cells are separated by {'semicolons' if ';' in names[0] else 'tabs'}"
                start = "write commas, and points as decimal signs; or let `cpcal import` read the table"
            self.wrong(what, start)
            return []
        columns = []
        for name in names:
            if name in columns:
                self.wrong(f"the column {name!r} is there twice", "take one of them out")
            elif name not in known:
                otherwise = f"take it out, or check that the robot has {legs} legs"
                what = f"unknown column {shown(name)}"
                self.problems.add_unknown(self.where, what, name, known, otherwise, self.line)
            columns.append(name if name in known and name not in columns else "")
        for name in required:
            if name not in columns:
                self.wrong(f"the column {name!r} is missing", f"add a column {name}")
        return columns

    def rows(self, lines: Iterator[list[str] | None], columns: list[str], table: Table) -> None:
        """The rows into the table, if all are fit; stops after `BAD_ROWS_MAX` that are not."""
        ids = {name: columns.index(name) for name in _IDENTIFIERS if name in columns}
        places = {name: place for place, name in enumerate(columns) if name and name not in ids}
        found, numbers = {name: list[str]() for name in ids}, array("d")
        seen, bad = dict[Names, int](), 0
        for cells in lines:
            before = len(self.problems)
            if cells is not None and len(cells) != len(columns):
                what = f"{len(cells)} cells, but the header has {len(columns)}"
                self.wrong(what, "give one cell for each column, separated by commas")
            elif cells is not None:
                names = {column: unguarded(cells[place].strip()) for column, place in ids.items()}
                for column, text in names.items():
                    if not is_identifier(text):
                        a = "an" if column == "image" else "a"
                        self.wrong(f"{shown(text)} cannot be the name of {a} {column}", IDENTIFIER_REMEDY)
                if (first := seen.setdefault(tuple(names.values()), self.line)) != self.line:
                    which = " ".join(f"{column} {shown(text)}" for column, text in names.items())
                    self.wrong(f"{which} was given on line {first} already", f"give each {' and '.join(names)} once")
                row = {name: self.number(name, cells[place]) for name, place in places.items()}
                turn = [row[name] for name in QUATERNION if name in row]
                if len(turn) == 4 and abs((norm := math.hypot(*turn)) - 1.0) > QUATERNION_TOLERANCE:  # False for NaN
                    self.wrong(*quaternion_problem(norm))
                numbers.extend(row.values())
                for column, text in names.items():
                    found[column].append(text)
            bad += cells is None or len(self.problems) > before
            if len(seen) > ROWS_MAX:
                what = f"holds more than {ROWS_MAX:,} measurements: the rest of the file was not read"
                self.wrong(what, "divide it, or leave out what repeats", always=True)
                break
            if bad >= BAD_ROWS_MAX:
                what = f"{bad:,} bad rows: the rest of the file was not read"
                self.wrong(what, "mend these first, and check that this is the right file", always=True)
                break
        if not seen and not bad:
            self.wrong("holds no measurements", "add one line for each measurement")
        if not self.problems:
            grid = np.frombuffer(numbers, dtype=np.float64).reshape(-1, len(places))
            table.names, table.values = found, {name: grid[:, k] for k, name in enumerate(places)}

    def number(self, name: str, cell: str) -> float:
        """The number in a cell; NaN where it is left empty and may be, as half-widths, or where it was reported."""
        text, optional = cell.strip(), name.startswith("d")
        if not NUMBERS["."].fullmatch(text):
            if text:
                self.wrong(
                    f"{name}: {shown(cell)} is not a number", "write a number like -12.5 or 1e-3, in the digits 0 to 9"
                )
            elif not optional:
                self.wrong(f"{name} is empty", "give a number, or take the line out")
            return math.nan
        value = float(text)
        if abs(value) > LARGEST:
            self.wrong(f"{name} is {shown(cell)}", f"give a number up to {LARGEST:g}, or take the line out")
        elif optional and value < 0:
            self.wrong(f"{name}: the half-width {shown(cell)} is negative", "give a number >= 0")
        return value


# ------------------------------------------------------------------------------------------------------------------
# Poses to be reached, in a CSV table: pose,x,y,z,qw,qx,qy,qz.

COLUMNS = ["pose", *POSE]
_REMEDY = f"give a CSV file with the columns {','.join(COLUMNS)}, in mm"


def load_poses(path: StrPath) -> tuple[Names, Pose]:
    """Names and poses (K) of a file; a column `run` may be there. Raises InputError with every problem."""
    problems = Problems()
    table = read_table(Path(path), 0, problems, _REMEDY, required=lambda _: COLUMNS, optional=lambda _: ["run"])
    problems.raise_any()
    names = table.names["pose"]
    if len(set(names)) < len(names):
        raise unusable(path, "gives a pose twice", "name each pose once")
    return tuple(names), Pose(table.columns(*"xyz"), table.columns(*QUATERNION))


# ------------------------------------------------------------------------------------------------------------------
# Leg readings by pose and run, in a table of their own: what sensors say while a camera takes images.

Readings = dict[tuple[str, str], Floats]  # (n,) mm


def readings_bytes(table: PoseTable) -> bytes:
    """The table pose,run,L1,...,Ln in mm; floats by repr, so that they are read back bit for bit."""
    of_runs = dict(zip(zip(table.pose, table.run, strict=True), table.length.tolist(), strict=True))
    return csv_table(["pose", "run", *leg_columns(table.legs)], ([*key, *row] for key, row in of_runs.items()))


def load_readings(path: Path) -> Readings:
    """The table in a file. Raises InputError with every problem."""
    problems, remedy = Problems(), "give a table pose,run,L1,...,Ln in mm"
    table = read_table(
        path,
        None,
        problems,
        remedy,
        required=lambda legs: ["pose", "run", *leg_columns(max(legs, 1))],
        optional=lambda _: [],
    )
    problems.raise_any()
    values = table.columns(*leg_columns(len(table.values)))
    return dict(zip(zip(table.names["pose"], table.names["run"], strict=True), values, strict=True))
