"""Several searches of the same domain take turns; the first that ends is the answer.

Which contractors suit a problem shows only while they work. So each contender gets a slice of nodes a round. One that
decided next to nothing in its turn, or has decided less than half of what the first has, sits out a round, then two,
four and so on until it gets on again; the one that has decided most of the domain never does. Some give up after so
many rounds. All of it is counted in nodes, so that a race has one course.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from cpcal.solver.search.search import Event, EventKind, Search

_PROGRESS = 1 / 200  # of what is undecided: a turn that decides less is one without progress
_DECIDED = (EventKind.PRUNED, EventKind.KEPT, EventKind.INSIDE)


@dataclass
class Contender:
    """One way to search: `start` builds it when its first turn comes; `slice` nodes make up a turn.

    `turns`: after so many rounds it gives up, unless nobody else is left. `decided` is the share of the domain that it
    has decided, where every division is taken to halve: 1 at the end. It sits out `rest` rounds after its last turn.
    """

    name: str
    start: Callable[[], Search]
    slice: int
    turns: int | None = None
    nodes: int = 0
    decided: float = 0.0
    rest: int = 0
    search: Search | None = field(default=None, repr=False)

    def turn(self, most: float = 0.0) -> Iterator[Event]:
        """The events of one turn; fewer when the search ends. `most`: what the first has decided."""
        if self.search is None:
            self.search = self.start()
        before = self.decided
        for _ in range(self.slice):
            event = next(self.search, None)
            if event is None:
                return
            self.nodes += 1
            if event.kind in _DECIDED:
                self.decided += 2.0**-event.node.depth
            yield event
        stalled = self.decided - before < _PROGRESS * (1.0 - before)
        self.rest = max(1, 2 * self.rest) if stalled or self.decided < most / 2 else 0

    @property
    def ended(self) -> bool:
        return self.search is not None and not self.search.waiting


class Race:
    """Iterate for all events; `leader` is the contender whose search is the answer so far, in the end the winner."""

    def __init__(self, contenders: Sequence[Contender]) -> None:
        self.contenders, self._alive = tuple(contenders), list(contenders)
        self.rounds = 0

    @property
    def leader(self) -> Contender:
        """The one that ended, else the last one that goes on longest."""
        return next((c for c in self._alive if c.ended), self._alive[-1 if self.rounds else 0])

    def __iter__(self) -> Iterator[Event]:
        back = {id(contender): 0 for contender in self.contenders}  # the round in which each is back
        while True:
            first = max(self._alive, key=lambda contender: contender.decided)
            for contender in tuple(self._alive):
                if contender is not first and self.rounds < back[id(contender)]:
                    continue
                yield from contender.turn(first.decided)
                if contender.ended:
                    return
                back[id(contender)] = self.rounds + 1 + contender.rest
            self.rounds += 1
            lasting = [c for c in self._alive if c.turns is None or self.rounds < c.turns]
            self._alive = lasting or self._alive

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
