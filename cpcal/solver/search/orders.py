"""The order in which the undecided boxes of a search are taken: lower priority first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows


@dataclass(frozen=True)
class Node:
    """An undecided box; `serial` counts nodes in order of creation, `state` is what the parent's decision handed on.

    `decided`: the decision, where whoever made the parent's has made this one, too.
    """

    box: Box
    depth: int
    serial: int
    state: Any = None
    decided: Any = field(default=None, compare=False, repr=False)


Priority = Callable[[Node], float]


def depth_first(node: Node) -> float:
    """The latest box first: few boxes wait at any time."""
    return -float(node.serial)


def breadth_first(node: Node) -> float:
    """The least divided box first: what is known of the whole domain grows evenly."""
    return float(node.depth)


class BestFirst:
    """The box first whose midpoint violates the constraints least (to first order nothing: by its worst row)."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._rows = Rows(network)

    def __call__(self, node: Node) -> float:
        values = self._rows.linearize(node.box.mid).values
        worst = float(np.max(np.maximum(values, 0.0), initial=0.0))
        return worst if np.isfinite(worst) else np.inf


ORDERS: dict[str, Callable[[ConstraintNetwork], Priority]] = {
    "depth": lambda network: depth_first,
    "breadth": lambda network: breadth_first,
    "best": BestFirst,
}
