from .expression import Constraint, Expr, maximum, minimum, norm, sqr, sqrt
from .forms import CentredForm, evaluate
from .network import ConstraintNetwork
from .polynomial import PolynomialForms, PolynomialSystem, one_sided_rows
from .rows import rows_tape
from .tape import Tape

__all__ = [
    "CentredForm",
    "Constraint",
    "ConstraintNetwork",
    "Expr",
    "PolynomialForms",
    "PolynomialSystem",
    "Tape",
    "evaluate",
    "maximum",
    "minimum",
    "norm",
    "one_sided_rows",
    "rows_tape",
    "sqr",
    "sqrt",
]
