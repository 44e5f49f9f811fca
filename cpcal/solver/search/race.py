"""Several searches of the same domain take turns; the first that ends is the answer.

Which contractors suit a problem shows only while they work. So each contender gets a slice of nodes a round. One that
has decided less than half of what the first has sits out a round, then two, four and so on until it gets on again. Some
give up after so many rounds. All of it is counted in nodes, so that a race has one course.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from cpcal.common.values import Names
from cpcal.common.version import __version__
from cpcal.solver.contract import Clock
from cpcal.solver.execution.checkpoint_file import Checkpoint, Line
from cpcal.solver.execution.stopping import asked
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.search.search import Event, EventKind, Observer, Search, Standing

_DECIDED = (EventKind.PRUNED, EventKind.KEPT, EventKind.INSIDE)


@dataclass
class Contender:
    """One way to search: `start` builds it when its first turn comes; `slice` nodes make up a turn.

    `turns`: after so many rounds it gives up, unless nobody else is left. `decided` is the share of the domain that it
    has decided, where every division is taken to halve: 1 at the end. Of a turn it has `taken` so many nodes. After its
    last turn it sits out `rest` rounds, up to the round `back`, in which it begins, too.
    """

    name: str
    start: Callable[[], Search]
    slice: int
    turns: int | None = None
    back: int = 0
    nodes: int = 0
    decided: float = 0.0
    rest: int = 0
    taken: int = 0
    search: Search | None = field(default=None, repr=False)

    def turn(self) -> Iterator[Event]:
        """The events of one turn, or of what is left of it; fewer when the search ends."""
        if self.search is None:
            self.search = self.start()
        while self.taken < self.slice:
            event = next(self.search, None)
            if event is None:
                return
            self.nodes += 1
            self.taken += 1
            if event.kind in _DECIDED:
                self.decided += 2.0**-event.node.depth
            yield event
        self.taken = 0

    @property
    def ended(self) -> bool:
        return self.search is not None and not self.search.waiting


class Race:
    """Iterate for all events; `leader` is the contender whose search is the answer so far, in the end the winner.

    Between two events everything that the rest of the race depends on is in `rounds`, `place` (whose turn it is, of
    those alive), `alive`, and the contenders.
    """

    def __init__(self, contenders: Sequence[Contender]) -> None:
        self.contenders, self.alive = tuple(contenders), list(contenders)
        self.rounds = self.place = 0

    @property
    def leader(self) -> Contender:
        """The one that ended, else the last one that goes on longest, of those that have begun."""
        begun = [c for c in self.alive if c.search is not None] or self.alive
        return next((c for c in begun if c.ended), begun[-1 if self.rounds else 0])

    def __iter__(self) -> Iterator[Event]:
        while True:
            while self.place < len(self.alive):
                contender = self.alive[self.place]
                if contender.taken or self.rounds >= contender.back:
                    yield from contender.turn()
                    if contender.ended:
                        return
                    behind = contender.decided < max(other.decided for other in self.alive) / 2
                    contender.rest = max(1, 2 * contender.rest) if behind else 0
                    contender.back = self.rounds + 1 + contender.rest
                self.place += 1
            self.rounds, self.place = self.rounds + 1, 0
            lasting = [c for c in self.alive if c.turns is None or self.rounds < c.turns]
            self.alive = lasting or self.alive

    def sentence(self) -> str:
        """Who won, and against whom."""
        first, started = self.leader, [c for c in self.contenders if c.nodes]
        if len(self.contenders) == 1:
            return f"{first.name}."
        if len(started) == 1:
            return f"{first.name}, which ended in its first turn."
        others = "; ".join(c.name for c in started if c is not first)
        word = "ended first" if first.ended else "went on longest"
        return f"{first.name} {word}, in turns with {others}."


# ------------------------------------------------------------------------------------------------------------------
# Where a race of searches stands between two nodes, as lines of JSON; a race brought there, and run.

_COUNTED = ("nodes", "rest", "back", "taken", "decided")  # JSON keeps floats to the last bit


def lines_of(race: Race, nodes: int) -> Iterator[Line]:
    """A head, then a line a box. The race must stand still meanwhile; `nodes`: of the whole race, to be told again."""
    places = {id(contender): k for k, contender in enumerate(race.contenders)}
    yield {
        "nodes": nodes,
        "rounds": race.rounds,
        "place": race.place,
        "alive": [places[id(contender)] for contender in race.alive],
        "contenders": [
            {"name": c.name, "created": None if c.search is None else c.search.created}
            | {key: getattr(c, key) for key in _COUNTED}
            for c in race.contenders
        ],
    }
    for k, contender in enumerate(race.contenders):
        if contender.search is not None:
            yield from ({"of": k, **line} for line in contender.search.standing().lines())


def brought_there(race: Race, names: Names, lines: Sequence[Line]) -> int:
    """Bring a race that has not begun to where another one of the same contenders stood; the nodes that it had taken.

    Raises KeyError, IndexError, TypeError, ValueError for lines that `lines_of` cannot have written.
    """
    head, *boxes = lines
    if [standing["name"] for standing in head["contenders"]] != [contender.name for contender in race.contenders]:
        raise ValueError("other methods take turns")
    for k, (contender, standing) in enumerate(zip(race.contenders, head["contenders"], strict=True)):
        for key in _COUNTED:
            setattr(contender, key, standing[key])
        if standing["created"] is not None:
            contender.search = contender.start()
            own = (line for line in boxes if line["of"] == k)
            contender.search.restore(Standing.from_lines(standing["created"], names, own))
    race.rounds, race.place = head["rounds"], head["place"]
    race.alive = [race.contenders[k] for k in head["alive"]]
    return int(head["nodes"])


def checkpoint_of(network: ConstraintNetwork, options: Sequence[object]) -> dict[str, str]:
    """Which problem and options a checkpoint is of, so that no other search goes on from it."""
    return {"version": __version__, "problem": network.digest, "options": repr([_plain(option) for option in options])}


def _plain(option: object) -> object:
    """Contractors and strategies that are objects by the names of their classes."""
    if isinstance(option, np.ndarray):
        return option.tolist()
    if isinstance(option, (list, tuple)):
        return [_plain(part) for part in option]
    return option if option is None or isinstance(option, (str, int, float)) else type(option).__name__


def raced(race: Race, keeper: Checkpoint, names: Names, clock: Clock, progress: Observer | None) -> int:
    """Run the race, from where the checkpoint says, until it ends or is stopped; how many nodes it has taken in all.

    Raises InputError for a checkpoint of something else.
    """
    nodes = before = keeper.restored(partial(brought_there, race, names)) or 0
    try:
        for event in race:
            nodes += 1
            keeper.after(partial(lines_of, race, nodes))
            if progress is not None:
                progress(event)
            if clock.over(nodes - before) or asked():
                break
    except KeyboardInterrupt:
        pass
    return nodes
