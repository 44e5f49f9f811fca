"""Runs of `cpcal handeye certify` checked again: by the checker, and what no proof can say beside.

The checker accepts what is proved. That the centre of the box is the least-squares answer is no matter of proof: that
answer is computed again here.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.checker import Refused, Unusable
from cpcal.checker.hand_eye import HAND_EYE_NAME, check_hand_eye
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.handeye.certify import AskedBox, HandEyeResult, load_hand_eye_result
from cpcal.handeye.classical_answer import classical_answer
from cpcal.handeye.files import load_study_json
from cpcal.handeye.study import HandEyeFrames, HandEyeStudy
from cpcal.handeye.wrong_images import WrongImages, load_wrong_images
from cpcal.robot import quaternion_from_matrix, rotation_vector

_APART = 1e-3  # of the deviations of a least-squares answer, or of the box: how far one computed again may be
_ROUNDING = np.tile([1e-9] * 3 + [1e-6] * 3, 2)  # rad and mm: the same where pixels fit without error


def verify_hand_eye(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """For each statement of the run in `folder`, with --wrong or without: whether it is accepted, and a sentence.

    Raises InputError where files cannot be read.
    """
    run = Path(folder)
    remedy = "run cpcal handeye certify again"
    try:
        study = load_study_json(run)
        found = load_hand_eye_result(run) if (run / HAND_EYE_NAME).is_file() else load_wrong_images(run)
        statements = check_hand_eye(run)
    except (Refused, Unusable) as reason:
        raise InputError([Problem(str(run), str(reason), remedy)]) from None
    return [*statements, _least_squares(study, found)]


def _least_squares(study: HandEyeStudy, found: HandEyeResult | WrongImages) -> tuple[bool, str]:
    """Whether the box's centre is the least-squares answer of the images that the point explains."""
    without = found.left_out if isinstance(found, WrongImages) else ()
    said = "centre: the least-squares answer" + (f" without {', '.join(without)}" if without else "")
    try:
        part = study.part(np.array([k for k, name in enumerate(study.images) if name not in without]))
        answer = classical_answer(part)
        near = _near(found.asked, answer.frames, np.sqrt(np.diagonal(answer.covariance)))
    except InputError as error:  # what a study must be for its answer to be computed again
        return False, f"centre: REFUSED, {error.problems[0]}"
    if not near:
        return False, "centre: REFUSED, it is not the least-squares answer"
    if isinstance(found, HandEyeResult):
        readings = found.classical.readings or [[0.0] * 6] * len(study.images)
        fits = [len(row) for row in readings] == [6] * len(study.images)
        if not fits or not (np.abs(np.array(readings) - answer.readings) <= _APART * study.pose_half_width).all():
            return False, "centre: REFUSED, the readings of the poses are not those of least squares"
    return True, said


def _near(asked: AskedBox, there: HandEyeFrames, deviations: Floats) -> bool:
    off = asked.center.frames
    apart = np.concatenate([
        rotation_vector(quaternion_from_matrix(off.e_rotation @ there.e_rotation.T)),
        off.e_translation - there.e_translation,
        rotation_vector(quaternion_from_matrix(off.f_rotation @ there.f_rotation.T)),
        off.f_translation - there.f_translation,
    ])  # fmt: skip
    room = np.minimum(deviations, np.tile(np.repeat([1.0, asked.reach], 3), 2))
    return bool((np.abs(apart) <= _APART * room + _ROUNDING).all())
