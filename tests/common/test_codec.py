"""One codec for all JSON files, and documents from outside: what goes out comes back, nothing else is accepted."""

import contextlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal import Box, InputError
from cpcal.common.codec import Document
from cpcal.common.documents import json_object, parsed_object, toml_document
from cpcal.common.errors import Problems


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


DEEP = 100_000


def refusal(tmp_path, content):
    path = tmp_path / "some.json"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        json_object(path, "name it", "write it again")
    (problem,) = caught.value.problems
    assert problem.remedy == "write it again"
    return problem.what


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"[" * DEEP, "nested too deeply"),
        (b'{"a":' * DEEP, "nested too deeply"),
        (b'{"a":' + b"[" * 500 + b"]" * 500 + b"}", "nested too deeply"),
        (b'{"a": 1, "a": 2}', "'a' is there twice"),
        (b'{"a": NaN}', "'NaN' is no finite number"),
        (b'{"a": -Infinity}', "'-Infinity' is no finite"),
        (b'{"a": 1e999}', "'1e999' is no finite"),
        (b'{"a": ' + b"9" * 5_000 + b"}", "no finite"),
        (b'{"a": ' + b"9" * 500 + b"}", "no finite"),
        (b'{"a": "\\ud800"}', "half a character"),
        (b'{"\\uDFFF": 1}', "half a character"),
        (b"\xff", "not UTF-8"),
        (b"", "is not JSON"),
        (b"[]", "no object"),
        (b"{", "is not JSON"),
    ],
)
def test_what_is_no_sensible_json(tmp_path, content, what):
    assert what in refusal(tmp_path, content)


@given(st.binary(max_size=60) | st.text(alphabet='{}[]",:\\ud8f0123456789eE+-.NIatrufln ', max_size=60))
def test_any_bytes_are_an_object_or_a_value_error(content):
    with contextlib.suppress(ValueError):
        assert isinstance(parsed_object(content), dict)


@given(st.binary(max_size=80) | st.text(alphabet="{}[]\"',=.#\nabt0123456789e+-_:TZ ", max_size=80))
def test_any_bytes_are_toml_or_a_problem(content):
    problems = Problems()
    document = toml_document(content if isinstance(content, bytes) else content.encode(), "x", problems, "y")
    assert (document is None) == (len(problems) == 1)


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        *((f"/dev/{name}", "no regular file") for name in ("zero", "null", "stdin")),
        ("/proc/self/mem", "cannot be read: Input/output error"),
        ("nowhere", "does not exist"),
        (".", "cannot be read: Is a directory"),
        ("a\0b", "its name holds a NUL"),
    ],
)
def test_what_is_no_file_is_refused(tmp_path, path, reason):
    if path.startswith("/") and not os.path.exists(path):
        pytest.skip("not on this system")
    with pytest.raises(InputError, match=reason):
        json_object(tmp_path / path, "name it", "write it again")


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    with (tmp_path / "large").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputError, match="larger than"):
        json_object(tmp_path / "large", "", "")
