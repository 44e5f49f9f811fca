"""One leg of a Gough platform as a constraint network (paper, eq. 15; DESIGN section 1).

Unknowns x = (a, b, l) in mm: base joint centre `a` in the base frame, mobile joint centre `b` in the mobile
frame, length offset `l`; and the model error eps, in mm, itself an unknown of the network.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.interval import Arithmetic, Box, IntervalArray
from cpcal.network import ConstraintNetwork, Expr, norm
from cpcal.network.expression import sqr
from cpcal.robot import Campaign, rotation_matrix

Floats = npt.NDArray[np.float64]

PARAMETERS = ("a[0]", "a[1]", "a[2]", "b[0]", "b[1]", "b[2]", "l")


def leg_box(center: npt.ArrayLike, delta: float) -> Box:
    """X0: the parameters (7,) within `delta` mm of `center`, rounded outward."""
    bounds = IntervalArray.around(center, delta)
    return Box(PARAMETERS, bounds.lo, bounds.hi)


def leg_network(
    campaign: Campaign, leg: int, box: Box, *, engine: Arithmetic, eps: tuple[float, float] = (0.0, np.inf)
) -> ConstraintNetwork:
    """The N equations `|g(x, M_k)| <= eps` of leg number `leg` (from 1), each for SOME reading M_k in its set.

    Parameters range over `box` (named as PARAMETERS), the model error over `eps`. A leg is longer than eps
    for every reading: `L_k - lambda_k + l >= eps` is part of the model.
    """
    k = leg - 1
    net = ConstraintNetwork()
    a = net.variable("a", 3, (box.lo[:3], box.hi[:3]))
    b = net.variable("b", 3, (box.lo[3:6], box.hi[3:6]))
    offset = net.variable("l", (), (box.lo[6], box.hi[6]))
    error = net.variable("eps", (), eps)
    position = net.reading(campaign.position, campaign.position_radius)
    length = net.reading(campaign.length[:, k], campaign.length_radius[:, k])
    arm = net.constant(rotation_enclosure(campaign.quaternion, engine)) @ b
    distance = norm(position + _turned(net, arm, campaign.rotation_radius) - a)
    net.add((distance - (length + offset)).within((-error, error)))
    shortest = IntervalArray.around(campaign.length[:, k], campaign.length_radius[:, k]).lo
    net.add(offset + shortest >= error)
    return net


def _turned(net: ConstraintNetwork, v: Expr, radius: Floats) -> Expr:
    """`R(1, s) v` for the readings s with `|2 s_i| <= radius_i`: v + 2 (s x v + s x (s x v)) / (1 + s.s)."""
    if not radius.any():
        return v
    s = net.reading(np.zeros_like(radius), 0.5 * radius)
    once = _cross(s, v)
    return v + 2.0 * (once + _cross(s, once)) / (1.0 + sqr(s).sum(-1))[:, None]


def _cross(x: Expr, y: Expr) -> Expr:
    """Cross product of rows, shape (N, 3)."""
    forth, back = [1, 2, 0], [2, 0, 1]
    return x[:, forth] * y[:, back] - x[:, back] * y[:, forth]


def rotation_enclosure(quaternion: Floats, engine: Arithmetic) -> IntervalArray:
    """Enclosure (N, 3, 3) of the rational matrices of quaternions (N, 4), scalar first, divided by |q|^2."""
    q = [IntervalArray.point(quaternion[:, k]) for k in range(4)]
    e = engine
    square = [e.sqr(x) for x in q]
    total = e.add(e.add(square[0], square[1]), e.add(square[2], square[3]))
    two = IntervalArray.point(2.0)

    def entry(i: int, j: int) -> IntervalArray:
        if i == j:  # 1 - 2 (sum of the other two vector parts) / |q|^2, written without cancellation
            others = [1 + k for k in range(3) if k != i]
            plus, minus = e.add(square[0], square[1 + i]), e.add(square[others[0]], square[others[1]])
            return e.div(e.sub(plus, minus), total)
        k = 3 - i - j
        sign = 1.0 if (j - i) % 3 == 2 else -1.0
        scalar = e.mul(e.mul(q[0], q[1 + k]), IntervalArray.point(sign))
        return e.div(e.mul(two, e.add(e.mul(q[1 + i], q[1 + j]), scalar)), total)

    entries = [entry(i, j) for i in range(3) for j in range(3)]
    shape = (len(quaternion), 3, 3)
    return IntervalArray(
        np.stack([x.lo for x in entries], axis=1).reshape(shape),
        np.stack([x.hi for x in entries], axis=1).reshape(shape),
    )


def residuals(campaign: Campaign, leg: int, parameters: npt.ArrayLike) -> Floats:
    """`g(x, M_k)` in mm, shape (N,), at the centres of the reading sets; plain floating point."""
    x = np.asarray(parameters, np.float64)
    arm = rotation_matrix(campaign.quaternion) @ x[3:6]
    distance = np.linalg.norm(campaign.position + arm - x[:3], axis=1)
    return np.asarray(distance - campaign.length[:, leg - 1] - x[6])
