"""The constraints as rows `r(x, m) <= 0`, evaluated in floating point at a point, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.interval import IntervalArray
from cpcal.network.network import ConstraintNetwork
from cpcal.network.point import Point
from cpcal.network.rewrite import one_sided
from cpcal.network.sweep import Tape

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RowValues:
    """At one point and the centres of the readings: values (K,), Jacobian (K, n), reading slopes (K, J).

    To first order the readings let row k fall by `room[k]`, the sum of its absolute slopes.
    """

    values: Floats
    jacobian: Floats
    slopes: Floats

    @property
    def room(self) -> Floats:
        return np.asarray(np.abs(self.slopes).sum(axis=1))


class Rows:
    """All one-sided rows of a network, in the order of its constraints."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._rows = [row for k, c in enumerate(network.constraints) for row in one_sided(k, c)]
        self._tape = Tape(network, [row.expr for row in self._rows])
        self._engine = Point()
        self._centers = {k: _center(self._tape.nodes[k].data) for k in range(len(self._tape.nodes)) if not self._tape.nodes[k].args and self._tape.nodes[k].op != "variable"}
        self._seeds, self._directions = self._all_seeds()

    def _all_seeds(self) -> tuple[dict[int, IntervalArray], int]:
        """Unit directions of the variables, then one per component of a reading (all measurements at once)."""
        tape, seeds = self._tape, self._tape.variable_seeds()
        symbols = [(k, j) for k in tape.readings for j in range(int(np.prod(tape.nodes[k].shape[1:])))]
        directions = tape.size + len(symbols)
        for k, seed in seeds.items():
            padding = np.zeros((len(symbols), *seed.shape[1:]))
            seeds[k] = IntervalArray.point(np.concatenate([seed.lo, padding]))
        for d, (k, j) in enumerate(symbols, start=tape.size):
            node = tape.nodes[k]
            assert isinstance(node.data, IntervalArray)
            seed = seeds[k].lo if k in seeds else np.zeros((directions, *node.shape))
            if node.shape:
                flat = seed.reshape((directions, node.shape[0], -1))
                flat[d, :, j] = node.data.rad.reshape((node.shape[0], -1))[:, j]
            else:
                seed[d] = node.data.rad
            seeds[k] = IntervalArray.point(seed)
        return seeds, directions

    def values(self, point: Floats) -> Floats:
        """Row values (K,) at a point (n,) and the centres of the readings."""
        with np.errstate(all="ignore"):
            slots = self._tape.forward(self._engine, IntervalArray.point(point[None]), self._centers)
        return np.concatenate([np.zeros(0), *(slots[self._tape.slot(r)].lo.ravel() for r in self._tape.roots)])

    def linearize(self, point: Floats) -> RowValues:
        """Values and derivatives at a point (n,)."""
        with np.errstate(all="ignore"):
            slots = self._tape.forward(self._engine, IntervalArray.point(point[None]), self._centers)
            tangents = self._tape.tangents(self._engine, slots, self._seeds)
        values, derivatives = [np.zeros(0)], [np.zeros((self._directions, 0))]
        for root in self._tape.roots:
            k = self._tape.slot(root)
            count = int(np.prod(root.shape))
            values.append(np.broadcast_to(slots[k].lo, (1, *root.shape)).ravel())
            tangent = tangents[k]
            derivatives.append(
                np.zeros((self._directions, count)) if tangent is None else tangent.lo.reshape((self._directions, count))
            )
        full = np.concatenate(derivatives, axis=1).T
        n = self._tape.size
        return RowValues(np.concatenate(values), full[:, :n], full[:, n:])


def _center(data: object) -> IntervalArray:
    assert isinstance(data, IntervalArray)
    return IntervalArray.point(data.mid)
