"""Documents from outside: whatever the bytes, a document or one clear refusal."""

import contextlib
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.common.documents import json_object, parsed_object, toml_document
from cpcal.common.errors import InputError, Problems

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
