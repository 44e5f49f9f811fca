"""What the page of a study says of its images: some of them with what was found, counts, errors, time, pixel sets.

`images.json` keeps it beside the study, as text and JPEG pictures, ready for the page.
"""

from __future__ import annotations

import base64
import binascii
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cpcal.common.errors import InputError, Problem
from cpcal.files.tables import json_object
from cpcal.report.study_tables import TextTable

IMAGES_NAME = "images.json"
FORMAT = "cpcal-images/1"

_JPEG = b"\xff\xd8"


@dataclass(frozen=True)
class Picture:
    """An image with what was found drawn into it; `jpeg` in base64."""

    caption: str
    width: int
    height: int
    jpeg: str


@dataclass(frozen=True)
class ImagesFound:
    """In the order of the page. Tables may be left out: None. `sets_said` introduces `sets` and `brackets`."""

    said: tuple[str, ...]
    pictures: tuple[Picture, ...]
    counts: TextTable
    errors: TextTable | None = None
    time: TextTable | None = None
    sets: TextTable | None = None
    brackets: TextTable | None = None
    sets_said: tuple[str, ...] = field(default=())


def picture(caption: str, jpeg: bytes, size: tuple[int, int]) -> Picture:
    return Picture(caption, *size, base64.b64encode(jpeg).decode("ascii"))


def save_images(found: ImagesFound, folder: Path) -> None:
    """Raises OSError."""
    text = json.dumps({"format": FORMAT, **asdict(found)}, indent=1, ensure_ascii=False)
    (folder / IMAGES_NAME).write_text(text + "\n", encoding="utf-8")


def load_images(folder: Path) -> ImagesFound | None:
    """None where there were no images. Raises InputError."""
    path = folder / IMAGES_NAME
    if not path.exists():
        return None
    try:
        return _found(json_object(path, "run cpcal demo --images", "run cpcal demo --images again"))
    except (ValueError, KeyError, TypeError) as error:
        what = f"is not what cpcal wrote: {type(error).__name__}: {error}"
        raise InputError([Problem(str(path), what[:200], "run cpcal demo --images again")]) from None


def _found(data: dict[str, Any]) -> ImagesFound:
    if data.pop("format") != FORMAT:
        raise ValueError("another format")
    tables = {name: _table(data[name]) for name in ("counts", "errors", "time", "sets", "brackets")}
    counts = tables.pop("counts")
    if counts is None:
        raise ValueError("no counts")
    pictures = tuple(_picture(entry) for entry in data["pictures"])
    introduced = _texts(data["sets_said"])
    if len(introduced) != 2 and tables["sets"] is not None:
        raise ValueError("the sets are not introduced")
    return ImagesFound(_texts(data["said"]), pictures, counts, **tables, sets_said=introduced)


def _picture(data: dict[str, Any]) -> Picture:
    jpeg = str(data["jpeg"])
    try:
        content = base64.b64decode(jpeg, validate=True)
    except binascii.Error as error:
        raise ValueError(f"a picture is garbled: {error}") from None
    if not content.startswith(_JPEG):
        raise ValueError("a picture is no JPEG")
    return Picture(str(data["caption"]), int(data["width"]), int(data["height"]), jpeg)


def _table(data: dict[str, Any] | None) -> TextTable | None:
    return None if data is None else TextTable(_texts(data["head"]), tuple(_texts(row) for row in data["rows"]))


def _texts(data: list[Any]) -> tuple[str, ...]:
    if not all(isinstance(text, str) for text in data):
        raise TypeError("a text is none")
    return tuple(data)
