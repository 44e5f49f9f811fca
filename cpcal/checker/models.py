"""The leg models of the format: what the reading says of the leg's length. Standard library only; part of the checker.

The length is L + e + l + t with t a sum of extra parameters times what is measured, and the square of the leg's
vector is that of the length plus h. See docs/certificate-format.md, "The models".
"""

from __future__ import annotations

from fractions import Fraction as F

from cpcal.checker.measurement import AXES, CENTER, OFFSET, ONE, Matrix, Measurement, arm_matrix, kappa
from cpcal.checker.polynomial import ZERO, ExactBox, Polynomial, Vector

_ALONG, _ABOUT = ("cx", "cy", "cz"), ("tx", "ty", "tz")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", *_ALONG, *_ABOUT), "lateral": ("h",)}


class Model:
    """One of them by its name, which must be one of EXTRA."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.unknowns = ("a1", "a2", "a3", "b1", "b2", "b3", "l", *EXTRA[name], "eps")
        self.eps = len(self.unknowns) - 1
        self._place = {unknown: (i,) for i, unknown in enumerate(self.unknowns)}

    @property
    def corrected(self) -> bool:
        """Whether there is a term t."""
        return "s" in self._place

    @property
    def square(self) -> Polynomial:
        """h."""
        return {self._place["h"]: ONE} if "h" in self._place else {}

    def length(self, m: Measurement, sign: int, reading: Vector) -> Polynomial:
        """L + e + l + t, and eps times the sign."""
        read, place = m.length + reading[6], self._place
        p: Polynomial = {(): read, (OFFSET,): ONE, (self.eps,): sign * ONE}
        if "s" in place:
            p[place["s"]] = read
        if "cx" in place:
            turn = _axial(arm_matrix(m, reading[3:6]))
            for i in AXES:
                p[place[_ALONG[i]]] = m.position[i] + reading[i]
                p[place[_ABOUT[i]]] = turn[i] / kappa(reading)
        return p

    def length_slopes(self, m: Measurement) -> list[Polynomial]:
        """Derivatives of the length with respect to the seven components of the reading, at the centre of its set."""
        place = self._place
        out: list[Polynomial] = [{} for _ in range(6)] + [{(): ONE}]
        if "s" in place:
            out[6][place["s"]] = ONE
        if "cx" in place:
            arm = arm_matrix(m, CENTER[3:6])
            for i in AXES:
                out[i] = {place[_ALONG[i]]: ONE}
                out[3 + i] = {place[_ABOUT[j]]: c for j, c in enumerate(_axial(_turning(i, arm)))}
        return out

    def length_bends(self, m: Measurement, box: ExactBox) -> list[F]:
        """How far each of these slopes is at most from its value at the centre, for x in the box and all readings."""
        if "tx" not in self._place:
            return [ZERO] * 7
        t, square = m.radii[3:6], m.square
        total = sum(t, ZERO)
        size = sum((max(abs(box.lo[i]), abs(box.hi[i])) for (i,) in map(self._place.__getitem__, _ABOUT)), ZERO)
        # R(1,s) = I + 2 (S + S^2) / (1 + s.s) with S u = s x u, of norm |s|, at most `total`
        turned = [2 * square + 4 * total + 4 * t[i] * (total + square) for i in AXES]
        return [ZERO, ZERO, ZERO, *(size * c for c in turned), ZERO]


def _axial(m: Matrix) -> list[F]:
    """The part of a matrix that is odd in the angle of rotation."""
    return [(m[k][j] - m[j][k]) / 2 for j, k in ((1, 2), (2, 0), (0, 1))]


def _turning(i: int, m: Matrix) -> Matrix:
    """The derivative of R(1, s) m with respect to s_i at s = 0."""
    out: list[list[F]] = [[ZERO] * 3 for _ in AXES]
    j, k = (i + 1) % 3, (i + 2) % 3
    out[j], out[k] = [-2 * c for c in m[k]], [2 * c for c in m[j]]
    return out
