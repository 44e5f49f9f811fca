"""Branch and prune as an iterator, the strategies that it splits boxes by, and what it finds."""

from cpcal.solver.search.conclusion import conclusion
from cpcal.solver.search.divide import DepthStrategy, Divide
from cpcal.solver.search.orders import ORDERS, BestFirst, Node, Priority, breadth_first, depth_first
from cpcal.solver.search.passes import Contracting, Pass, Proof, StepProver, divided
from cpcal.solver.search.paving import Paving, Solution
from cpcal.solver.search.race import Contender, Race
from cpcal.solver.search.regions import clusters, difference, hull, volume
from cpcal.solver.search.search import Decision, Event, EventKind, Piece, Process, Search
from cpcal.solver.search.spread import Spread, spread_over
from cpcal.solver.search.strategies import STRATEGIES, LargestFirst, RoundRobin, Smear, bisect
from cpcal.solver.search.whole import WholeNumbers

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
