"""The lens as polynomials: the distortion d(x, y) with its first three derivatives, also by its coefficients.

d is a sum of fixed vector polynomials of degree up to 7, one for the straight ray and one for each of k1, k2, p1, p2,
k3. So every derivative is a table of numbers times the monomials of (x, y), exact and one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats

_DEGREE = 7
_POWERS = [(a, b) for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]  # of x and y in each monomial
_ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]  # of the derivatives by x, y
# where the derivatives of each order stand in _ORDERS, as full tensors
_FIRST = np.array([1, 2])
_SECOND = np.array([[3, 4], [4, 5]])
_THIRD = np.array([[[6, 7], [7, 8]], [[7, 8], [8, 9]]])

Polynomial = dict[tuple[int, int], float]  # powers of x and y -> coefficient


def _fields() -> list[tuple[Polynomial, Polynomial]]:
    """The vector polynomials that 1, k1, k2, p1, p2, k3 stand before: x and y components."""
    r2: Polynomial = {(2, 0): 1.0, (0, 2): 1.0}
    r4: Polynomial = {(4, 0): 1.0, (2, 2): 2.0, (0, 4): 1.0}
    r6: Polynomial = {(6, 0): 1.0, (4, 2): 3.0, (2, 4): 3.0, (0, 6): 1.0}

    def ray_times(radial: Polynomial) -> tuple[Polynomial, Polynomial]:
        return {(a + 1, b): c for (a, b), c in radial.items()}, {(a, b + 1): c for (a, b), c in radial.items()}

    p1: tuple[Polynomial, Polynomial] = {(1, 1): 2.0}, {(2, 0): 1.0, (0, 2): 3.0}
    p2: tuple[Polynomial, Polynomial] = {(2, 0): 3.0, (0, 2): 1.0}, {(1, 1): 2.0}
    return [ray_times({(0, 0): 1.0}), ray_times(r2), ray_times(r4), p1, p2, ray_times(r6)]


def _derivative(polynomial: Polynomial, orders: tuple[int, int]) -> Polynomial:
    for axis, times in enumerate(orders):
        for _ in range(times):
            polynomial = {
                (p[0] - (axis == 0), p[1] - (axis == 1)): c * p[axis] for p, c in polynomial.items() if p[axis] > 0
            }
    return polynomial


def _table() -> Floats:
    """(monomials, derivatives, 2 components, 6 fields)."""
    table = np.zeros((len(_POWERS), len(_ORDERS), 2, 6))
    for k, field in enumerate(_fields()):
        for i, component in enumerate(field):
            for j, orders in enumerate(_ORDERS):
                for powers, coefficient in _derivative(component, orders).items():
                    table[_POWERS.index(powers), j, i, k] = coefficient
    return table


_TABLE = _table()
_OF_X, _OF_Y = np.array(_POWERS).T


@dataclass(frozen=True, eq=False)
class Jet:
    """d at points (..., 2) with its derivatives; the trailing axes of the derivatives count x and y.

    value (..., 2), first (..., 2, 2), second (..., 2, 2, 2), third (..., 2, 2, 2, 2)
    """

    value: Floats
    first: Floats
    second: Floats
    third: Floats


def jet(normalised: Floats, distortion: Floats) -> Jet:
    """The lens of `distortion` (k1, k2, p1, p2, k3) at points (..., 2)."""
    table = _TABLE @ np.concatenate([[1.0], distortion])
    return _jet(_monomials(normalised), table)


def jets_by_coefficient(normalised: Floats) -> Jet:
    """The derivatives of `jet` by k1, k2, p1, p2, k3: the same fields with an axis of 5 after those of the points."""
    table = np.moveaxis(_TABLE[..., 1:], -1, 1)
    return _jet(_monomials(normalised), table)


def _monomials(normalised: Floats) -> Floats:
    powers = np.ones((_DEGREE + 1, *normalised.shape))
    np.multiply.accumulate(np.broadcast_to(normalised, (_DEGREE, *normalised.shape)), axis=0, out=powers[1:])
    return np.moveaxis(powers[_OF_X, ..., 0] * powers[_OF_Y, ..., 1], 0, -1)


def _jet(monomials: Floats, table: Floats) -> Jet:
    """table (monomials, ..., derivatives, 2)."""
    product = monomials @ table.reshape(len(_POWERS), -1)
    all_of_it = product.reshape(*monomials.shape[:-1], *table.shape[1:])
    components_first = np.swapaxes(all_of_it, -1, -2)
    return Jet(
        all_of_it[..., 0, :],
        components_first[..., _FIRST],
        components_first[..., _SECOND],
        components_first[..., _THIRD],
    )
