"""A problem to be solved: a network, and what is to be minimised or maximised."""

from __future__ import annotations

from dataclasses import dataclass

from cpcal.solver.model import Network
from cpcal.solver.network import Expr


@dataclass(frozen=True, eq=False)
class StatedProblem:
    """objective  None: all solutions are asked for
    maximize   whether the objective is to be as large as can be
    integer    names of components that take whole numbers only"""

    network: Network
    objective: Expr | None = None
    maximize: bool = False
    integer: tuple[str, ...] = ()
