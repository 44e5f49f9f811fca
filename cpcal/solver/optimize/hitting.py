"""Small sets that meet all of a family: what must be left out before none of several proofs holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence


def hitting_set(family: Sequence[Collection[int]], most: int) -> frozenset[int] | None:
    """At most `most` numbers of which every set of the family holds one; None when there are none.

    Exact: a set that is not met must lose one of its members, and all are tried, those of many sets first.
    """
    left = [frozenset(one) for one in family]
    return _hit(left, most)


def _hit(left: list[frozenset[int]], most: int) -> frozenset[int] | None:
    if not left:
        return frozenset()
    if most == 0 or _apart(left) > most:
        return None
    smallest = min(left, key=len)
    counts = Counter(k for one in left for k in one)
    for k in sorted(smallest, key=lambda k: (-counts[k], k)):
        found = _hit([one for one in left if k not in one], most - 1)
        if found is not None:
            return found | {k}
    return None


def _apart(family: list[frozenset[int]]) -> int:
    """How many sets of the family have no common member, chosen greedily: so many numbers are needed at least."""
    taken: set[int] = set()
    count = 0
    for one in sorted(family, key=len):
        if taken.isdisjoint(one):
            taken |= one
            count += 1
    return count
