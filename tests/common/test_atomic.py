"""Files appear complete or not at all, and nothing outside is touched."""

import os
import re

import pytest

from cpcal import InputError
from cpcal.common import files
from cpcal.common.files import replacing, write_file, write_folder


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_at_the_end(tmp_path):
    path = tmp_path / "new" / "file"
    assert write_file(path, "é") == path
    assert path.read_bytes() == "é".encode()
    with replacing(path) as stream:
        stream.write(b"half")
        assert path.read_bytes() == "é".encode()
        draft = next(name for name in names(path.parent) if name != "file")
        assert re.fullmatch(r"\.[0-9a-f]{24}\.draft", draft)
    assert path.read_bytes() == b"half"
    assert names(path.parent) == ["file"]


def test_a_failure_leaves_what_was_there(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError, match="division"), replacing(path) as stream:
        stream.write(b"%d" % (1 // 0))
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


def test_a_link_under_the_drafts_name_is_not_followed(tmp_path, monkeypatch):
    (tmp_path / "precious").write_bytes(b"precious")
    monkeypatch.setattr(files, "draft_name", lambda: ".known.draft")
    (tmp_path / ".known.draft").symlink_to("precious")
    with pytest.raises(InputError, match="cannot be written"):
        write_file(tmp_path / "file", b"new")
    assert (tmp_path / "precious").read_bytes() == b"precious"


def test_a_link_in_the_files_place_is_replaced_not_followed(tmp_path):
    (tmp_path / "precious").write_bytes(b"precious")
    (tmp_path / "file").symlink_to("precious")
    write_file(tmp_path / "file", b"new")
    assert (tmp_path / "precious").read_bytes() == b"precious"
    assert not (tmp_path / "file").is_symlink()


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "pipe", tmp_path / "folder", tmp_path / "absent" / "\0"):
        with pytest.raises(InputError, match=r"no regular file|NUL"):
            write_file(path, b"new")
    with pytest.raises(InputError, match="/dev/full"):
        write_file("/dev/full", b"new")
    assert names(tmp_path) == ["folder", "pipe"]


def test_a_folder_appears_complete(tmp_path):
    write_folder(tmp_path / "a" / "b", {"x": b"1", "head": b"2"}, head="head")
    assert names(tmp_path / "a") == ["b"]
    assert names(tmp_path / "a" / "b") == ["head", "x"]
    (tmp_path / "a" / "b" / "mine").write_bytes(b"3")
    write_folder(tmp_path / "a" / "b", {"x": b"4", "head": b"5"}, head="head")
    assert names(tmp_path / "a" / "b") == ["head", "mine", "x"]
    assert (tmp_path / "a" / "b" / "x").read_bytes() == b"4"
