from .expression import Constraint, Expr
from .forms import CentredForm, evaluate
from .mathematics import maximum, minimum, norm, sqr, sqrt
from .network import ConstraintNetwork
from .polynomial_rows import PolynomialSystem, polynomial_form
from .rewrite import one_sided_rows
from .rows_tape import rows_tape
from .tape import Tape

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
    "rows_tape",
    "sqr",
    "sqrt",
]
