"""What is proved to exist: whole boxes of solutions, and boxes that hold exactly one."""

from cpcal.solver.existence.deadline import stop_flag
from cpcal.solver.existence.equalities import Equalities, Linearization
from cpcal.solver.existence.inside import Inside
from cpcal.solver.existence.operators import Operator, hansen_sengupta, krawczyk, square_of
from cpcal.solver.existence.quantified import ReadingConstraint, highest, reads, upper_ends
from cpcal.solver.existence.unique import Unique, UniquenessProver, prove_unique

__all__ = [
    "Equalities",
    "Inside",
    "Linearization",
    "Operator",
    "ReadingConstraint",
    "Unique",
    "UniquenessProver",
    "hansen_sengupta",
    "highest",
    "krawczyk",
    "prove_unique",
    "reads",
    "square_of",
    "stop_flag",
    "upper_ends",
]
