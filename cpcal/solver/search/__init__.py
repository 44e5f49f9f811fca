"""Branch and prune as an iterator, the strategies that it splits boxes by, and what it finds."""

from cpcal.solver.search.passes import Contracting, DepthStrategy, Divide, Pass, Proof, StepProver, divided
from cpcal.solver.search.paving import Paving, Solution, WholeNumbers, conclusion
from cpcal.solver.search.race import Contender, Race
from cpcal.solver.search.search import (
    ORDERS,
    BestFirst,
    Decision,
    Event,
    EventKind,
    Node,
    Piece,
    Priority,
    Process,
    Search,
    breadth_first,
    clusters,
    depth_first,
    difference,
    hull,
    volume,
)
from cpcal.solver.search.spread import Spread, spread_over
from cpcal.solver.search.strategies import STRATEGIES, LargestFirst, RoundRobin, Smear, bisect

__all__ = [
    "ORDERS",
    "STRATEGIES",
    "BestFirst",
    "Contender",
    "Contracting",
    "Decision",
    "DepthStrategy",
    "Divide",
    "Event",
    "EventKind",
    "LargestFirst",
    "Node",
    "Pass",
    "Paving",
    "Piece",
    "Priority",
    "Process",
    "Proof",
    "Race",
    "RoundRobin",
    "Search",
    "Smear",
    "Solution",
    "Spread",
    "StepProver",
    "WholeNumbers",
    "bisect",
    "breadth_first",
    "clusters",
    "conclusion",
    "depth_first",
    "difference",
    "divided",
    "hull",
    "spread_over",
    "volume",
]
