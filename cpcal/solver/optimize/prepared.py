"""What proposing and proving points of one network takes, set up once for all questions about it."""

from __future__ import annotations

from functools import cached_property

from cpcal.solver.interval import Arithmetic
from cpcal.solver.network import Constraint, ConstraintNetwork
from cpcal.solver.network.dag import leaves
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.witness import WitnessProver


class Prepared:
    """A network whose variable `objective` is to be minimised, over its domain or over parts of it.

    Each part is made when it is first wanted: a search that begins with a proved point may never propose one.
    """

    def __init__(self, network: ConstraintNetwork, objective: str, engine: Arithmetic) -> None:
        self.network, self.engine = network, engine
        self.name, self.objective = objective, network.names.index(objective)

    @cached_property
    def rows(self) -> Rows:
        return Rows(self.network)

    @cached_property
    def prover(self) -> WitnessProver:
        return WitnessProver(self.network, self.objective, self.engine)

    @cached_property
    def minimax(self) -> bool:
        """Whether every constraint may be mended by the objective."""
        return all(self._enters(constraint) for constraint in self.network.constraints)

    def _enters(self, constraint: Constraint) -> bool:
        leaf = self.network.leaf_of(self.name)
        return any(node is leaf for node in leaves((constraint.body, constraint.lower, constraint.upper)))
