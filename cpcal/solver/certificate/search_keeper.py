"""What a minimisation keeps on disk while it works, so that another call can go on from there to the same answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from cpcal.common.errors import CpcalError
from cpcal.execution.checkpoint_file import Line, Regularly, garbled, kept, read_checkpoint
from cpcal.execution.stopping import asked
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.optimize import Minimum
from cpcal.solver.optimize.saved import Saved

_LONG = 1.0  # seconds: a search that is not done twice


class SearchKeeper:
    """Keeps where one search stands, and its recording, every few seconds and at the end, if boxes are left then.

    path    of the file; None: nothing is kept
    of      what the file is of: it is refused for anything else
    resume  begin where the file says, if there is one
    """

    def __init__(
        self, path: Path | None, of: Mapping[str, str], recording: Recording | None, *, resume: bool = False
    ) -> None:
        self._path, self._of, self._recording, self._resume = path, of, recording, resume
        self._saved: Callable[[], Saved] | None = None
        self._regularly = Regularly()

    def resumed(self) -> Saved | None:
        """Where to go on, the recording brought there; None to begin. Raises InputError."""
        if self._path is None or not (self._resume and self._path.exists()):
            return None
        lines = read_checkpoint(self._path, self._of)
        try:
            found = Saved.from_lines([line["search"] for line in lines if "search" in line])
            steps = [line for line in lines if "search" not in line]
            if (self._recording is None) != (not steps):
                raise ValueError("it was kept with certificates, or without, and this run is not")
            if self._recording is not None:
                self._recording.restore(steps)
            return found
        except (KeyError, ValueError, TypeError, CpcalError) as error:
            raise garbled(self._path, error) from None

    def __call__(self, saved: Callable[[], Saved]) -> None:
        """After every node: `saved` says where the search stands."""
        self._saved = saved
        if self._path is not None:
            self._regularly(self._keep)

    def end(self, found: Minimum) -> None:
        """The search is over. Keep it where boxes are left, or it took long, for what comes next may be interrupted."""
        torn = found.interrupted and not asked()  # an exception broke it off between any two lines
        if not torn and (found.pending or found.seconds > _LONG):
            self.keep()

    def keep(self) -> None:
        """Now."""
        self._regularly.now(self._keep)

    def done(self, found: Minimum) -> None:
        """The answer is in its place: where nothing is left to go on with, the file goes."""
        if self._path is not None and not (found.pending or found.interrupted):
            self._path.unlink(missing_ok=True)

    def _keep(self) -> None:
        if self._path is None or self._saved is None:
            return
        if self._recording is None or self._recording.whole:
            kept(self._path, self._of, self._lines(self._saved()))

    def _lines(self, saved: Saved) -> Iterator[Line]:
        for line in saved.lines():
            yield {"search": line}
        if self._recording is not None:
            yield from self._recording.saved()
