"""The range of each parameter of a leg at a tolerance: how well its measurements determine it, each side proved."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from cpcal.common.values import Floats
from cpcal.models import PARAMETERS, LegModel, model_jacobian
from cpcal.questions import LegResult, Options, Projection, Projections, Ranges
from cpcal.questions.bracket import PreparedLeg, by_bound
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, Repeat, SupportFunction, Verdict
from cpcal.solver.interval import Box

MARGIN = 1.1  # times eps_hi: at eps_hi itself hardly more than one point is left
PREFIX = "ranges-"  # of the certificates' names


def range_eps(options: Options, leg: LegResult) -> float | None:
    """The eps asked about; else the tolerance, if the leg reaches it; else eps_hi and a tenth. None where none does."""
    if options.eps is not None:
        return None if leg.bracket.verdict is Verdict.REFUTED else options.eps
    if leg.bracket.point is None or not math.isfinite(leg.bracket.hi):
        return None
    if options.tolerance is not None and leg.bracket.hi <= options.tolerance:
        return options.tolerance
    return MARGIN * leg.bracket.hi


def ranges_of(prepared: PreparedLeg, leg: LegResult) -> tuple[Ranges | None, bool]:
    """The ranges of a leg that has its bracket, and whether the user interrupted the search for them."""
    question = prepared.question
    eps = range_eps(question.options, leg)
    if eps is None:
        return None, False
    if question.options.eps is not None:  # they are what was asked
        of = leg.bracket
        return None if of.enclosure.is_empty else Ranges(eps, of.enclosure, of.certificate), False
    domain = prepared.at(eps)
    if domain.is_empty:
        return None, False
    options = replace(question.options, eps=eps, method="bound")
    asked = replace(question, options=options, prefix=PREFIX, checkpoints=None)
    start = np.append(leg.center if leg.bracket.point is None else leg.bracket.point, eps)
    answer = by_bound(prepared.asking(asked), start, lambda _: None, domain=domain, hull_only=True)
    box = answer.minimum.enclosure
    if box.is_empty or answer.minimum.interrupted:
        return None, answer.minimum.interrupted
    return Ranges(eps, type(box)(leg.bracket.enclosure.names, box.lo[:-1], box.hi[:-1]), answer.certificate), False


# ------------------------------------------------------------------------------------------------------------------
# How well a leg's parameters are determined, two at a time (the paper's Fig. 6): proved outer polygons.
#
# Of (a, b, l), in mm; a model's extra parameters take any value that fits. Each half-plane is a linear program over a
# relaxation of all parameters, proved from its multipliers by a
# contractor that has a `support_function`. The certificates do not hold these proofs.

Pair = tuple[int, int]

ARITHMETIC = "float64"  # rounded outward; arb would prove the same in a hundred times the time

_WITHIN = (*combinations(range(3), 2), *combinations(range(3, 6), 2))  # pairs of coordinates of one joint
_ACROSS = tuple(pair for pair in combinations(range(7), 2) if pair not in _WITHIN)
_ANGLES = np.arange(24) * (math.pi / 12)  # of the half-planes' normals, in a picture whose box is a square
_PASSES = 12  # of the contractor, at most
_SETTLED = 0.75  # another pass only while some width shrinks below this part of what it was
_DRAWN = (1e-9, 1e6)  # mm: a parameter known better, or worse, has no projection worth drawing


def projections_of(prepared: PreparedLeg, leg: LegResult) -> Projections | None:
    """Of all x within `question.options.delta` of the leg's center that satisfy its equations to within `range_eps`.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. None where there is no such tolerance or no x,
    where none of the contractors has a `support_function`, or where all is known too well, or too badly, to be
    drawn.
    """
    question = prepared.question
    eps = range_eps(question.options, leg)
    domain = None if eps is None else prepared.at(eps)
    contractor = next((c for c in _quick(prepared) if isinstance(c, SupportFunction)), None)
    if eps is None or domain is None or domain.is_empty or contractor is None:
        return None
    known = _known(prepared, leg, eps)
    box = Repeat(contractor, _SETTLED, _PASSES).contract(domain).box if known is None else known
    pairs = () if box.is_empty else tuple(_projections(question.campaign, leg.leg, question.model, contractor, box))
    return Projections(eps, Box(question.model.parameters, box.lo[:-1], box.hi[:-1]), pairs) if pairs else None


def _quick(prepared: PreparedLeg) -> Iterator[Contractor]:
    """The leg's contractors, in the arithmetic that is quick."""
    if prepared.question.options.arithmetic == ARITHMETIC:
        yield from (contractor for _, contractor in prepared.named)
        return
    for name, _ in prepared.named:
        yield plugins.load(name)(prepared.network, objective="eps", arithmetic=ARITHMETIC)


def _known(prepared: PreparedLeg, leg: LegResult, eps: float) -> Box | None:
    """The ranges of all parameters and eps, where they were found, in the leg's variables."""
    if leg.ranges is None or leg.ranges.eps != eps:
        return None
    box = leg.ranges.box
    return Box(prepared.domain.names, np.append(box.lo, eps), np.append(box.hi, eps))


def _projections(
    campaign: Campaign, leg: int, model: LegModel, contractor: SupportFunction, box: Box
) -> Iterator[Projection]:
    pairs = [*_WITHIN, _most_correlated(campaign, leg, model, box.mid[:-1])]
    drawn = (box.width > _DRAWN[0]) & (box.width < _DRAWN[1])
    pairs = [pair for pair in pairs if drawn[list(pair)].all()]
    directions = [_normals(box, pair) for pair in pairs]
    if not pairs:
        return
    bounds = contractor.support_function(box, np.concatenate(directions)).reshape(len(pairs), -1)
    if np.isneginf(bounds).any():
        return
    for pair, normals, highest in zip(pairs, directions, bounds, strict=True):
        planes = zip(normals[:, pair[0]].tolist(), normals[:, pair[1]].tolist(), highest.tolist(), strict=True)
        yield Projection((PARAMETERS[pair[0]], PARAMETERS[pair[1]]), tuple(p for p in planes if math.isfinite(p[2])))


def _normals(box: Box, pair: Pair) -> Floats:
    """Directions of the half-planes: all around, but for the axes, whose bounds the box has."""
    angles = _ANGLES[np.arange(len(_ANGLES)) % 6 != 0]
    out = np.zeros((len(angles), len(box)))
    out[:, pair[0]] = np.cos(angles) / box.width[pair[0]]
    out[:, pair[1]] = np.sin(angles) / box.width[pair[1]]
    return out


def _most_correlated(campaign: Campaign, leg: int, model: LegModel, x: Floats) -> Pair:
    """Of two parameters that are not of the same joint, those that the measurements tell apart worst.

    In floating point, from the linearised equations: it chooses what is drawn, not what is proved.
    """
    jacobian = model_jacobian(campaign, leg, x, model)
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = np.abs(covariance / np.outer(spread, spread))
    return max(_ACROSS, key=lambda pair: float(correlation[pair]))
