"""Tables as CSV, safe to open in a spreadsheet.

A spreadsheet computes a text that begins with = + - or @, so such a name is written with an apostrophe before it, and
read back without. A name that has apostrophes there of its own gets one more, so that every name comes back as it was.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence

_CALLS = re.compile("[(|\uff08\uff5c]")  # a formula without one of these calls nothing
_RUNS = re.compile("'*[=+\\-@\uff1d\uff0b\uff0d\uff20]")  # also the wide forms, which some spreadsheets take for them


def guarded(text: str) -> str:
    """The text of a cell as it is written."""
    return "'" + text if _RUNS.match(text) else text


def unguarded(cell: str) -> str:
    """The text that was written so."""
    return cell[1:] if cell.startswith("'") and _RUNS.match(cell) else cell


def file_cell(name: str) -> str:
    """The name of a file: as it is, for tables are joined by it, but for one that a spreadsheet would run."""
    return guarded(name) if _CALLS.search(name) else name


def csv_table(header: Sequence[str], rows: Iterable[tuple[Sequence[str], Iterable[float | None]]]) -> bytes:
    """A CSV file of rows of names and numbers; floats by repr, so that they are read back bit for bit; None: empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    for names, numbers in rows:
        writer.writerow([*map(guarded, names), *("" if value is None else repr(value) for value in numbers)])
    return buffer.getvalue().encode()
