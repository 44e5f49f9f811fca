"""One leg of a Gough platform as a constraint network (paper, eq. 15; DESIGN section 1).

Unknowns x = (a, b, l) in mm: base joint centre `a` in the base frame, mobile joint centre `b` in the mobile
frame, length offset `l`; the extra parameters of the leg model, if it has some; and the model error eps, in mm, itself
an unknown of the network.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.diagnosis import vertical
from cpcal.common.arrays import Floats
from cpcal.common.errors import Problem
from cpcal.common.numbers import nearest
from cpcal.common.numbers import stated as as_stated
from cpcal.legs.models import PLAIN, Drawn, LegModel, Measured, built_in
from cpcal.legs.rotation_kernel import enclosed_rotations
from cpcal.robot import Campaign, Pose, leg_vectors, rotation_matrix
from cpcal.robot.rotation import rotation_numerators
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr, sqr
from cpcal.solver.network.expression import as_expr


def leg_box(center: npt.ArrayLike, delta: float, model: LegModel = PLAIN) -> Box:
    """X0: (a, b, l) within `delta` mm of the first seven of `center`, extra parameters within their half-widths of 0.

    Rounded outward.
    """
    x = np.asarray(center, np.float64)
    bounds = IntervalArray.around(x[:7], delta)
    reach = model.half_widths
    return Box(model.parameters, np.append(bounds.lo, -reach), np.append(bounds.hi, reach))


def leg_network(
    campaign: Campaign,
    leg: int,
    box: Box,
    *,
    engine: Arithmetic,
    eps: tuple[float, float] = (0.0, np.inf),
    model: LegModel = PLAIN,
    stated: bool = False,
) -> ConstraintNetwork:
    """The N equations `|g(x, M_k)| <= eps` of leg number `leg` (from 1), each for SOME reading M_k in its set.

    Parameters range over `box` (named as the model's), the model error over `eps`. A leg is longer than eps
    for every reading: `L_k - lambda_k + l >= eps` is part of every model (without its correction, so that each contains
    the plain one). `stated`: as a certificate states it, see `leg_equation`.
    """
    equation = leg_equation(campaign, leg, box, engine=engine, model=model, stated=stated)
    net, scale = equation.network, equation.scale
    error = net.variable("eps", (), eps)
    bound = error if scale is None else scale * error
    net.add(equation.body.within((-bound, bound)))
    k = leg - 1
    shortest = IntervalArray.around(campaign.length[:, k], campaign.length_radius[:, k]).lo
    net.add(equation.offset + shortest >= error)
    return net


@dataclass(frozen=True, eq=False)
class LegEquation:
    """`body` is g (N,), times `scale` (N,) if there is one, over the parameters, the only variables of `network`."""

    network: ConstraintNetwork
    body: Expr
    offset: Expr
    scale: Expr | None


def leg_equation(
    campaign: Campaign, leg: int, box: Box, *, engine: Arithmetic, model: LegModel = PLAIN, stated: bool = False
) -> LegEquation:
    """The equation of a leg, without a tolerance yet.

    Exact readings in a user-defined model: all is multiplied by `scale` = |q|^2, so that a certificate can
    state it in dyadic numbers. `stated`: rotations and scale are then rational expressions of the quaternions, exactly;
    otherwise enclosures, which is the same constraint in less time.
    """
    k, net = leg - 1, ConstraintNetwork()
    a = net.variable("a", 3, (box.lo[:3], box.hi[:3]))
    b = net.variable("b", 3, (box.lo[3:6], box.hi[3:6]))
    offset = net.variable("l", (), (box.lo[6], box.hi[6]))
    extra = {p.name: net.variable(p.name, (), (box.lo[i], box.hi[i])) for i, p in enumerate(model.extra, start=7)}
    position = net.reading(campaign.position, campaign.position_radius)
    length = net.reading(campaign.length[:, k], campaign.length_radius[:, k])
    scale: Expr | None = None
    scaled = not built_in(model) and exactly_read(campaign, leg)
    if scaled and stated:
        matrix, scale = _rational_rotation(campaign.quaternion)
    else:
        matrix = net.constant(rotation_enclosure(campaign.quaternion, engine))
        if scaled:
            scale = net.constant(_squared_norm(campaign.quaternion, engine))
    turn = _turning(net, campaign.rotation_radius)

    def rotate(u: npt.ArrayLike) -> Expr:
        return turn(matrix @ as_expr(np.asarray(u, np.float64)))

    measured = Measured(position, length, position + turn(matrix @ b) - a, rotate, drawn(campaign, leg))
    body = model.equation(measured, offset, extra)
    return LegEquation(net, body if scale is None else scale * body, offset, scale)


def drawn(campaign: Campaign, leg: int) -> Drawn:
    """The leg with that number (from 1) as the drawing has it at the stated readings."""
    robot, k = campaign.robot, leg - 1
    vector = leg_vectors(robot, Pose(campaign.position, campaign.quaternion))[:, k]
    return Drawn(vector, campaign.length[:, k], float(robot.offset[k]), vertical(campaign))


def exactly_read(campaign: Campaign, leg: int) -> bool:
    """Whether every reading set of the leg is a single point."""
    radii = (campaign.position_radius, campaign.rotation_radius, campaign.length_radius[:, leg - 1])
    return not any(r.any() for r in radii)


def _turning(net: ConstraintNetwork, radius: Floats) -> Callable[[Expr], Expr]:
    """v -> `R(1, s) v` for the readings s with `|2 s_i| <= radius_i`: v + 2 (s x v + s x (s x v)) / (1 + s.s)."""
    if not radius.any():
        return lambda v: v
    s = net.reading(np.zeros_like(radius), 0.5 * radius)

    def turned(v: Expr) -> Expr:
        once = _cross(s, v)
        return v + 2.0 * (once + _cross(s, once)) / (1.0 + sqr(s).sum(-1))[:, None]

    return turned


def _cross(x: Expr, y: Expr) -> Expr:
    """Cross product of rows, shape (N, 3)."""
    forth, back = [1, 2, 0], [2, 0, 1]
    return x[:, forth] * y[:, back] - x[:, back] * y[:, forth]


def _rational_rotation(quaternion: Floats) -> tuple[Expr, Expr]:
    """The matrices R(q) (N, 3, 3) of quaternions (N, 4), scalar first, as exact expressions, and |q|^2 (N,)."""
    q = as_expr(quaternion)
    products = (q[:, :, None] * q[:, None, :])[:, *np.divmod(np.arange(16), 4)]
    scale = sqr(q).sum(-1)
    numerators = (products @ as_expr(_numerators()))[:, np.arange(9).reshape(3, 3)]
    return numerators / scale[:, None, None], scale


def _numerators() -> Floats:
    """What multiplies q_i q_j (row 4 i + j) in the nine entries of |q|^2 R(q)."""
    out = np.zeros((4, 4, 3, 3))
    for i in range(3):
        out[0, 0, i, i] = 1.0
        for k in range(3):
            out[k + 1, k + 1, i, i] = 1.0 if k == i else -1.0
            if k != i:
                out[i + 1, k + 1, i, k] = 2.0
                out[0, 4 - i - k, i, k] = 2.0 if (k - i) % 3 == 2 else -2.0
    return out.reshape(16, 9)


def _squared_norm(quaternion: Floats, engine: Arithmetic) -> IntervalArray:
    """Enclosure (N,) of |q|^2."""
    square = [engine.sqr(IntervalArray.point(quaternion[:, k])) for k in range(4)]
    return engine.add(engine.add(square[0], square[1]), engine.add(square[2], square[3]))


def rotation_enclosure(quaternion: Floats, engine: Arithmetic) -> IntervalArray:
    """Enclosure (N, 3, 3) of the rational matrices of quaternions (N, 4), scalar first, divided by |q|^2."""
    if engine.name == "float64":
        return IntervalArray(*enclosed_rotations(np.array(quaternion, np.float64, order="C")))
    q = [IntervalArray.point(quaternion[:, k]) for k in range(4)]
    rows, norm_squared = rotation_numerators(q, engine)
    entries = [engine.div(entry, norm_squared) for row in rows for entry in row]
    shape = (len(quaternion), 3, 3)
    return IntervalArray(
        np.stack([x.lo for x in entries], axis=1).reshape(shape),
        np.stack([x.hi for x in entries], axis=1).reshape(shape),
    )


def beyond_legs(campaign: Campaign, leg: int, offset: float, error: float, what: str) -> list[Problem]:
    """Whether an `error` (mm) is as large as the leg is long at some reading, with the `offset` l; `what` it is called.

    The model takes legs to be longer than the error: at such a one nothing is left of what is asked about.
    """
    radius = campaign.length_radius[:, leg - 1]
    shortest = float(np.min(campaign.length[:, leg - 1] - radius)) + offset
    if 0.0 <= error < shortest or error == 0.0:
        return []
    said = f"{as_stated(error)} mm is no error of leg {leg}, which is {nearest(shortest, 1)} mm long at its shortest"
    return [Problem(what, said, "give one below the lengths of the legs")]


def residuals(campaign: Campaign, leg: int, parameters: npt.ArrayLike) -> Floats:
    """`g(x, M_k)` in mm of the plain model, shape (N,), at the centres of the reading sets; plain floating point."""
    x = np.asarray(parameters, np.float64)
    arm = rotation_matrix(campaign.quaternion) @ x[3:6]
    distance = np.linalg.norm(campaign.position + arm - x[:3], axis=1)
    return np.asarray(distance - campaign.length[:, leg - 1] - x[6])
