"""How target.toml and camera.toml are opened: files of few sections, read with every problem and its line."""

from __future__ import annotations

import os
from pathlib import Path

from cpcal.common.errors import Problems
from cpcal.files.documents import small_file
from cpcal.files.toml_reader import Table, TomlReader

__all__ = ["Table", "TomlReader", "opened"]


def opened(
    path: str | os.PathLike[str], format_: str, sections: tuple[str, ...], problems: Problems
) -> TomlReader | None:
    """A reader of the TOML file `path`, its format and the names of its sections looked at; None if it is none."""
    file = Path(path)
    content = small_file(file, problems, "write one as docs/vision-files.md shows")
    if content is None:
        return None
    return TomlReader.of(content, str(file), format_, (*sections, "provenance"), problems)
