"""What target.toml and camera.toml have in common: a file of few sections, read with every problem and its line."""

from __future__ import annotations

import os
from pathlib import Path

from cpcal.errors import Problems, shown
from cpcal.files.campaign_reader import small_file
from cpcal.files.campaign_settings import Reader, line_numbers, parsed

Table = dict[str, object]


def opened(
    path: str | os.PathLike[str], format_: str, sections: tuple[str, ...], problems: Problems
) -> SectionReader | None:
    """A reader of the TOML file `path`, its format and the names of its sections looked at; None if it is none."""
    file = Path(path)
    content = small_file(file, problems, "write one as docs/vision-files.md shows")
    document = None if content is None else parsed(content, str(file), problems, format_)
    if content is None or document is None:
        return None
    reader = SectionReader(document, line_numbers(content.decode("utf-8-sig"), document), str(file), problems)
    reader.known((), document, ("format", *sections, "provenance"))
    reader.format(format_)
    return reader


class SectionReader(Reader):
    """Reads values out of sections; what is wrong is noted, and something harmless returned."""

    def required(self, name: str, keys: tuple[str, ...], optional: tuple[str, ...] = ()) -> Table | None:
        """The section `name`, with note of it or keys of it that are missing or mean nothing."""
        table = self.section(name)
        if table is None:
            if name not in self.document:
                self.wrong((), f"the section [{name}] is missing", f"add [{name}] with {', '.join(keys)}")
            return None
        self.known((name,), table, (*keys, *optional))
        for key in keys:
            if key not in table:
                self.wrong((name,), f"the key {key!r} is missing in [{name}]", f"add {key} = ...")
        return table

    def text(self, path: tuple[str, ...], table: Table) -> str:
        value = table.get(path[-1], "")
        if not isinstance(value, str):
            self.wrong(path, f"{path[-1]} is {shown(value)}, not text", "put it in quotes")
            return ""
        return value

    def truth(self, path: tuple[str, ...], table: Table) -> bool:
        value = table.get(path[-1], True)
        if not isinstance(value, bool):
            self.wrong(path, f"{path[-1]} is {shown(value)}", "write true or false")
            return True
        return value

    def positive(self, path: tuple[str, ...], table: Table, unit: str) -> float:
        if path[-1] not in table:
            return 1.0
        before = len(self.problems)
        value = self.number(path, path[-1], table[path[-1]], signed=True)
        if len(self.problems) == before and not value > 0.0:
            self.wrong(path, f"{path[-1]} is {value:g}", f"give a positive number of {unit}")
        return value

    def whole(self, path: tuple[str, ...], table: Table, least: int, most: int) -> int:
        value = table.get(path[-1], least)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.wrong(path, f"{path[-1]} is {shown(value)}", f"give a whole number from {least} to {most}")
            return least
        return value

    def rows(self, path: tuple[str, ...], table: Table, width: int, meaning: str) -> list[list[float]]:
        """Rows of `width` numbers; a row is called by its number, which counts from 0 as in the arrays."""
        if path[-1] not in table:
            return []
        values = table[path[-1]]
        if not isinstance(values, list) or not values:
            self.wrong(path, f"{path[-1]} is not a list of rows", f"give rows of {meaning}, in brackets")
            return []
        return [
            self.checked(path, f"row {i} of {path[-1]}", row, width, meaning, signed=True)
            for i, row in enumerate(values)
        ]
