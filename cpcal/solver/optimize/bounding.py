"""What is done to one node of the branch and bound: cut with the incumbent, contract, decide what comes next."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace

from cpcal.execution.executors import Place
from cpcal.execution.outcomes import Shared
from cpcal.execution.stopping import Stopped, asked
from cpcal.solver.contract import Contraction, Step, Strategy, shrunk
from cpcal.solver.interval import Box
from cpcal.solver.optimize.incumbent import Incumbent, Known
from cpcal.solver.search import Contracting, Decision, EventKind, Node, Piece, bisect, divided

Row = tuple[int, int]  # constraint, element

_SHRINK = 0.8  # go on with a node while some width falls below this share of what it was
_SETTLE = 0.95  # the same for a node that was closed from the start, where only the enclosure is at stake
_SUBTREE = 2  # boxes that are decided for each of a round of several: few that a better point would spare
_THIN = 1e-12  # a width below this share of the domain's does not count


@dataclass(frozen=True)
class Branch:
    """What decisions about a node depend on, besides its box.

    found  the part of the box that all contractors have reached (see `cpcal.solver.search.passes`)
    fresh  no fit has begun here since the last division
    rows   of the step on the way here that raised the objective last
    """

    found: Box
    fresh: bool
    rows: frozenset[Row] = frozenset()


class Bounding:
    """The process of a branch and bound: every decision is made of the node and of the incumbent.

    Without `enclose` no work is spent on a box that is closed. Where weights have proved less than was found, the work
    goes on until both are settled; boxes are divided where `strategy` divides what was found, as long as that is open.
    """

    def __init__(
        self,
        incumbent: Incumbent,
        contracting: Contracting,
        strategy: Strategy,
        enclose: bool,
        place: Place | None = None,
    ) -> None:
        self._incumbent, self._contracting, self._strategy, self._enclose = incumbent, contracting, strategy, enclose
        self._place = place  # where rounds of several nodes are decided; None: here
        self._travels: Shared[Bounding] | None = None

    def __call__(self, node: Node) -> Decision:
        (decision,) = self.all([node])
        return decision

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """The decisions of a round, each from the incumbent as it is at its beginning, so that their order, and where
        they are made, change nothing. What they find counts from its end.

        In a round of several nodes each is the root of a subtree: pieces carry the decisions about them. Raises Stopped
        between two nodes.
        """
        before = self._incumbent.state
        if len(nodes) == 1:
            made = [self._grown(nodes[0], before, 1)]
        elif self._place is None:
            made = self.grown(nodes, before)
        else:
            size = -(-len(nodes) // self._place[1])
            parts = [(nodes[k : k + size], before) for k in range(0, len(nodes), size)]
            made = [one for part in self._shared().mapped(self._place, _grown, parts) for one in part]
        for _, known in made:
            self._incumbent.learn(known, before)
        return [decision for decision, _ in made]

    def grown(self, nodes: Sequence[Node], before: Known) -> list[tuple[Decision, Known]]:
        """The subtrees of some nodes, and the incumbent after each of them, if it was `before` at its beginning."""
        return [self._grown(node, before, _SUBTREE) for node in nodes]

    def _grown(self, root: Node, before: Known, most: int) -> tuple[Decision, Known]:
        """Decide a node, then what comes of it, most urgent first: so many boxes at most."""
        known = self._incumbent.at(before)
        made: list[Decision] = []
        links: list[tuple[int, int]] = []  # of each decision: that of its parent, and which piece of it
        frontier = [(0.0, 0, 0, root)]
        while frontier and len(made) < most:
            reason = asked() if most > 1 else None  # the whole round begins anew some day
            if reason is not None:
                raise Stopped(reason)
            _, parent, place, node = heapq.heappop(frontier)
            decision = self._decision(node, known)
            if decision.kind in (EventKind.SPLIT, EventKind.CONTRACTED):
                depth = node.depth + (decision.kind is EventKind.SPLIT)
                for k, piece in enumerate(decision.pieces):
                    child = Node(piece.box, depth, -1, piece.state)
                    heapq.heappush(frontier, (float(piece.box.lo[known.objective]), len(made), k, child))
            made.append(decision)
            links.append((parent, place))
        for k in range(len(made) - 1, 0, -1):
            parent, place = links[k]
            pieces = list(made[parent].pieces)
            pieces[place] = replace(pieces[place], decided=made[k])
            made[parent] = replace(made[parent], pieces=tuple(pieces))
        return made[0], known.state

    def _shared(self) -> Shared[Bounding]:
        """All but the point and the executor, for workers."""
        if self._travels is None:
            alone = copy(self)
            alone._incumbent, alone._place = self._incumbent.at(Known(None, 0)), None
            self._travels = Shared(alone)
        return self._travels

    def _decision(self, node: Node, known: Incumbent) -> Decision:
        branch = node.state
        before = known.cut(node.box)
        if before.is_empty:
            return Decision(EventKind.PRUNED, Contraction(before))
        was_closed = known.closed(before)
        found_before = known.cut(branch.found)
        done = self._contracting.contract(before, found_before)
        step = done.contraction
        branch = replace(branch, rows=self.raising(step.steps) or branch.rows)
        pays = self._pays(before, step.box, was_closed) or self._pays(found_before, done.found, was_closed)
        # boxes that contraction closes alone need no other fit than the first
        wanted = branch.fresh and not known.closed(step.box) and not (pays and known.served)
        point = step.point
        if point is None and known.witness is None and not step.box.is_empty:
            point = step.box.mid  # no program says better where the objective has no bounds yet
        if point is not None and wanted:
            pays = known.propose(point) or pays
            branch = replace(branch, fresh=False)
        left = replace(step, box=known.cut(step.box))
        branch = replace(branch, found=known.cut(done.found))
        kind, pieces = self._next(left.box, branch, pays, was_closed, known)
        return Decision(kind, left, pieces, done.uses, done.proof)

    def raising(self, steps: Iterable[Step]) -> frozenset[Row]:
        """The rows of the last step that raised the objective, or proved a box empty."""
        name = self._incumbent.domain.names[self._incumbent.objective]
        raised = [s for s in steps if s.variable is None or (s.variable == name and s.side == "lo")]
        return frozenset(raised[-1].rows) if raised else frozenset()

    def _pays(self, before: Box, after: Box, was_closed: bool) -> bool:
        """Whether another pass is worth while."""
        counts = before.width > _THIN * self._incumbent.domain.width
        return shrunk(before.width[counts], after.width[counts], _SETTLE if was_closed else _SHRINK)

    def _next(
        self, box: Box, branch: Branch, pays: bool, was_closed: bool, known: Incumbent
    ) -> tuple[EventKind, tuple[Piece, ...]]:
        """The box itself for another pass, or to be kept once it is settled, else its pieces by the strategy.

        Where that finds nothing to divide, the objective itself is halved.
        """
        if box.is_empty:
            return EventKind.PRUNED, ()
        closed = known.closed(box)
        if pays and closed == was_closed and (self._enclose or not closed):
            return EventKind.CONTRACTED, (Piece(box, branch),)
        pieces = () if known.settled(box) else self._pieces(box, branch, known)
        return (EventKind.SPLIT, pieces) if pieces else (EventKind.KEPT, (Piece(box, branch),))

    def _pieces(self, box: Box, branch: Branch, known: Incumbent) -> tuple[Piece, ...]:
        """Pieces of the node's box, cut where what was found is cut; a fit may begin in the first of them."""
        found = box if known.settled(branch.found) else branch.found
        cuts = divided(box, found, lambda part: self._strategy.split(part) or bisect(part, self._incumbent.objective))
        return tuple(
            Piece(piece, replace(branch, found=branch.found.intersect(piece), fresh=k == 0))
            for k, piece in enumerate(cuts)
        )


def _grown(bounding: Bounding, item: tuple[Sequence[Node], Known]) -> list[tuple[Decision, Known]]:
    return [(_light(decision), known) for decision, known in bounding.grown(*item)]


def _light(decision: Decision) -> Decision:
    """Without what only the contractors needed."""
    steps = tuple(replace(step, weights=None) for step in decision.contraction.steps)
    pieces = tuple(p if p.decided is None else replace(p, decided=_light(p.decided)) for p in decision.pieces)
    contraction = replace(decision.contraction, steps=steps, point=None, polyhedron=None)
    return replace(decision, contraction=contraction, pieces=pieces)
