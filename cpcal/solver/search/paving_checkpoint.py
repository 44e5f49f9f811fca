"""What `solve` keeps on disk while it works, so that another call can go on from there to the same answer."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from cpcal.common.version import __version__
from cpcal.execution.checkpoint_file import read_checkpoint
from cpcal.execution.keeping import Regularly, garbled, kept
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.dag import topological
from cpcal.solver.search.race import Race
from cpcal.solver.search.saved_race import brought_there, lines_of


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
            asked = repr([_plain(option) for option in options])
            self._of = {"version": __version__, "problem": problem_digest(network), "options": asked}
        self._race: Race | None = None
        self._nodes = 0
        self._regularly = Regularly(self._keep)

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
            self._regularly()

    def end(self, *, complete: bool) -> None:
        """Keep what is left to do; where nothing is, the file goes."""
        if self._path is None:
            return
        if complete:
            self._path.unlink(missing_ok=True)
        else:
            self._regularly.now()

    def _keep(self) -> None:
        if self._path is not None and self._race is not None:
            kept(self._path, self._of, lines_of(self._race, self._nodes))


def _plain(option: object) -> object:
    """Contractors and strategies that are objects by the names of their classes."""
    if isinstance(option, (list, tuple)):
        return [_plain(part) for part in option]
    return option if option is None or isinstance(option, (str, int, float)) else type(option).__name__


def problem_digest(network: ConstraintNetwork) -> str:
    """SHA-256 of domain and constraints as they are built: the same in every process."""
    domain = network.domain
    digest = hashlib.sha256(repr((network.names, network.whole.tolist())).encode())
    digest.update(domain.lo.tobytes() + domain.hi.tobytes())
    places: dict[bytes, int] = {}
    roots = [expr for c in network.constraints for expr in (c.body, c.lower, c.upper)]
    for node in topological(roots):
        places[node.digest] = len(places)
        below = [places[arg.digest] for arg in node.args]
        digest.update(repr((node.op, node.shape, node.parameter, node.name, below)).encode())
        if isinstance(node.data, IntervalArray):
            digest.update(node.data.lo.tobytes() + node.data.hi.tobytes())
        elif node.data is not None:
            digest.update(node.data.tobytes())
    digest.update(repr([places[root.digest] for root in roots]).encode())
    return digest.hexdigest()
