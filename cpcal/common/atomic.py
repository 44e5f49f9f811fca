"""The one way to write files: they appear complete or not at all, and a link planted under a draft's name is harmless.

Drafts have names that cannot be guessed, are opened exclusively, and stand beside what they become.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from cpcal.common.errors import InputError, OutputError, Problem

DRAFT = re.compile(r"\.[0-9a-f]{24}\.draft")
_CHOOSE = "choose a place that can be written to"
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)


def unwritable(path: str | os.PathLike[str], error: OSError) -> InputError:
    """What to raise when the system refuses to write to `path`."""
    where = os.path.join(*(part for part in Path(path).parts if not DRAFT.fullmatch(part)))  # where it was to be
    return OutputError([Problem(where, f"cannot be written: {error.strerror or error}", _CHOOSE)])


def draft_name() -> str:
    """A hidden name that nobody can foresee."""
    return f".{secrets.token_hex(12)}.draft"


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A stream whose bytes become the file `path` when the block ends without an error.

    Raises InputError when the file cannot be written, or is there and no regular file.
    """
    target = Path(path).absolute()
    draft = target.with_name(draft_name())
    try:
        _check_regular(target)
        with os.fdopen(os.open(draft, _NEW, 0o666), "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(draft, target)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        draft.unlink(missing_ok=True)


def write_file(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write one file, text as UTF-8, into a folder that is made if missing; its path. Raises InputError."""
    if "\0" in os.fspath(path):
        raise unwritable(path, OSError(0, "its name holds a NUL"))
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from error
    with replacing(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode())
    return Path(path)


def write_folder(folder: Path, contents: Mapping[str, bytes], *, head: str) -> None:
    """Write files into a folder. Raises InputError.

    A new folder appears complete or not at all. In an existing one other files stay; `head`, without which the others
    are refused, goes first and comes last: an interruption leaves a folder that is refused, never a mixture.
    """
    draft = folder.absolute().with_name(draft_name())
    try:
        draft.parent.mkdir(parents=True, exist_ok=True)
        draft.mkdir()
        for name, content in contents.items():
            write_file(draft / name, content)
        put_in_place(draft, folder, sorted(contents, key=lambda name: name == head), outdated=(head,))
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def put_in_place(draft: Path, folder: Path, names: list[str], *, outdated: tuple[str, ...]) -> None:
    """Move files of `draft` into `folder` in this order, once those that are outdated are gone.

    A folder that is not there yet comes into being whole. Raises OSError.
    """
    if not folder.exists():
        draft.rename(folder)
        return
    for name in outdated:
        (folder / name).unlink(missing_ok=True)
    for name in names:
        (draft / name).replace(folder / name)


def _check_regular(target: Path) -> None:
    """Raises OSError. A device, a FIFO or a folder is not replaced; a link is, and what it points to stays."""
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return
    if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
        raise OSError(0, "it is there, and no regular file")
