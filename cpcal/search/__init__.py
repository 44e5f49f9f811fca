"""Branch and prune as an iterator, and the strategies that it splits boxes by."""

from cpcal.search.search import Event, EventKind, Node, Search
from cpcal.search.strategies import LargestFirst, Smear, bisect

__all__ = ["Event", "EventKind", "LargestFirst", "Node", "Search", "Smear", "bisect"]
