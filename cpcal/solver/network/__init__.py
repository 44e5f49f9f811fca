"""What must hold: expressions, constraints, networks, and their rewriting to polynomial form."""

from cpcal.solver.network.expression import Constraint, Expr
from cpcal.solver.network.forms import CentredForm, evaluate
from cpcal.solver.network.mathematics import maximum, minimum, norm, sqr, sqrt
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial_rows import PolynomialSystem, polynomial_form
from cpcal.solver.network.rewrite import one_sided_rows
from cpcal.solver.network.tape import Tape

__all__ = [
    "CentredForm",
    "Constraint",
    "ConstraintNetwork",
    "Expr",
    "PolynomialSystem",
    "Tape",
    "evaluate",
    "maximum",
    "minimum",
    "norm",
    "one_sided_rows",
    "polynomial_form",
    "sqr",
    "sqrt",
]
