"""What is proved of a study at one tolerance, from its pixels: a box of frames that is contracted, or found empty."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Indices
from cpcal.handeye.box_contraction import ConstraintRows, FramesProof, Tell, contracted
from cpcal.handeye.exact_rows import ExactRows, HandEyeStatement
from cpcal.handeye.frame_equations import EQUATIONS, R_F, R_X, pixel_rows, rotation_rows
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.quadratic_rows import Quadratics
from cpcal.solver.interval import Box

_NEGLIGIBLE = 0.01


def prove(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    *,
    about: str,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> FramesProof:
    """Contract a box of frames until it is empty or gets no smaller, at a tolerance of `eps` px; poses are exact."""
    statement = HandEyeStatement(ExactRows(study, eps), about)
    rows, places = frame_rows(study, eps)
    start, count = 2 * len(EQUATIONS), len(study.image)

    def negligible(box: Box) -> bool:
        """Whether products change a pixel by next to nothing beside the tolerance."""
        centred = rows.centred(box.mid, box.rad)
        constant = centred.constant[start:].reshape(2, 2, -1)
        room = -constant.sum(axis=1)  # 2 (eps + half-width) x_3 of each point and axis
        beside = np.abs(centred.products[start:]).sum(axis=1).reshape(2, 2, count).max(axis=1)
        return bool((beside <= _NEGLIGIBLE * room).all())

    asked = ConstraintRows(statement, rows, places, (*R_X, *R_F), negligible)
    return contracted(asked, eps, domain, time_limit=time_limit, tell=tell)


def frame_rows(study: HandEyeStudy, eps: float) -> tuple[Quadratics, Indices]:
    """ConstraintRows of the rotations and of all pixels, and constraint and part of each."""
    equations, pixels = len(EQUATIONS), 4 * len(study.image)
    both, own = np.tile(np.arange(equations), 2), equations + np.arange(pixels)
    part = np.repeat([0, 1, 0], [equations, equations, pixels])
    rows = Quadratics.joined([rotation_rows(), pixel_rows(study, eps)])
    return rows, np.stack([np.concatenate([both, own]), part], axis=1)
