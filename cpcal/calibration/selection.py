"""Which poses to measure: those with the best observability index, by greedy choice and exchange (DETMAX).

A pose adds the outer product of its Jacobian's row to the information matrix J^T J of every leg; the singular values
of J are the square roots of its eigenvalues (accurate to about 1e-8 of the largest, which is enough to choose by).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.observability import INDICES, Observability, observability, scaled_blocks
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem

_GAIN = 1e-9  # the relative improvement that counts as one
_SEED = 1e-9  # of the mean information: makes the greedy start's matrices regular before they are so by themselves


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen poses (numbers from 0), that whose loss would cost most first, and their observability."""

    chosen: tuple[int, ...]
    observability: Observability


def select_poses(
    jacobian: Floats, count: int, *, index: str = "product", scale: npt.ArrayLike | None = None
) -> Selection:
    """`count` of N candidate poses with a large observability index: a local optimum, not proved to be the best.

    jacobian  (N, p) or, for n legs that share the poses, (n, N, p); scale as for `observability`
    index     "product" (the D-optimum), "condition" (made small), "smallest" or "noise_amplification"

    The start adds poses one by one, each time that which makes the determinant largest. Then poses are exchanged
    as in DETMAX (Mitchell 1974): add the best one and drop the one that is needed least, or the other way round, as
    long as the index improves.

    InputError when count is not between p and N, or when even all candidates leave a parameter undetermined.
    """
    blocks = scaled_blocks(jacobian, scale)
    candidates, size = blocks.shape[1:]
    problems = []
    if index not in INDICES:
        problems.append(Problem("index", f"there is none called {index!r}", f"choose one of {sorted(INDICES)}"))
    if not size <= count <= candidates:
        remedy = f"give a number from {size}, the parameters of a leg, to {candidates}, the candidates"
        problems.append(Problem("count", f"is {count}", remedy))
    if observability(jacobian, scale).smallest == 0.0:
        what = "does not determine all parameters, even with all poses"
        problems.append(Problem("jacobian", what, "add candidate poses with other orientations"))
    if problems:
        raise InputError(problems)
    search = _Search(np.einsum("lki,lkj->klij", blocks, blocks), index)
    chosen = search.ranked(search.exchanged(search.greedy(count)))
    rows = np.asarray(jacobian)[..., list(chosen), :]
    return Selection(tuple(chosen), observability(rows, scale))


class _Search:
    """Sets of poses as lists of numbers; `outer` (N, n, p, p) is what each adds to the information."""

    def __init__(self, outer: Floats, index: str) -> None:
        self._outer, self._index = outer, INDICES[index]

    def greedy(self, count: int) -> list[int]:
        trace = np.trace(self._outer.mean(axis=0), axis1=-2, axis2=-1)
        information = _SEED * trace[:, None, None] * np.eye(self._outer.shape[-1])
        chosen: list[int] = []
        for _ in range(count):
            gain = np.linalg.slogdet(information + self._outer)[1].sum(axis=1)
            gain[chosen] = -np.inf
            chosen.append(int(np.argmax(gain)))
            information = information + self._outer[chosen[-1]]
        return chosen

    def exchanged(self, chosen: list[int]) -> list[int]:
        best, found = chosen, self._value(chosen)
        while True:
            trials = (self._dropped(self._added(best)), self._added(self._dropped(best)))
            values = [self._value(trial) for trial in trials]
            k = int(np.argmax(values))
            if values[k] <= found * (1.0 + _GAIN):
                return best
            best, found = trials[k], values[k]

    def ranked(self, chosen: list[int]) -> list[int]:
        """By the index that is left without each: the smallest first."""
        chosen = sorted(chosen)
        return [chosen[k] for k in np.argsort(self._without(chosen), kind="stable")]

    def _value(self, chosen: list[int]) -> float:
        return float(self._values(self._outer[chosen].sum(axis=0)[None])[0])

    def _added(self, chosen: list[int]) -> list[int]:
        others = np.setdiff1d(np.arange(len(self._outer)), chosen)
        if not len(others):
            return chosen
        values = self._values(self._outer[chosen].sum(axis=0) + self._outer[others])
        return [*chosen, int(others[np.argmax(values)])]

    def _dropped(self, chosen: list[int]) -> list[int]:
        worst = int(np.argmax(self._without(chosen)))
        return chosen[:worst] + chosen[worst + 1 :]

    def _without(self, chosen: list[int]) -> Floats:
        return self._values(self._outer[chosen].sum(axis=0) - self._outer[chosen])

    def _values(self, information: Floats) -> Floats:
        """The index of information matrices (K, n, p, p), (K,)."""
        values = np.sqrt(np.maximum(0.0, np.linalg.eigvalsh(information))).reshape(len(information), -1)
        return self._index(-np.sort(-values, axis=1))
