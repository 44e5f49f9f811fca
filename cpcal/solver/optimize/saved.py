"""Where a branch and bound stands between two nodes, as pure values, and as lines of JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpcal.solver.accounts import ContractorUse
from cpcal.solver.interval import Box
from cpcal.solver.optimize.bounding import Branch, Row
from cpcal.solver.optimize.incumbent import Known
from cpcal.solver.optimize.witness import Witness
from cpcal.solver.search import Node, Piece
from cpcal.solver.search.box_lines import bounds_of, box_of


@dataclass(frozen=True)
class Saved:
    """Everything that the rest of a minimisation depends on. `pending` may come from a search that must stand still.

    names                    of the boxes
    pending, kept, created   of the search: undecided nodes, pieces that are fine enough, nodes that were ever made
    known                    of the incumbent
    nodes ... uses           what was counted
    seconds                  that it took until then
    """

    names: tuple[str, ...]
    pending: Iterable[Node]
    kept: tuple[Piece, ...]
    created: int
    known: Known
    nodes: int
    programs: int
    used: frozenset[Row]
    decisive: frozenset[Row]
    uses: tuple[ContractorUse, ...]
    seconds: float

    def lines(self) -> Iterator[dict[str, Any]]:
        """A head, then a line a box; infinite numbers are texts."""
        witness = self.known.witness
        yield {
            "names": list(self.names),
            "witness": None if witness is None else {"point": witness.point.tolist(), "value": witness.value},
            "calls": self.known.calls,
            "created": self.created,
            "nodes": self.nodes,
            "programs": self.programs,
            "used": sorted(self.used),
            "decisive": sorted(self.decisive),
            "uses": [[use.name, use.calls, use.steps] for use in self.uses],
            "seconds": self.seconds,
        }
        for node in self.pending:
            yield {"depth": node.depth, "serial": node.serial, **_branch(node.box, node.state)}
        for piece in self.kept:
            yield _branch(piece.box, piece.state)

    @classmethod
    def from_lines(cls, lines: Sequence[Mapping[str, Any]]) -> Saved:
        """What `lines` gave. Raises KeyError, TypeError, ValueError."""
        head, *boxes = lines
        names = tuple(map(str, head["names"]))
        read = [(line, *_read_branch(names, line)) for line in boxes]
        witness = head["witness"]
        if witness is not None:
            witness = Witness(np.array(witness["point"], np.float64), float(witness["value"]))
        return cls(
            names=names,
            pending=tuple(
                Node(box, int(line["depth"]), int(line["serial"]), branch)
                for line, box, branch in read
                if "serial" in line
            ),
            kept=tuple(Piece(box, branch) for line, box, branch in read if "serial" not in line),
            created=int(head["created"]),
            known=Known(witness, int(head["calls"])),
            nodes=int(head["nodes"]),
            programs=int(head["programs"]),
            used=_rows(head["used"]),
            decisive=_rows(head["decisive"]),
            uses=tuple(ContractorUse(str(name), int(calls), int(steps)) for name, calls, steps in head["uses"]),
            seconds=float(head["seconds"]),
        )


def _branch(box: Box, branch: Branch) -> dict[str, Any]:
    line: dict[str, Any] = {"box": bounds_of(box), "fresh": branch.fresh, "rows": sorted(branch.rows)}
    return line if branch.found == box else line | {"found": bounds_of(branch.found)}


def _read_branch(names: tuple[str, ...], line: Mapping[str, Any]) -> tuple[Box, Branch]:
    box = box_of(names, line["box"])
    found = box_of(names, line["found"]) if "found" in line else box
    return box, Branch(found, bool(line["fresh"]), _rows(line["rows"]))


def _rows(rows: Any) -> frozenset[Row]:
    return frozenset((int(c), int(e)) for c, e in rows)
