"""A checkpoint is read whole and of the same work, or refused; writing one never harms the one before."""

import gzip

import pytest

from cpcal.common.errors import InputError
from cpcal.solver.execution.checkpoint_file import read_checkpoint, write_checkpoint

OF = {"campaign": "abc", "options": "def"}
LINES = [{"k": k, "value": (k / 7.0).hex()} for k in range(200)]


@pytest.fixture
def path(tmp_path):
    write_checkpoint(tmp_path / "folder" / "a", OF, LINES)
    return tmp_path / "folder" / "a"


def test_what_is_written_is_read(path):
    assert read_checkpoint(path, OF) == LINES


def test_wherever_it_is_cut_off_it_is_refused(path):
    whole = path.read_bytes()
    for size in [*range(0, len(whole), 37), len(whole) - 1]:
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="is cut off"):
            read_checkpoint(path, OF)


def test_a_line_less_or_changed_is_refused(path):
    text = gzip.decompress(path.read_bytes())
    lines = text.split(b"\n")
    for changed in (lines[:5] + lines[6:], [*lines[:7], lines[7].replace(b"1", b"2"), *lines[8:]], lines[:-2] + [b""]):
        assert changed != lines
        path.write_bytes(gzip.compress(b"\n".join(changed)))
        with pytest.raises(InputError, match="is cut off or garbled"):
            read_checkpoint(path, OF)


def test_one_of_other_work_is_refused_and_named(path):
    with pytest.raises(InputError, match="of another run: campaign differ"):
        read_checkpoint(path, OF | {"campaign": "xyz"})


def test_one_that_cannot_be_written_leaves_the_older_one(path):
    def lines():
        yield {"k": 1}
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left"):
        write_checkpoint(path, OF, lines())
    assert read_checkpoint(path, OF) == LINES
    assert [p.name for p in path.parent.iterdir()] == ["a"]
