"""The polynomials that the frames satisfy, in 24 unknowns: the entries of both rotations and translations.

The unknowns are X = E^-1, the camera in the hand (or base) frame, and F, the target in the base (or hand) frame, as
users want them. A point is x = R_X^T (H_i F p - t_X). A pixel u seen to within eps gives four rows, at most zero,

    +-(f_a x_a - (u_a - c_a) x_3) - (eps + half-width) x_3 <= 0          a = 1, 2

for x_3 > 0; x is bilinear in R_X and (t_X, R_F, t_F). The rotations satisfy R R' = I, R' R = I and R = cof R, all of
which are stated although they follow from each other: together they bound the linear relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy
from cpcal.handeye.quadratic_rows import Layout, Monomial, Quadratics, Terms

R_X, T_X, R_F, T_F = range(9), range(9, 12), range(12, 21), range(21, 24)
UNKNOWNS = (
    *(f"X.R{a + 1}{b + 1}" for a in range(3) for b in range(3)),
    *(f"X.t{a}" for a in "xyz"),
    *(f"F.R{a + 1}{b + 1}" for a in range(3) for b in range(3)),
    *(f"F.t{a}" for a in "xyz"),
)
SIZE = len(UNKNOWNS)


def _pairs() -> Indices:
    """Unknowns (P, 2) whose products occur: R_X with all others, and each rotation with itself."""
    between = [(i, j) for i in R_X for j in (*T_X, *R_F, *T_F)]
    within = [pair for part in (R_X, R_F) for pair in combinations_with_replacement(part, 2)]
    return np.array(between + within, dtype=np.intp)


FRAMES = Layout(UNKNOWNS, _pairs())
PAIRS = FRAMES.pairs
PLACE = FRAMES.place


def unknowns_of(frames: HandEyeFrames) -> Floats:
    """(SIZE,) of frames E and F."""
    x = frames.e_rotation.T
    parts = (x.ravel(), -x @ frames.e_translation, frames.f_rotation.ravel(), frames.f_translation)
    return np.concatenate(parts)


def pixel_rows(study: HandEyeStudy, eps: float) -> Quadratics:
    """The rows (4 N) in the order of `row_number`, for the robot's poses as stated."""
    turn, shift = study.motions
    turn, shift = turn[study.image], shift[study.image]
    count = len(turn)
    linear, products = np.zeros((3, count, SIZE)), np.zeros((3, count, len(PAIRS)))
    for a in range(3):
        for b in range(3):
            x = R_X[3 * b + a]
            linear[a, :, x] = shift[:, b]
            products[a, :, PLACE[x, T_X[b]]] = -1.0
            for c in range(3):
                products[a, :, PLACE[x, T_F[c]]] = turn[:, b, c]
                for d in range(3):
                    products[a, :, PLACE[x, R_F[3 * c + d]]] = turn[:, b, c] * study.points[:, d]
    off, width = study.rays - study.camera.center, eps + study.half_width
    lin, pro = [], []
    for a in (0, 1):
        for sign in (1.0, -1.0):
            focal, third = sign * study.camera.focal[a], (-sign * off[:, a] - width)[:, None]
            lin.append(focal * linear[a] + third * linear[2])
            pro.append(focal * products[a] + third * products[2])
    return Quadratics(FRAMES, np.zeros(4 * count), np.concatenate(lin), np.concatenate(pro))


def rotation_equations(part: Sequence[int]) -> list[Terms]:
    """21 polynomials that are zero for the entries of a rotation, whose numbers row by row are in `part`."""
    found: list[Terms] = []
    r = [[part[3 * a + b] for b in range(3)] for a in range(3)]
    for lines in (r, [list(column) for column in zip(*r, strict=True)]):
        for a in range(3):
            for b in range(a, 3):
                terms: dict[Monomial, float] = {
                    (min(i, j), max(i, j)): 1.0 for i, j in zip(lines[a], lines[b], strict=True)
                }
                found.append(terms | ({(): -1.0} if a == b else {}))
    for a in range(3):
        for b in range(3):
            p, q, s, t = (a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3
            first, second = (r[p][s], r[q][t]), (r[p][t], r[q][s])
            found.append({(r[a][b],): 1.0, (min(first), max(first)): -1.0, (min(second), max(second)): 1.0})
    return found


EQUATIONS = [*rotation_equations(R_X), *rotation_equations(R_F)]


def rotation_rows() -> Quadratics:
    """The equations, then their negatives, as rows (84)."""
    return Quadratics.of(FRAMES, [*EQUATIONS, *({m: -c for m, c in terms.items()} for terms in EQUATIONS)])
