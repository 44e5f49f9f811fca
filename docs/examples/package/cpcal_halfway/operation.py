"""An operation, made of those that are there: a function that returns an expression."""

from __future__ import annotations

import cpcal


def logsumexp(*terms: cpcal.Expr) -> cpcal.Expr:
    """log(sum(exp(x))), taken apart around the first term so that it does not overflow."""
    first, *others = terms
    total = sum((cpcal.exp(x - first) for x in others), start=cpcal.exp(first - first))
    return first + cpcal.log(total)
