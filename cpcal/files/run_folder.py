"""Folders of answers: what is written into them, under a lock, aside, and put in place at the end.

A folder of answers has a head, such as result.json, which is put in place last and taken away first: without it the
folder is unfinished. Files that cpcal did not write are never touched.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cpcal.common.errors import InputError, Problem, unusable
from cpcal.common.files import DRAFT, StrPath, draft_name, exclusive, put_in_place, unwritable

LOCK_NAME = ".cpcal-lock"
_JSON = rb'\s*\{\s*"format":\s*"cpcal-'
_PAGE = rb'<!doctype html>.{0,400}<meta name="generator" content="cpcal'
_STUDY = rb'format = "cpcal-|image,(point,u,v|x,y,z),|file,verdict,'  # the study that a hand-eye run keeps; pose sets
_WRITTEN = re.compile(b"|".join((_JSON, _PAGE, _STUDY)), re.DOTALL)
_ALWAYS = ("campaign.json", r"[\w.-]+\.cert\.jsonl")


@dataclass(frozen=True)
class FolderKind:
    """Answers of one kind: their head, and the names (regular expressions) of the other files."""

    head: str
    others: tuple[str, ...] = ()

    def names(self, folder: Path) -> list[str]:
        """The files of this kind in a folder, the head first."""
        known = re.compile("|".join([re.escape(self.head), *self.others, *_ALWAYS]))
        found = [entry.name for entry in os.scandir(folder) if known.fullmatch(entry.name)]
        return sorted(found, key=lambda name: (name != self.head, name))


RUN = FolderKind("result.json", (r"report\.html",))
ACCURACY = FolderKind("accuracy.json", (r"accuracy\.html",))
FITTED = FolderKind("campaign.json")  # certificates alone
HANDEYE = FolderKind("handeye.json", (r"handeye\.html", r"study\.json"))
POSE_SETS = FolderKind("sets.csv", (r"[\w.-]+\.pose\.json",))


@contextmanager
def answers_into(folder: StrPath, kind: FolderKind) -> Iterator[Path]:
    """A folder aside to write into; when the block ends without an error its files replace the older answers.

    Until then the older answers stay. Raises InputError when another process writes there, when files are in the way
    that cpcal did not write, or when the folder cannot be written.
    """
    target = Path(folder)
    with locked(target) as held:
        check_replaceable(target, kind)
        for leftover in unfinished(target):  # whoever wrote them is dead: we have the lock
            shutil.rmtree(leftover, ignore_errors=True)
        draft = target / draft_name()
        try:
            draft.mkdir()
            yield draft
            if not held():
                raise OSError(0, "the folder was taken away while the answers were found")
            put_in_place(
                draft,
                target,
                sorted((entry.name for entry in draft.iterdir()), key=lambda name: name == kind.head),
                outdated=tuple(kind.names(target)),
            )
        except OSError as error:
            if error.errno is None:  # of no file: a library that cannot be loaded, say
                raise
            raise unwritable(target, error) from error
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def check_replaceable(folder: Path, kind: FolderKind) -> None:
    """InputError when a file that would be replaced is none that cpcal wrote, or the folder is that of a campaign."""
    if not folder.is_dir():
        return
    what, remedy = "is there, and not written by cpcal", "choose another folder, or move it away"
    if (folder / "campaign.toml").exists():
        raise unusable(folder, "is the folder of a campaign", "choose another folder")
    if (folder / "handeye.toml").exists() and not (folder / HANDEYE.head).exists():
        raise unusable(folder, "is the folder of a hand-eye study", "choose another folder")
    strange = [name for name in kind.names(folder) if not _ours(folder / name)]
    if strange:
        raise InputError([Problem(str(folder / name), what, remedy) for name in strange])


def unfinished(folder: Path) -> list[Path]:
    """What runs left that were killed, or are at work."""
    return [path for path in folder.iterdir() if DRAFT.fullmatch(path.name) and path.is_dir()]


@contextmanager
def locked(folder: Path) -> Iterator[Callable[[], bool]]:
    """The folder, made if missing, for us alone; what tells whether it is still the one that was locked. The system
    takes the lock back from the dead. Raises InputError while another process has it."""
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = _locked(folder)
    except BlockingIOError:
        what = "is being written by another run of cpcal"
        raise unusable(folder, what, "wait for it, or choose another folder") from None
    except OSError as error:
        raise unwritable(folder, error) from error
    held = partial(_held, folder, descriptor)
    try:
        yield held
    finally:
        if held():
            with suppress(OSError):
                (folder / LOCK_NAME).unlink()
        os.close(descriptor)
        if made:
            with suppress(OSError):  # not empty
                folder.rmdir()


def _held(folder: Path, descriptor: int) -> bool:
    try:
        there = os.lstat(folder / LOCK_NAME)
    except OSError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))


def _locked(folder: Path) -> int:
    """The open file of the lock. Raises OSError; BlockingIOError while another process has it."""
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
    while True:
        descriptor = os.open(folder / LOCK_NAME, flags, 0o666)
        try:
            exclusive(descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        if _held(folder, descriptor):
            return descriptor
        os.close(descriptor)  # its owner took it away as we came: again


def _ours(path: Path) -> bool:
    """Whether a file begins as cpcal's do."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return _WRITTEN.match(file.read(4096)) is not None
