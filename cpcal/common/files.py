"""The one way to write files: they appear complete or not at all.

A draft stands beside the file that it becomes. Its name cannot be guessed and it is opened exclusively, so that a link
planted under that name is harmless.
"""

import errno
import importlib
import os
import re
import shutil
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, TypeAlias

from cpcal.common.errors import InputError, OutputError, Problem, unusable

StrPath: TypeAlias = str | os.PathLike[str]

DRAFT = re.compile(r"\.[0-9a-f]{24}\.draft")
_CHOOSE = "choose a place that can be written to"
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)


def unwritable(path: StrPath, error: OSError) -> InputError:
    """What to raise when the system refuses to write to `path`."""
    where = os.path.join(*(part for part in Path(path).parts if not DRAFT.fullmatch(part)))  # where it was to be
    return OutputError([Problem(where, f"cannot be written: {error.strerror or error}", _CHOOSE)])


def draft_name() -> str:
    """A hidden name that cannot be guessed."""
    return f".{os.urandom(12).hex()}.draft"


@contextmanager
def replacing(path: StrPath) -> Iterator[BinaryIO]:
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


def write_file(path: StrPath, content: bytes | str) -> Path:
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


# ------------------------------------------------------------------------------------------------------------------
# Files from outside: none can hang the program or fill the memory; pipes and devices are refused before they are read.

SETTINGS_MAX = 2**20  # bytes of a TOML file; a sensible one is hundreds of times smaller


def open_regular(path: Path) -> BinaryIO:
    """The file, open to be read. Raises OSError, also for a pipe, which would hang, or a device, which never ends.

    The open file is checked, so that nothing can take its place between.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "its name holds a NUL")
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        code = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(code, os.strerror(code) if code == errno.EISDIR else "it is no regular file")
    return os.fdopen(descriptor, "rb")


def small_file(path: Path, absent: str, *, most: int = SETTINGS_MAX) -> bytes:
    """The bytes of a file. Raises InputError; `absent` is the remedy when there is no such file."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            content = file.read(size + 1) if size <= most else b""  # what is too large is not read
    except FileNotFoundError:
        raise unusable(path, "does not exist", absent) from None
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise unusable(path, what, "give a file that can be read") from None
    if max(size, len(content)) > most:
        raise unusable(path, f"is larger than {most:,} bytes", "is this the right file?")
    return content


# ------------------------------------------------------------------------------------------------------------------
# Locks on open files that the system takes back when the process ends, however it ends.


def exclusive(descriptor: int) -> None:
    """Lock the file for this process alone, without waiting.

    Raises BlockingIOError while another process has it, OSError where there are no locks.
    """
    if os.name == "nt":
        msvcrt = importlib.import_module("msvcrt")  # of Windows only
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
        return
    fcntl = importlib.import_module("fcntl")  # of POSIX only
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


# ------------------------------------------------------------------------------------------------------------------
# What may name something, and what may be said of it: checked where names come in, for every kind of file and value.
#
# A printable name has no line breaks, control characters, invisible or direction-changing characters and no halves of
# characters, so that it stays what it looks like in every message, table and page.

NAME_MAX = 200  # characters
TEXT_MAX = 20_000

NAME_REMEDY = f"use at most {NAME_MAX} printable characters, on one line"
TEXT_REMEDY = f"write at most {TEXT_MAX:,} printable characters, on one line"
IDENTIFIER_REMEDY = f'use 1 to {NAME_MAX} printable characters, no "/", no space at the ends, not "." or ".."'


def is_text(value: object, most: int = TEXT_MAX) -> bool:
    """Whether it can stand in a provenance; with at most `NAME_MAX` characters name a robot or a target."""
    return isinstance(value, str) and value.isprintable() and len(value) <= most


def is_identifier(value: object) -> bool:
    """Whether it can name a pose, a run or an image; it may be a part of a file's path."""
    if not (isinstance(value, str) and is_text(value, NAME_MAX)):
        return False
    return value not in ("", ".", "..") and "/" not in value and value == value.strip()


def listed(names: Collection[str], most: int = 8) -> str:
    """The first of them, and how many more there are."""
    shown = ", ".join(list(names)[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
