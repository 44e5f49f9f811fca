"""The lenses that cameras have: how a direction (x, y) = (X / Z, Y / Z) is bent, with derivatives up to the third.

With r^2 = x^2 + y^2 and the numbers in OpenCV's order

    brown     k1, k2, p1, p2, k3              d = (x, y) c(k1, k2, k3) + t
    rational  k1, k2, p1, p2, k3, k4, k5, k6  d = (x, y) c(k1, k2, k3) / c(k4, k5, k6) + t
    fisheye   k1, k2, k3, k4                  d = (x, y) (a / r) (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8),  a = atan r

where c(k, l, m) = 1 + k r^2 + l r^4 + m r^6 and
t = (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y).
Each is (x, y) g(r^2) + t with a radial factor g.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.vision.lens import Jet, jet

Series = tuple[Floats, Floats, Floats, Floats]  # a function of s = r^2 and its first three derivatives

_NEAR = 1e-2  # below this r^2 the series of atan(r) / r has all digits
_TERMS = 12


class Lens(ABC):
    """names: of the lens's numbers, in order. Arrays x, y of any shape; numbers (n,)."""

    name: str
    names: tuple[str, ...]

    @abstractmethod
    def radial(self, s: Floats, numbers: Floats) -> Series:
        """g with its derivatives by s = r^2."""

    def tangential(self, numbers: Floats) -> tuple[float, float]:
        """p1, p2."""
        return float(numbers[2]), float(numbers[3])

    def bent(self, x: Floats, y: Floats, numbers: Floats) -> tuple[Floats, Floats]:
        """The two components of d."""
        p1, p2 = self.tangential(numbers)
        r2 = x * x + y * y
        g = self.radial(r2, numbers)[0]
        return (
            x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def slopes(self, x: Floats, y: Floats, numbers: Floats) -> tuple[Floats, Floats, Floats]:
        """The derivatives of the first component by x, of it by y (and of the other by x), of the other by y."""
        p1, p2 = self.tangential(numbers)
        g, slope, *_ = self.radial(x * x + y * y, numbers)
        cross = 2.0 * slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        xx = g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        yy = g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        return xx, cross, yy

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        """d at points (..., 2) with its derivatives: those of (x, y) g, and of t as the polynomial lens has them."""
        p1, p2 = self.tangential(numbers)
        t = jet(points, np.array([0.0, 0.0, p1, p2, 0.0]))  # (x, y) + t
        one = np.eye(2)
        g, g1, g2, g3 = (d[..., None, None, None, None] for d in self.radial((points * points).sum(axis=-1), numbers))
        p = points
        pp = p[..., :, None] * p[..., None, :]
        ppp = pp[..., None] * p[..., None, None, :]
        mixed = one[:, :, None] * p[..., None, None, :] + one[:, None, :] * p[..., None, :, None]
        mixed = mixed + one * p[..., :, None, None]
        squares = np.einsum("ij,kl->ijkl", one, one) + np.einsum("ik,jl->ijkl", one, one)
        squares = squares + np.einsum("il,jk->ijkl", one, one)
        pairs = one[:, :, None, None] * pp[..., None, None, :, :] + one * pp[..., :, :, None, None]
        pairs = pairs + np.einsum("ik,...jl->...ijkl", one, pp) + np.einsum("jl,...ik->...ijkl", one, pp)
        pairs = pairs + np.einsum("il,...jk->...ijkl", one, pp) + np.einsum("jk,...il->...ijkl", one, pp)
        return Jet(
            t.value + p * (g[..., 0, 0, 0] - 1.0),
            t.first + one * (g[..., 0, 0] - 1.0) + 2.0 * g1[..., 0, 0] * pp,
            t.second + 2.0 * g1[..., 0] * mixed + 4.0 * g2[..., 0] * ppp,
            t.third + 2.0 * g1 * squares + 4.0 * g2 * pairs + 8.0 * g3 * ppp[..., None] * p[..., None, None, None, :],
        )


class Brown(Lens):
    name, names = "brown", ("k1", "k2", "p1", "p2", "k3")

    def radial(self, s: Floats, numbers: Floats) -> Series:
        k1, k2, _, _, k3 = numbers.tolist()
        return _cubic(s, k1, k2, k3)

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        return jet(points, numbers)  # a polynomial throughout: one product of tables


class Rational(Lens):
    name, names = "rational", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

    def radial(self, s: Floats, numbers: Floats) -> Series:
        k1, k2, _, _, k3, k4, k5, k6 = numbers.tolist()
        n, n1, n2, n3 = _cubic(s, k1, k2, k3)
        d, d1, d2, d3 = _cubic(s, k4, k5, k6)
        g = n / d
        g1 = (n1 - g * d1) / d
        g2 = (n2 - 2.0 * g1 * d1 - g * d2) / d
        return g, g1, g2, (n3 - 3.0 * g2 * d1 - 3.0 * g1 * d2 - g * d3) / d


class Fisheye(Lens):
    name, names = "fisheye", ("k1", "k2", "k3", "k4")

    def tangential(self, numbers: Floats) -> tuple[float, float]:
        return 0.0, 0.0

    def radial(self, s: Floats, numbers: Floats) -> Series:
        h = _angle_by_radius(s)
        one, zero = np.ones_like(s), np.zeros_like(s)
        square = _product((s, one, zero, zero), _product(h, h))  # a^2
        total: Series = (zero, zero, zero, zero)
        for k in (*numbers[::-1].tolist(), 1.0):  # Horner's rule
            value, *slopes = _product(total, square)
            total = (value + k, slopes[0], slopes[1], slopes[2])
        return _product(h, total)


LENSES: dict[str, Lens] = {lens.name: lens for lens in (Brown(), Rational(), Fisheye())}


def _cubic(s: Floats, a: float, b: float, c: float) -> Series:
    """1 + a s + b s^2 + c s^3."""
    return (
        1.0 + s * (a + s * (b + s * c)),
        a + s * (2.0 * b + s * 3.0 * c),
        2.0 * b + s * 6.0 * c,
        np.full_like(s, 6.0 * c),
    )


def _product(f: Series, g: Series) -> Series:
    """Leibniz's rule."""
    return (
        f[0] * g[0],
        f[1] * g[0] + f[0] * g[1],
        f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2],
        f[3] * g[0] + 3.0 * f[2] * g[1] + 3.0 * f[1] * g[2] + f[0] * g[3],
    )


def _angle_by_radius(s: Floats) -> Series:
    """h = atan(r) / r; away from 0 from 2 s h' + h = 1 / (1 + s) and that, derived: near it by the series."""
    t = np.where(s < _NEAR, 1.0, s)  # so that nothing is divided by nearly nothing
    r = np.sqrt(t)
    h = np.arctan(r) / r
    h1 = (1.0 / (1.0 + t) - h) / (2.0 * t)
    h2 = (-1.0 / (1.0 + t) ** 2 - 3.0 * h1) / (2.0 * t)
    h3 = (2.0 / (1.0 + t) ** 3 - 5.0 * h2) / (2.0 * t)
    series = np.polynomial.Polynomial([(-1.0) ** k / (2 * k + 1) for k in range(_TERMS)])
    near = np.minimum(s, _NEAR)
    far = (h, h1, h2, h3)
    out = [np.where(s < _NEAR, series.deriv(k)(near) if k else series(near), far[k]) for k in range(4)]
    return out[0], out[1], out[2], out[3]
