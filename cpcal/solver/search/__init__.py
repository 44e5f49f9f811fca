"""Branch and prune as an iterator, the strategies that it splits boxes by, and what it finds."""
