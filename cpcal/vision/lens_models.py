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
from cpcal.vision.lens_kernel import radials

Series = tuple[Floats, Floats, Floats, Floats]  # a function of s = r^2 and its first three derivatives


class Lens(ABC):
    """names: of the lens's numbers, in order. Arrays x, y of any shape; numbers (n,)."""

    name: str
    names: tuple[str, ...]

    @abstractmethod
    def packed(self, numbers: Floats) -> Floats:
        """(9,) as compiled code takes them (`cpcal.vision.lens_kernel`)."""

    def radial(self, s: Floats, numbers: Floats) -> Series:
        """g with its derivatives by s = r^2."""
        flat = np.ascontiguousarray(s, dtype=np.float64).ravel()
        out = np.empty((4, len(flat)))
        radials(self.packed(numbers), flat, out)
        g, g1, g2, g3 = out.reshape(4, *np.shape(s))
        return g, g1, g2, g3

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        """d at points (..., 2) with its derivatives: those of (x, y) g, and of t as the polynomial lens has them."""
        p1, p2 = self.packed(numbers)[1:3].tolist()
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

    def packed(self, numbers: Floats) -> Floats:
        k1, k2, p1, p2, k3 = numbers.tolist()
        return np.array([0.0, p1, p2, k1, k2, k3, 0.0, 0.0, 0.0])

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        return jet(points, numbers)  # a polynomial throughout: one product of tables


class Rational(Lens):
    name, names = "rational", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

    def packed(self, numbers: Floats) -> Floats:
        k1, k2, p1, p2, *others = numbers.tolist()
        return np.array([0.0, p1, p2, k1, k2, *others])


class Fisheye(Lens):
    name, names = "fisheye", ("k1", "k2", "k3", "k4")

    def packed(self, numbers: Floats) -> Floats:
        return np.array([1.0, 0.0, 0.0, *numbers.tolist(), 0.0, 0.0])


LENSES: dict[str, Lens] = {lens.name: lens for lens in (Brown(), Rational(), Fisheye())}
