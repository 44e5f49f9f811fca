"""Rows of degree two in some unknowns, as arrays: what the linear programs are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices

Monomial = tuple[int, ...]
Terms = Mapping[Monomial, float]


@dataclass(frozen=True, eq=False)
class Layout:
    """Names of the unknowns, and the pairs (P, 2) of them whose products occur."""

    names: tuple[str, ...]
    pairs: Indices

    @property
    def size(self) -> int:
        return len(self.names)

    @cached_property
    def place(self) -> dict[Monomial, int]:
        """The number of a pair."""
        return {(int(i), int(j)): k for k, (i, j) in enumerate(self.pairs)}

    @cached_property
    def square(self) -> Bools:
        """(P,) which products are squares."""
        return np.asarray(self.pairs[:, 0] == self.pairs[:, 1])


@dataclass(frozen=True, eq=False)
class Quadratics:
    """Rows `constant + linear x + products x_i x_j <= 0`: (M,), (M, n) and (M, P), in float64."""

    layout: Layout
    constant: Floats
    linear: Floats
    products: Floats

    def __len__(self) -> int:
        return len(self.constant)

    @staticmethod
    def of(layout: Layout, polynomials: Sequence[Terms]) -> Quadratics:
        count = len(polynomials)
        found = Quadratics(
            layout, np.zeros(count), np.zeros((count, layout.size)), np.zeros((count, len(layout.pairs)))
        )
        for k, terms in enumerate(polynomials):
            for monomial, value in terms.items():
                if not monomial:
                    found.constant[k] = value
                elif len(monomial) == 1:
                    found.linear[k, monomial[0]] = value
                else:
                    found.products[k, layout.place[monomial]] = value
        return found

    def centred(self, center: Floats, radius: Floats) -> Quadratics:
        """In u, where x = center + radius u."""
        pairs, size = self.layout.pairs, self.layout.size
        i, j = pairs.T
        constant = self.constant + self.linear @ center + self.products @ (center[i] * center[j])
        spread = np.zeros((len(pairs), size))  # what a product adds to the linear terms
        np.add.at(spread, (np.arange(len(pairs)), i), center[j])
        np.add.at(spread, (np.arange(len(pairs)), j), center[i])
        linear = (self.linear + self.products @ spread) * radius
        return Quadratics(self.layout, constant, linear, self.products * (radius[i] * radius[j]))

    @staticmethod
    def joined(parts: Sequence[Quadratics]) -> Quadratics:
        return Quadratics(
            parts[0].layout,
            np.concatenate([p.constant for p in parts]),
            np.concatenate([p.linear for p in parts]),
            np.concatenate([p.products for p in parts]),
        )
