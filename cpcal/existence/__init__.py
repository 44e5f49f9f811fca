"""What is proved to exist: whole boxes of solutions, and boxes that hold exactly one."""

from cpcal.existence.equalities import Equalities, Linearization
from cpcal.existence.inside import Inside
from cpcal.existence.operators import Operator, chosen, hansen_sengupta, krawczyk, unknowns
from cpcal.existence.readings import ReadingConstraint, highest, reads, upper_ends
from cpcal.existence.unique import Unique, UniquenessProver, prove_unique

__all__ = [
    "Equalities",
    "Inside",
    "Linearization",
    "Operator",
    "ReadingConstraint",
    "Unique",
    "UniquenessProver",
    "chosen",
    "hansen_sengupta",
    "highest",
    "krawczyk",
    "prove_unique",
    "reads",
    "unknowns",
    "upper_ends",
]
