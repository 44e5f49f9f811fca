"""Checkpoints: when one is due, and how it is a file that says what it is of and is read whole or not at all.

It is JSON Lines, compressed. Where it cannot be written the work goes on.

{"format": "cpcal-checkpoint/1", "of": {...}}     what it is of, word for word
...                                               what was kept, a JSON object a line
{"lines": n, "sha256": "..."}                     how many lines stand before this one, and their digest
"""

import gzip
import hashlib
import json
import logging
import shutil
import time
import zlib
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from cpcal.common.codec import decoded, encoded
from cpcal.common.errors import CpcalError, InputError, unusable
from cpcal.common.files import StrPath, replacing, unwritable
from cpcal.common.values import Texts

FORMAT = "cpcal-checkpoint/1"
SIZE_MAX = 2**31  # bytes, unpacked

Line = dict[str, Any]
T = TypeVar("T")

_EVERY = 5.0  # seconds between two checkpoints of a search
_SHARE = 20.0  # and at least so many times as long as the last one took
_LOGGER = logging.getLogger("cpcal")
_LEVEL = 3  # of compression: a tenth of the size, in little time
_REMEDY = "run again without --resume, which begins anew"


def write_checkpoint(path: Path, of: Mapping[str, Any], lines: Iterable[Line]) -> None:
    """Replace the checkpoint, all or nothing. Raises InputError; then the one before is there as it was."""
    digest, count = hashlib.sha256(), 0
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None
    with replacing(path) as raw, gzip.GzipFile("", "wb", _LEVEL, raw, mtime=0) as file:
        for line in ({"format": FORMAT, "of": dict(of)}, *lines):
            text = json.dumps(line, separators=(",", ":")).encode() + b"\n"
            digest.update(text)
            file.write(text)
            count += 1
        file.write(json.dumps({"lines": count, "sha256": digest.hexdigest()}).encode() + b"\n")


