"""Branch and prune as an iterator, the strategies that it splits boxes by, and what it finds."""

from cpcal.solver.search.passes import (
    STRATEGIES,
    Contracting,
    Divide,
    LargestFirst,
    Proof,
    StepProver,
    bisect,
    divided,
    light,
)
from cpcal.solver.search.paving import Paving, Solution, conclusion
from cpcal.solver.search.race import Contender, Race
from cpcal.solver.search.search import ORDERS, Decision, Event, EventKind, Node, Observer, Piece, Search

__all__ = [
    "ORDERS",
    "STRATEGIES",
    "Contender",
    "Contracting",
    "Decision",
    "Divide",
    "Event",
    "EventKind",
    "LargestFirst",
    "Node",
    "Observer",
    "Paving",
    "Piece",
    "Proof",
    "Race",
    "Search",
    "Solution",
    "StepProver",
    "bisect",
    "conclusion",
    "divided",
    "light",
]
