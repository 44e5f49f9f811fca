"""A run of `cpcal handeye-wrong` checked again, as `verify_hand_eye` does for one of `cpcal handeye`."""

from __future__ import annotations

import os
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.handeye.exact_errors import exact_errors, largest
from cpcal.handeye.frames_proof import box_of
from cpcal.handeye.hand_eye_files import load_hand_eye
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.verify_chain import NotAsStated, claimed
from cpcal.handeye.verify_hand_eye import check_box, check_readings, statements
from cpcal.handeye.wrong_images import RefutedGroup, WrongImages, load_wrong_images


def verify_wrong_images(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """For each statement of the run in `folder`: whether it is accepted, and a sentence. Raises InputError."""
    run = Path(folder)
    study, found = load_hand_eye(run), load_wrong_images(run)
    return statements((_box, _lower, _point, _blamed), run, study, found, verb="handeye-wrong")


def _box(run: Path, study: HandEyeStudy, found: WrongImages) -> str:
    return check_box(found.asked)


def _lower(run: Path, study: HandEyeStudy, found: WrongImages) -> str:
    if found.eps_lo <= 0.0:
        return "lower end: NOT CERTIFIED, eps >= 0"
    if len(found.groups) <= found.outliers:
        raise NotAsStated("there are not enough groups of images")
    _disjoint([group.images for group in found.groups])
    for group in found.groups:
        _refuted(run, study, found, group, found.eps_lo)
    return (
        f"lower end: PROVED, whichever {found.outliers} images are wrong, no frames explain all others to "
        f"{found.eps_lo!r} px ({len(found.groups)} groups)"
    )


def _point(run: Path, study: HandEyeStudy, found: WrongImages) -> str:
    if len(set(found.left_out)) > found.outliers or not set(found.left_out) <= set(study.images):
        raise NotAsStated("too many images are left out")
    kept = [k for k, name in enumerate(study.images) if name not in found.left_out]
    part = study.part(np.array(kept))
    check_readings(part, found.readings)
    worst = largest(exact_errors(part, found.point, found.readings))
    if worst is None or worst > F(found.eps_hi):
        raise NotAsStated("the point does not satisfy every pixel to eps_hi")
    return f"upper end: PROVED, all but {', '.join(found.left_out)} are explained to {found.eps_hi!r} px"


def _blamed(run: Path, study: HandEyeStudy, found: WrongImages) -> str:
    for image, reasons in found.blamed:
        if len(reasons) <= found.outliers or not all(image in reason.images for reason in reasons):
            raise NotAsStated(f"there are not enough reasons against {image}")
        _disjoint([tuple(name for name in reason.images if name != image) for reason in reasons])
        for reason in reasons:
            _refuted(run, study, found, reason, found.tolerance)
    named = ", ".join(image for image, _ in found.blamed) or "none"
    return f"wrong images: PROVED if at most {found.outliers} are, at {found.tolerance!r} px: {named}"


def _disjoint(groups: list[tuple[str, ...]]) -> None:
    """Raises NotAsStated for groups with an image in common."""
    if sum(map(len, groups)) > len(set().union(*groups)):
        raise NotAsStated("two groups have an image in common")


def _refuted(run: Path, study: HandEyeStudy, found: WrongImages, group: RefutedGroup, eps: float) -> None:
    """Raises NotAsStated, Refused, Unusable unless the certificates refute the group at eps."""
    strange = set(group.images) - set(study.images)
    if group.eps != eps or strange:
        raise NotAsStated("a group is of other images, or at another tolerance")
    part = study.part(np.array([study.images.index(name) for name in group.images]))
    box = box_of(found.asked.lo, found.asked.hi)
    if not claimed(run, group.chain, part, box, eps, found.asked.center).infeasible:
        raise NotAsStated("a certificate does not claim that there are no frames")
