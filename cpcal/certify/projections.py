"""How well a leg's parameters are determined, two at a time (the paper's Fig. 6): proved outer polygons.

Of (a, b, l), in mm; a model's extra parameters take any value that fits. Each half-plane is a linear program over a
relaxation of all parameters, proved from its multipliers by a
contractor that has a `support_function`. The certificates do not hold these proofs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np

from cpcal.certify.certified_ranges import range_eps
from cpcal.certify.leg_tasks import HERE, answers
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.certify.question import Question
from cpcal.common.arrays import Floats
from cpcal.execution.executors import Place
from cpcal.legs import PARAMETERS, LegModel, model_jacobian
from cpcal.results import LegResult, Projection, Projections, Result, model_of
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, Repeat, SupportFunction
from cpcal.solver.interval import Box

Pair = tuple[int, int]

ARITHMETIC = "float64"  # rounded outward; arb would prove the same in a hundred times the time

_WITHIN = (*combinations(range(3), 2), *combinations(range(3, 6), 2))  # pairs of coordinates of one joint
_ACROSS = tuple(pair for pair in combinations(range(7), 2) if pair not in _WITHIN)
_ANGLES = np.arange(24) * (math.pi / 12)  # of the half-planes' normals, in a picture whose box is a square
_PASSES = 12  # of the contractor, at most
_SETTLED = 0.75  # another pass only while some width shrinks below this part of what it was
_DRAWN = (1e-9, 1e6)  # mm: a parameter known better, or worse, has no projection worth drawing


def with_projections(campaign: Campaign, result: Result, model: LegModel | None = None, place: Place = HERE) -> Result:
    """The result with `projections` for every leg that has a tolerance to draw them at; Ctrl-C ends it early.

    `model`: the leg model, where no installed package provides it. `place`: where the work is done. Raises InputError
    without the model.
    """
    if result.interrupted:
        return result
    question = Question(campaign=campaign, options=result.options, model=model_of(result, model))
    drawn: dict[int, Projections | None] = {}
    with suppress(KeyboardInterrupt):
        for answer in answers(question, projections, result.legs, place):
            drawn[answer.asked.leg] = answer.found
    legs = tuple(replace(leg, projections=drawn.get(leg.leg, leg.projections)) for leg in result.legs)
    return replace(result, legs=legs, interrupted=len(drawn) < len(legs))


def projections(question: Question, leg: LegResult) -> Projections | None:
    """Those of a leg that has its bracket: see `projections_of`."""
    if range_eps(question.options, leg) is None:
        return None
    return projections_of(PreparedLeg.of(question, leg.leg, np.array(leg.center)), leg)


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
