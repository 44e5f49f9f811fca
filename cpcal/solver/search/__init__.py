"""Branch and prune as an iterator, the strategies that it splits boxes by, and what it finds."""

from cpcal.solver.search.conclusion import conclusion
from cpcal.solver.search.orders import ORDERS, BestFirst, Node, Priority, breadth_first, depth_first
from cpcal.solver.search.paving import Paving, Solution
from cpcal.solver.search.regions import clusters, difference, hull, volume
from cpcal.solver.search.search import DepthStrategy, Event, EventKind, Search
from cpcal.solver.search.strategies import STRATEGIES, LargestFirst, RoundRobin, Smear, bisect

__all__ = [
    "ORDERS",
    "STRATEGIES",
    "BestFirst",
    "DepthStrategy",
    "Event",
    "EventKind",
    "LargestFirst",
    "Node",
    "Paving",
    "Priority",
    "RoundRobin",
    "Search",
    "Smear",
    "Solution",
    "bisect",
    "breadth_first",
    "clusters",
    "conclusion",
    "depth_first",
    "difference",
    "hull",
    "volume",
]
