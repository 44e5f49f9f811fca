"""Equations that follow from a network's polynomial equations, found by eliminating terms between them.

Two equations whose products with monomials share a term give a third without it (an S-polynomial). What comes of it
by Buchberger's algorithm in whole numbers, stopped early, holds wherever the equations hold; the shorter ones of lower
degree bound the unknowns far better than the sums of large terms they come from (F. Benhamou, L. Granvilliers:
Automatic generation of numerical redundancies for non-linear constraint solving, Reliable Computing 3, 1997).
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np
from flint import Ordering, fmpz_mpoly_ctx, fmpz_mpoly_vec

from cpcal.solver.certificate.exact_network import ExactPolynomials, NotStated, Terms
from cpcal.solver.existence import Equalities
from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.number import float_bounds
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr
from cpcal.solver.network.expression import as_expr

_LIMITS = (100, 60, 2000)  # polynomials, terms of one, bits of a coefficient: some milliseconds
_UNKNOWNS, _EQUATIONS, _TERMS, _DEGREE = 30, 60, 60, 12  # of what is tried at all


def consequences(network: ConstraintNetwork) -> tuple[Constraint, ...]:
    """Equations that hold wherever the network's do, with no more terms and of no higher degree.

    Equations that are not polynomial with exact coefficients take no part. Empty where nothing short follows.
    """
    size = len(network.names)
    if size > _UNKNOWNS or not 2 <= Equalities.of(network).count <= _EQUATIONS:
        return ()
    given = _polynomials(network)
    if len(given) < 2:
        return ()
    longest, highest = max(map(len, given)), max(len(m) for m in chain.from_iterable(given))
    if longest > _TERMS or highest > _DEGREE:
        return ()
    context = fmpz_mpoly_ctx.get([f"x{k}" for k in range(size)], Ordering.degrevlex)
    first: Any = fmpz_mpoly_vec([_whole(terms, context, size) for terms in given], context)
    basis, _ = first.buchberger_naive(limits=_LIMITS)
    known = {str(p.primitive()[1]) for p in first}
    short = [p for p in basis if 2 <= len(p) <= longest and p.total_degree() <= highest]
    unknowns = _unknowns(network)
    return tuple(_expression(p, unknowns) == 0.0 for p in short if str(p.primitive()[1]) not in known)


def _polynomials(network: ConstraintNetwork) -> list[Terms]:
    """Of all equations that have an exact form: monomials with their coefficients."""
    exact, out = ExactPolynomials(network), list[Terms]()
    for root in Equalities.of(network).roots:
        try:
            out += [p.terms for p in exact.of(root).ravel() if any(p.terms)]
        except NotStated:
            continue
    return out


def _whole(terms: Terms, context: Any, size: int) -> Any:
    """A polynomial with whole coefficients that has the same zeros."""
    common = math.lcm(*(c.denominator for c in terms.values()))
    powers = {m: tuple(m.count(k) for k in range(size)) for m in terms}
    return context.from_dict({powers[m]: int(c * common) for m, c in terms.items()})


def _unknowns(network: ConstraintNetwork) -> list[Expr]:
    """The components in the order of `names`."""
    return [leaf[index] for leaf in network.variables for index in np.ndindex(leaf.shape)]


def _expression(polynomial: Any, unknowns: list[Expr]) -> Expr:
    """Divided by a power of two, so that no coefficient is above 1."""
    scale = 1 << max(int(c).bit_length() for c in polynomial.coeffs())
    total = as_expr(0.0)
    for exponents, coefficient in polynomial.to_dict().items():
        term = as_expr(IntervalArray(*float_bounds(Fraction(int(coefficient), scale))))
        for k, power in enumerate(exponents):
            term = term * unknowns[k] ** int(power) if power else term
        total = total + term
    return total
