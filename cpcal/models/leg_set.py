"""The certified set S of one leg: all parameters that its measurements allow at the model error that is assumed.

With x = x^ + (alpha, beta, lambda), x^ the controller's parameters, the squared equation of a leg at a pose P, R

    ||P + R b - a||^2 - (L + l)^2       at the controller's own reading L = ||v|| - l^,  v = P + R b^ - a^

is LINEAR in z = (alpha, beta, lambda, w, C), where w = ||alpha||^2 + ||beta||^2 - lambda^2 and C_ij = alpha_i beta_j:

    2 v.(R beta - alpha) - 2 ||v|| lambda + w - 2 sum_ij R_ij C_ij

So its range over S is a support function of one set of z, the same for every pose, without a second-order remainder.
w and C join the leg's network as unknowns with equations of their own; a contractor with a `support_function` proves
the bounds, each from the multipliers of a linear program.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction as F
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker.certificate import Given, polynomial, with_forms
from cpcal.checker.platform import DIRECTION_BITS, Commanded, direction_form
from cpcal.common.errors import unusable
from cpcal.common.values import Floats, Places, floats
from cpcal.models import PLAIN, ModelResiduals, leg_box, leg_network, leg_statement, of_measurements
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import exact_box, free, leg_sides
from cpcal.solver.certificate.prover import WeightProver, write_steps
from cpcal.solver.contract import Repeat, SupportFunction, givers, shrunk
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, sqr
from cpcal.solver.network.expression import as_expr

SIZE = 17  # of z
_COLUMNS = np.r_[0:7, 8:18]  # of x, w and C in the network; eps stands between them
_PASSES = 12  # of the contractor, at most
_SETTLED = 0.75  # another pass only while some width shrinks below this part of what it was
_WIDE = 1e9  # mm^2: the first domain of w and C, which the contractor narrows


class CertifiedSet(NamedTuple):
    """Proved: z of every x in S lies in `box` (17,), and `basis.T @ z[:7]` in `along` (7,).

    S holds all x = (a, b, l) in a leg's box with |g(x, M_k)| <= `eps` mm for every measurement k, for SOME reading M_k
    in its set. `leg` counts from 1. `basis` (7, 7) is orthonormal up to rounding: directions by how well the
    measurements determine them. `ranges` gives the proved ranges (m,) of `directions @ z` over S, for (m, 17).
    """

    leg: int
    eps: float
    controller: Floats
    box: IntervalArray
    basis: Floats
    along: IntervalArray
    ranges: Callable[[Floats], IntervalArray]


class AskedSet(NamedTuple):
    """Which S is asked for: of a leg, at a model error, within `delta` mm of `center` (7,); `controller` (7,) is x^.

    `only`: some measurements, numbers from 0; None: all.
    """

    campaign: Campaign
    leg: int
    eps: float
    center: Sequence[float]
    delta: float
    controller: Floats
    contractors: Sequence[str] = ("lifted",)
    only: Places | None = None

    @property
    def basis(self) -> Floats:
        """(7, 7): directions by how well the measurements determine them, in floating point: any serve."""
        jacobian = ModelResiduals(self.campaign, self.leg, PLAIN).jacobian(self.controller)
        return np.linalg.svd(jacobian, full_matrices=True)[2].T

    def network(self) -> ConstraintNetwork:
        """The equations of the leg at `eps`."""
        box = leg_box(floats(self.center), self.delta)
        whole = leg_network(self.campaign, self.leg, box, eps=(self.eps, self.eps), model=PLAIN)
        return of_measurements(whole, self.only)


def certified_set(asked: AskedSet) -> CertifiedSet | None:
    """S; None when it is proved to be empty: the campaign refutes its `eps`.

    Raises InputError when none of the contractors has a support function.
    """
    controller = asked.controller
    network = asked.network()
    a, b, offset, _ = network.variables
    alpha, beta, rest = a - controller[:3], b - controller[3:6], offset - controller[6]
    w = network.variable("w", (), (-_WIDE, _WIDE))
    products = network.variable("C", (3, 3), (-_WIDE, _WIDE))
    network.add(w == sqr(alpha).sum() + sqr(beta).sum() - sqr(rest))
    network.add([products[i] == alpha[i] * beta for i in range(3)])
    loaded = (plugins.load(name)(network, objective=None) for name in asked.contractors)
    contractor: Any = next((one for one in loaded if isinstance(one, SupportFunction)), None)
    if contractor is None:
        what = f"none of {', '.join(asked.contractors)} has a support function"
        raise unusable("contractors", what, "certify with the contractor lifted")
    domain = Repeat(contractor, _SETTLED, _PASSES).contract(network.domain).box
    if domain.is_empty:
        return None

    def ranges(directions: Floats) -> IntervalArray:
        """From a set that is known in x, w and C: what x^ gives is taken off."""
        count = len(directions)
        both = np.zeros((2 * count, len(domain)))
        both[:count, _COLUMNS], both[count:, _COLUMNS] = directions, -directions
        highest = contractor.support_function(domain, both)
        known = IntervalArray.point(directions[:, :7]) @ controller[:, None]
        return IntervalArray(-highest[count:], highest[:count]) - known[:, 0]

    basis = asked.basis
    directions = np.zeros((7, SIZE))
    directions[:, :7] = basis.T
    along = ranges(directions)
    if (along.lo > along.hi).any():
        return None
    box = domain.array[_COLUMNS] - np.append(controller, np.zeros(SIZE - 7))
    return CertifiedSet(asked.leg, asked.eps, controller, box=box, basis=basis, along=along, ranges=ranges)


# ------------------------------------------------------------------------------------------------------------------
# What certificates hold of the set: a box of x, and ranges of forms in x, one for each pose that is commanded, and x
# along seven directions.

_FORMS = 64  # in one linear program
_LOSS = 0.002  # of a width, given away for shorter numbers


class EnclosedLeg(NamedTuple):
    """PROVED by its certificate: all x of the set lie from `lo` to `hi`, the form of each pose in its range, and x
    `along` each of the `directions` (7 of 7 numbers) in its."""

    lo: tuple[F, ...]
    hi: tuple[F, ...]
    forms: tuple[tuple[F, F], ...]
    directions: tuple[tuple[F, ...], ...]
    along: tuple[tuple[F, F], ...]


def enclosed_leg(asked: AskedSet, *, poses: Sequence[Commanded], certificate: Path) -> EnclosedLeg | None:
    """S, as its certificate encloses it, which is written; None when it is proved to be empty.

    Each pose has one form: by how much S lets the leg deviate from what the controller believes there. Raises
    InputError when none of the contractors gives weights.
    """
    known = tuple(map(F, asked.controller.tolist()))
    one = 2.0**DIRECTION_BITS
    directions = tuple(tuple(map(F, (np.rint(row * one) / one).tolist())) for row in asked.basis.T)
    forms = (*(pose.form(known) for pose in poses), *map(direction_form, directions))
    statement = leg_statement(asked.campaign, asked.leg, asked.only, forms=forms)
    plain = asked.network()
    root = with_forms(exact_box(plain.domain), [polynomial(form, free) for form in forms], free)
    names = (*plain.names, *(f"form {k}" for k in range(len(forms))))
    box = Box(names, [float(v) for v in root.lo], [float(v) for v in root.hi])
    steps = []

    def contracted(part: ConstraintNetwork, first: int, most: int) -> None:
        nonlocal box
        n, sides = len(plain.names), leg_sides(statement.problem, len(asked.campaign), asked.only, first=first)
        prover = WeightProver(statement._replace(sides=sides), _LOSS)
        own = np.r_[0:n, n + first : n + first + len(part.names) - n]
        loaded = [plugins.load(name)(part, objective=None) for name in asked.contractors]
        giving = [giver for contractor in loaded for giver in givers(contractor)]
        if not giving:
            what = f"none of {', '.join(asked.contractors)} gives weights"
            raise unusable("contractors", what, "certify with the contractor lifted")
        for _ in range(most):
            before = box
            for giver in giving:
                proposed = giver.contract(Box(part.names, box.lo[own], box.hi[own]))
                lo, hi = box.lo.copy(), box.hi.copy()
                lo[own], hi[own] = proposed.box.lo, proposed.box.hi
                name = {old: names[k] for old, k in zip(part.names, own, strict=True)}
                named = [s if s.variable is None else replace(s, variable=name[s.variable]) for s in proposed.steps]
                proof = prover(box, replace(proposed, box=box.with_bounds(lo, hi), steps=tuple(named)))
                box = proof.box
                if proof.record is not None:
                    steps.append(proof.record)
                if box.is_empty:
                    return
            if not shrunk(before.width[:n], box.width[:n], _SETTLED):
                return

    contracted(plain, 0, _PASSES)
    for first in range(0, len(forms), _FORMS):
        if not box.is_empty:
            part = asked.network()
            contracted(_with_forms(part, forms[first : first + _FORMS], box), first, 1)
    left = None if box.is_empty else exact_box(box)
    (header,) = statement.header(plain.domain)
    write_steps(certificate, header, left, steps, asked.eps)
    if left is None:
        return None
    ranges = tuple(zip(left.lo[8:], left.hi[8:], strict=True))
    return EnclosedLeg(left.lo[:7], left.hi[:7], ranges[: len(poses)], directions, ranges[len(poses) :])


def _with_forms(network: ConstraintNetwork, forms: Sequence[Given], box: Box) -> ConstraintNetwork:
    """With an unknown for each form; coefficients rounded, for nothing of it is trusted."""
    a, b, offset, _ = network.variables
    constant, linear, squares, products = (np.zeros((len(forms), *of)) for of in ((), (7,), (7,), (3, 3)))
    for k, form in enumerate(forms):
        for m, c in form:
            if not m:
                constant[k] = float(c)
            elif len(m) == 1:
                linear[k, m[0]] = float(c)
            elif m[0] == m[1]:
                squares[k, m[0]] = float(c)
            else:
                products[k, m[0], m[1] - 3] = float(c)
    value = network.variable("form", len(forms), (box.lo[-len(forms) :].min(), box.hi[-len(forms) :].max()))
    total = (
        constant + linear[:, :3] @ a + linear[:, 3:6] @ b + linear[:, 6] * offset + (as_expr(products) @ b * a).sum(-1)
    )
    total = total + squares[:, :3] @ sqr(a) + squares[:, 3:6] @ sqr(b) + squares[:, 6] * sqr(offset)
    network.add(total - value == 0.0)
    return network
