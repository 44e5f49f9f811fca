"""What `solve` keeps on disk while it works, so that another call can go on from there to the same answer."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from cpcal.common.version import __version__
from cpcal.execution.checkpoint_file import Regularly, garbled, kept, read_checkpoint
from cpcal.execution.stopping import asked
from cpcal.solver.limits import Clock
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.search.race import Race
from cpcal.solver.search.saved_race import brought_there, lines_of
from cpcal.solver.search.search import Event


def checkpoint_of(network: ConstraintNetwork, options: Sequence[object]) -> dict[str, str]:
    """Which problem and options a checkpoint is of, so that no other search goes on from it."""
    asked = repr([_plain(option) for option in options])
    return {"version": __version__, "problem": network.digest, "options": asked}


def _plain(option: object) -> object:
    """Contractors and strategies that are objects by the names of their classes."""
    if isinstance(option, np.ndarray):
        return option.tolist()
    if isinstance(option, (list, tuple)):
        return [_plain(part) for part in option]
    return option if option is None or isinstance(option, (str, int, float)) else type(option).__name__


class PavingCheckpoint:
    """The file at `path`, of this network and these options of `solve`; with `path` None nothing is kept.

    `resume`: begin where the file says, if there is one.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        network: ConstraintNetwork,
        options: Sequence[object],
        *,
        resume: bool,
    ) -> None:
        self._path = None if path is None else Path(path)
        self._resume, self._names = resume, network.names
        self._of: dict[str, str] = {}
        if path is not None:
            self._of = checkpoint_of(network, options)
        self._race: Race | None = None
        self._nodes = 0
        self._regularly = Regularly()

    def begin(self, race: Race) -> int:
        """Bring the race to where it stood; how many nodes it had taken. Raises InputError."""
        if self._path is None:
            return 0
        if self._resume and self._path.exists():
            lines = read_checkpoint(self._path, self._of)
            try:
                self._nodes = brought_there(race, self._names, lines)
            except (KeyError, IndexError, TypeError, ValueError) as error:
                raise garbled(self._path, error) from None
        return self._nodes

    def after(self, race: Race, nodes: int) -> None:
        """After every node."""
        self._race, self._nodes = race, nodes
        if self._path is not None:
            self._regularly(self._keep)

    def end(self, *, complete: bool) -> None:
        """Keep what is left to do; where nothing is, the file goes."""
        if self._path is None:
            return
        if complete:
            self._path.unlink(missing_ok=True)
        else:
            self._regularly.now(self._keep)

    def _keep(self) -> None:
        if self._path is not None and self._race is not None:
            kept(self._path, self._of, lines_of(self._race, self._nodes))


def raced(race: Race, keeper: PavingCheckpoint, clock: Clock, progress: Callable[[Event], None] | None) -> int:
    """Run the race, from where the checkpoint says, until it ends or is stopped; how many nodes it has taken in all."""
    nodes = before = keeper.begin(race)
    try:
        for event in race:
            nodes += 1
            keeper.after(race, nodes)
            if progress is not None:
                progress(event)
            if clock.over(nodes - before) or asked():
                break
    except KeyboardInterrupt:
        pass
    return nodes
