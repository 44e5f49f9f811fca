"""The tape of a network's rows, which several contractors sweep over."""

from __future__ import annotations

from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.rewrite import one_sided_rows
from cpcal.solver.network.tape import Tape


def rows_tape(network: ConstraintNetwork) -> Tape:
    """Of all rows `r <= 0`, in the order of the constraints; written once for a network and its copies."""
    return network.once("rows", lambda: Tape(network, [row.expr for row in one_sided_rows(network)]))