def read_checkpoint(path: Path, of: Mapping[str, Any]) -> list[Line]:
    """What was kept. Raises InputError for a file that is cut off, garbled, of another version or of other things."""
    try:
        with gzip.open(path, "rb") as file:
            content = file.read(SIZE_MAX + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise _refused(path, f"is cut off or no checkpoint ({error})") from None
    if len(content) > SIZE_MAX or not content.endswith(b"\n"):
        raise _refused(path, "is cut off, or too large")
    *texts, last = content[:-1].split(b"\n")
    try:
        end, lines = json.loads(last), [json.loads(text) for text in texts]
    except (ValueError, RecursionError):
        raise _refused(path, "is garbled") from None
    digest = hashlib.sha256(b"".join(text + b"\n" for text in texts)).hexdigest()
    if end != {"lines": len(texts), "sha256": digest} or not all(isinstance(line, dict) for line in lines):
        raise _refused(path, "is cut off or garbled: its last line does not fit the others")
    if not lines or lines[0].get("format") != FORMAT:
        raise _refused(path, f"is not of format {FORMAT}")
    stated, asked = lines[0].get("of"), json.loads(json.dumps(dict(of)))
    if not isinstance(stated, dict):
        raise _refused(path, "is of another run: all differ")
    others = sorted(key for key in {*stated, *asked} if stated.get(key) != asked.get(key))
    if others:
        raise _refused(path, f"is of another run: {', '.join(others)} differ")
    return lines[1:]


def _refused(path: Path, what: str) -> InputError:
    return unusable(str(path), what, _REMEDY)


class Checkpoint:
    """Where one search stands, in a file: kept every few seconds, and never so often that it takes much of the time.

    path    of the file; None: nothing is kept
    of      what the file is of: it is refused for anything else
    resume  begin where the file says, if there is one
    """

    def __init__(self, path: StrPath | None, of: Texts, *, resume: bool) -> None:
        self._path, self._of, self._resume = None if path is None else Path(path), of, resume
        self._next = time.monotonic() + _EVERY
        self._lines: Callable[[], Iterable[Line]] | None = None

    def restored(self, restore: Callable[[list[Line]], T]) -> T | None:
        """What `restore` makes of the lines that were kept; None to begin. Raises InputError."""
        if self._path is None or not (self._resume and self._path.exists()):
            return None
        lines = read_checkpoint(self._path, self._of)
        try:
            return restore(lines)
        except (KeyError, IndexError, TypeError, ValueError, CpcalError) as error:
            raise garbled(self._path, error) from None

    def after(self, lines: Callable[[], Iterable[Line]]) -> None:
        """After every node: `lines` say where the search stands."""
        self._lines = lines
        if time.monotonic() >= self._next:
            self.keep()

    def keep(self) -> None:
        """Now, due or not."""
        if self._path is not None and self._lines is not None:
            began = time.monotonic()
            kept(self._path, self._of, self._lines())
            now = time.monotonic()
            self._next = now + max(_EVERY, _SHARE * (now - began))

    def done(self) -> None:
        """Nothing is left to go on with: the file goes."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def kept(path: Path, of: Texts, lines: Iterable[Line]) -> bool:
    """Write, or say in the log that it could not be: no checkpoint is worth the run."""
    try:
        write_checkpoint(path, of, lines)
    except InputError as error:
        _say_once(str(error.problems[0]))
        return False
    return True


def garbled(path: Path, error: Exception) -> InputError:
    """What to raise for a checkpoint that is whole, and still says nothing that can be gone on with."""
    return _refused(path, f"lacks or garbles something ({error})")


# ------------------------------------------------------------------------------------------------------------------
# What a run keeps on disk while it works, so that another one can go on from there.
#
# Two files a leg, in the folder `checkpoint` of the run: `legN.answer` once the leg is answered, with its certificates;
# before that `legN.search`, where its branch and bound stands. Whoever works on the leg writes that one.

FOLDER = "checkpoint"


class Checkpoints(NamedTuple):
    """The folder, and what its files are of: they are refused for anything else. `resume`: what is there counts."""

    folder: Path
    of: Texts
    resume: bool = False

    def begin(self, kind: type[T]) -> list[tuple[T, dict[str, bytes]]]:
        """Forget what is there; or, to be resumed: the answers of legs that have one, each with its certificates.

        Raises InputError when a file there is refused.
        """
        found = []
        if not self.resume:
            shutil.rmtree(self.folder, ignore_errors=True)
        for path in sorted(self.folder.glob("leg*")) if self.folder.is_dir() else []:
            lines = read_checkpoint(path, {**self.of, "part": path.name})
            try:
                if path.suffix == ".answer":
                    files = {str(line["file"]): str(line["text"]).encode() for line in lines[1:]}
                    found.append((decoded(kind, lines[0]["leg"]), files))
            except (KeyError, IndexError, ValueError, CpcalError) as error:
                raise garbled(path, error) from None
        return found

    def end(self) -> None:
        """The result is in its place: what was kept goes, unless a limit left a search to go on with."""
        if not any(self.folder.glob("*.search")):
            shutil.rmtree(self.folder, ignore_errors=True)

    def part(self, leg: int, kind: str) -> tuple[Path, dict[str, str]]:
        """A file, and what it is of."""
        path = self.folder / f"leg{leg}.{kind}"
        return path, {**self.of, "part": path.name}

    def keep_answer(self, leg: int, answer: object, files: Mapping[str, bytes]) -> None:
        """The leg is answered: that is kept, and where its search stood no longer matters."""
        (path, of), (search, _) = self.part(leg, "answer"), self.part(leg, "search")
        texts = ({"file": name, "text": text.decode()} for name, text in files.items())
        if kept(path, of, [{"leg": encoded(answer)}, *texts]):
            search.unlink(missing_ok=True)


@cache
def _say_once(problem: str) -> None:
    _LOGGER.warning("cpcal: warning: a checkpoint is missing: %s", problem)
