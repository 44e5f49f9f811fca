"""One codec for all JSON files: what goes out comes back, and nothing else is accepted."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import pytest

from cpcal import Box, InputError
from cpcal.common.codec import Document


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Inner:
    size: int

    def __post_init__(self) -> None:
        if self.size < 0:
            raise ValueError("size is negative")


@dataclass(frozen=True)
class Outer:
    name: str
    colour: Colour
    numbers: tuple[float, ...]
    pair: tuple[int, str]
    inner: Inner | None
    widths: Mapping[str, float]
    box: Box
    flag: Annotated[bool, {"json": "called"}] = False


FILE = Document(Outer, "x.json", "cpcal-test/1", "certify again")
VALUE = Outer(
    "é\n", Colour.BLUE, (0.1, 5e-324, -0.0, math.inf, -math.inf), (1, "x"), Inner(3), {"a": 1.0},
    Box(["x", "y"], [0.0, -math.inf], [0.1, math.inf]), True,
)  # fmt: skip


def test_what_was_written_comes_back(tmp_path):
    path = FILE.save(VALUE, tmp_path / "new")
    found = FILE.load(path.parent)
    assert found == VALUE
    assert math.copysign(1.0, found.numbers[2]) == -1.0
    assert FILE.save(found, tmp_path).read_bytes() == path.read_bytes()
    assert json.loads(path.read_text())["called"] is True
    assert [p.name for p in path.parent.iterdir()] == ["x.json"]


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("format", "cpcal-test/2", "not of format"),
        ("name", 5, "name is no text"),
        ("colour", "green", "none of red, blue"),
        ("numbers", 5, "no list"),
        ("numbers", [True], r"numbers\[0\] is no number"),
        ("numbers", [int("9" * 400)], "no finite number"),
        ("pair", [1], "no list of 2"),
        ("pair", [1.0, "x"], r"pair\[0\] is no whole number"),
        ("inner", {}, "inner lacks size"),
        ("inner", {"size": 1, "\x1b": 2}, "mean nothing"),
        ("inner", {"size": -1}, "size is negative"),
        ("widths", {"a": "b"}, "widths.'a' is no number"),
        ("box", {"names": ["x"], "lo": [1.0], "hi": [0.0]}, "no box"),
        ("box", {"names": ["x", "x"], "lo": [0.0, 0.0], "hi": [1.0, 1.0]}, "lacks or garbles"),
        ("box", None, "no object"),
        ("called", 1, "called is no true or false"),
        ("extra", 1, "mean nothing"),
    ],
)
def test_other_types_are_refused(tmp_path, key, value, text):
    path = FILE.save(VALUE, tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(InputError, match=text) as caught:
        FILE.load(tmp_path)
    assert "certify again" in str(caught.value)
    assert "\x1b" not in str(caught.value)


def test_every_field_is_needed(tmp_path):
    path = FILE.save(VALUE, tmp_path)
    data = json.loads(path.read_text())
    for key in data:
        path.write_text(json.dumps({k: v for k, v in data.items() if k != key}))
        with pytest.raises(InputError, match="not of format" if key == "format" else f"lacks {key}"):
            FILE.load(tmp_path)
