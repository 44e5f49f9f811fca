"""The range of each parameter of a leg at a tolerance: how well its measurements determine it, each side proved."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np

from cpcal.common.values import Floats
from cpcal.models import PARAMETERS, model_jacobian
from cpcal.questions.bracket import PreparedLeg, searched, the_enclosure
from cpcal.questions.result import LegResult, Options, Projection, Projections, Ranges
from cpcal.solver import plugins
from cpcal.solver.contract import SupportFunction, Verdict
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
    question, bracket = prepared.question, leg.bracket
    eps = range_eps(question.options, leg)
    if eps is None:
        return None, False
    if question.options.eps is not None:  # they are what was asked
        return None if bracket.enclosure.is_empty else Ranges(eps, bracket.enclosure, bracket.certificate), False
    domain = prepared.at(eps)
    if domain.is_empty:
        return None, False
    asked = replace(prepared, question=replace(question, prefix=PREFIX, checkpoints=None))
    start = np.append(leg.center if bracket.point is None else bracket.point, eps)
    found = searched(asked, the_enclosure, domain=domain, start=start)
    box = found.minimum.enclosure
    if box.is_empty or found.minimum.interrupted:
        return None, found.minimum.interrupted
    return Ranges(eps, Box(bracket.enclosure.names, box.lo[:-1], box.hi[:-1]), found.certificate), False


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
_DRAWN = (1e-9, 1e6)  # mm: a parameter known better, or worse, has no projection worth drawing


def projections_of(prepared: PreparedLeg, ranges: Ranges) -> Projections | None:
    """Of all parameters in the ranges of a leg that satisfy its equations to within the eps of the ranges.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. None where none of the contractors has a
    `support_function`, or where all is known too well, or too badly, to be drawn.
    """
    contractors = [contractor for _, contractor in prepared.named]
    if prepared.question.options.arithmetic != ARITHMETIC:
        network = prepared.problem.network
        contractors = [plugins.load(n)(network, objective="eps", arithmetic=ARITHMETIC) for n, _ in prepared.named]
    contractor = next((c for c in contractors if isinstance(c, SupportFunction)), None)
    if contractor is None:
        return None
    bounds = (np.append(side, ranges.eps) for side in (ranges.box.lo, ranges.box.hi))
    box = Box(prepared.domain.names, *bounds)
    drawn = (box.width > _DRAWN[0]) & (box.width < _DRAWN[1])
    pairs = [pair for pair in (*_WITHIN, _most_correlated(prepared, box.mid[:-1])) if drawn[list(pair)].all()]
    if not pairs:
        return None
    directions = [_normals(box, pair) for pair in pairs]
    highest = contractor.support_function(box, np.concatenate(directions)).reshape(len(pairs), -1)
    if np.isneginf(highest).any():
        return None
    found = []
    for (i, j), normals, ends in zip(pairs, directions, highest, strict=True):
        planes = zip(normals[:, i].tolist(), normals[:, j].tolist(), ends.tolist(), strict=True)
        found.append(Projection((PARAMETERS[i], PARAMETERS[j]), tuple(p for p in planes if math.isfinite(p[2]))))
    return Projections(ranges.eps, ranges.box, tuple(found))


def _normals(box: Box, pair: Pair) -> Floats:
    """Directions of the half-planes: all around, but for the axes, whose bounds the box has."""
    angles = _ANGLES[np.arange(len(_ANGLES)) % 6 != 0]
    out = np.zeros((len(angles), len(box)))
    out[:, pair[0]] = np.cos(angles) / box.width[pair[0]]
    out[:, pair[1]] = np.sin(angles) / box.width[pair[1]]
    return out


def _most_correlated(prepared: PreparedLeg, x: Floats) -> Pair:
    """Of two parameters that are not of the same joint, those that the measurements tell apart worst.

    In floating point, from the linearised equations: it chooses what is drawn, not what is proved.
    """
    jacobian = model_jacobian(prepared.question.campaign, prepared.leg, x, prepared.question.model)
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = np.abs(covariance / np.outer(spread, spread))
    return max(_ACROSS, key=lambda pair: float(correlation[pair]))
