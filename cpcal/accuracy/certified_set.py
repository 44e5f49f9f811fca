"""The certified set S of one leg: all parameters that its measurements allow at the model error that is assumed.

With x = x^ + (alpha, beta, lambda), x^ the controller's parameters, the squared equation of a leg at a pose P, R

    ||P + R b - a||^2 - (L + l)^2       at the controller's own reading L = ||v|| - l^,  v = P + R b^ - a^

is LINEAR in z = (alpha, beta, lambda, w, C), where w = ||alpha||^2 + ||beta||^2 - lambda^2 and C_ij = alpha_i beta_j:

    2 v.(R beta - alpha) - 2 ||v|| lambda + w - 2 sum_ij R_ij C_ij

So its range over S is a support function of one set of z, the same for every pose, without a second-order remainder.
w and C join the leg's network as unknowns with equations of their own; a contractor with a `support_function` proves
the bounds, each from the multipliers of a linear program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.legs import PLAIN, ModelResiduals, leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, Repeat, SupportFunction
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, sqr

SIZE = 17  # of z
_COLUMNS = np.r_[0:7, 8:18]  # of x, w and C in the network; eps stands between them
_PASSES = 12  # of the contractor, at most
_SETTLED = 0.75  # another pass only while some width shrinks below this part of what it was
_WIDE = 1e9  # mm^2: the first domain of w and C, which the contractor narrows


@dataclass(frozen=True, eq=False)
class CertifiedSet:
    """Proved: z of every x in S lies in `box` (17,), and `basis.T @ z[:7]` in `along` (7,).

    S holds all x = (a, b, l) in a leg's box with |g(x, M_k)| <= `eps` mm for every measurement k, for SOME reading M_k
    in its set. `leg` counts from 1. `basis` (7, 7) is orthonormal up to rounding: directions by how well the
    measurements determine them.
    """

    leg: int
    eps: float
    controller: Floats
    box: IntervalArray
    basis: Floats
    along: IntervalArray
    support: _Support

    def ranges(self, directions: Floats) -> IntervalArray:
        """Proved ranges (m,) of `directions @ z` over S, for directions (m, 17)."""
        return self.support.ranges(directions)


@dataclass(frozen=True, eq=False)
class _Support:
    """Support functions in z of a set that is known in x, w and C."""

    contractor: SupportFunction
    domain: Box
    controller: Floats
    engine: Arithmetic

    def ranges(self, directions: Floats) -> IntervalArray:
        count = len(directions)
        asked = np.zeros((2 * count, len(self.domain)))
        asked[:count, _COLUMNS], asked[count:, _COLUMNS] = directions, -directions
        highest = self.contractor.support_function(self.domain, asked)
        # of x; what x^ gives is taken off
        known = self.engine.dot(IntervalArray.point(directions[:, :7]), IntervalArray.point(self.controller[:, None]))
        return self.engine.sub(IntervalArray(-highest[count:], highest[:count]), known[:, 0])


def certified_set(
    campaign: Campaign,
    leg: int,
    eps: float,
    *,
    center: Sequence[float],
    delta: float,
    controller: Floats,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
) -> CertifiedSet | None:
    """S of a leg within `delta` mm of `center` (7,); None when it is proved to be empty: the campaign refutes `eps`.

    `controller` (7,): x^. Raises InputError when none of the contractors has a support function.
    """
    engine = get_arithmetic(arithmetic)
    network = _network(campaign, leg, eps, leg_box(np.asarray(center, np.float64), delta), controller, engine)
    contractor, support_function = _supporting(network, contractors, arithmetic)
    domain = Repeat(contractor, _SETTLED, _PASSES).contract(network.domain).box
    if domain.is_empty:
        return None
    support = _Support(support_function, domain, controller, engine)
    # in floating point: it chooses directions, and any serve
    basis = np.linalg.svd(ModelResiduals(campaign, leg, PLAIN).jacobian(controller), full_matrices=True)[2].T
    directions = np.zeros((7, SIZE))
    directions[:, :7] = basis.T
    along = support.ranges(directions)
    if (along.lo > along.hi).any():
        return None
    box = engine.sub(domain.array[_COLUMNS], IntervalArray.point(np.append(controller, np.zeros(SIZE - 7))))
    return CertifiedSet(leg=leg, eps=eps, controller=controller, box=box, basis=basis, along=along, support=support)


def _network(
    campaign: Campaign, leg: int, eps: float, box: Box, controller: Floats, engine: Arithmetic
) -> ConstraintNetwork:
    """The leg's equations at `eps`, with the unknowns w and C of the module's text."""
    network = leg_network(campaign, leg, box, engine=engine, eps=(eps, eps), model=PLAIN)
    a, b, offset, _ = network.variables
    alpha, beta, rest = a - controller[:3], b - controller[3:6], offset - controller[6]
    w = network.variable("w", (), (-_WIDE, _WIDE))
    products = network.variable("C", (3, 3), (-_WIDE, _WIDE))
    network.add(w == sqr(alpha).sum() + sqr(beta).sum() - sqr(rest))
    network.add([products[i] == alpha[i] * beta for i in range(3)])
    return network


def _supporting(
    network: ConstraintNetwork, names: Sequence[str], arithmetic: str
) -> tuple[Contractor, SupportFunction]:
    """The same object, for what it does and for what it offers besides."""
    for name in names:
        contractor = plugins.load(name)(network, objective=None, arithmetic=arithmetic)
        if isinstance(contractor, SupportFunction):
            return contractor, contractor
    what = f"none of {', '.join(names)} has a support function"
    raise InputError([Problem("contractors", what, "certify with the contractor lifted")])
