"""What must hold: expressions, constraints, networks, and their rewriting to polynomial form."""

from cpcal.network.expression import Constraint, Expr, maximum, minimum, norm, sqr, sqrt
from cpcal.network.forms import CentredForm, evaluate
from cpcal.network.network import ConstraintNetwork
from cpcal.network.rewrite import PolynomialSystem, one_sided_rows, polynomial_form
from cpcal.network.sweep import Tape

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
