"""The page of a run of `cpcal handeye certify --wrong Q`."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.files import write_file
from cpcal.common.numbers import about, at_least, at_most, nearest
from cpcal.handeye.rows import above, exact_errors, largest
from cpcal.handeye.study import HandEyeStudy
from cpcal.handeye.words import frames_of, wrong_sentences
from cpcal.handeye.wrong_images import WrongImages
from cpcal.report.hand_eye_page import image_errors_svg
from cpcal.report.page import rendered, versions

WRONG_PAGE = "handeye-wrong.html"


def write_wrong_images(study: HandEyeStudy, found: WrongImages, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye-wrong.html` into the folder; its path. The same result gives the same bytes."""
    return write_file(Path(folder) / WRONG_PAGE, rendered("handeye-wrong.html.j2", _context(study, found)))


def _context(study: HandEyeStudy, found: WrongImages) -> dict[str, Any]:
    proved = dict(found.blamed)
    point = found.point
    camera, target = frames_of(study.setup)
    return {
        "images": len(study.images),
        "outliers": found.outliers,
        "sentences": wrong_sentences(found),
        "verdict": ("explained", "proved") if len(proved) == len(found.left_out) else ("undecided", "not all proved"),
        "tolerance": at_most(found.tolerance, 5),
        "errors": Markup(_errors(study, found)),  # made by us
        "blamed": [(image, [_listed(reason.images, image) for reason in why]) for image, why in found.blamed],
        "groups": [_listed(group.images, "") for group in found.groups],
        "eps_lo": at_least(found.eps_lo, 5),
        "frames": [
            (camera, _numbers(point.camera_position, 4), _numbers(point.camera_quaternion, 7)),
            (target, _numbers(point.target_position, 4), _numbers(point.target_quaternion, 7)),
        ],
        "seconds": about(found.seconds),
        "version": found.version,
        "versions": versions(),
    }


def _errors(study: HandEyeStudy, found: WrongImages) -> str:
    """Of the frames that explain all images but those left out, in every image; in these at the stated poses."""
    kept = [k for k, name in enumerate(study.images) if name not in found.left_out]
    readings: list[tuple[float, ...]] = []
    if found.readings:
        readings = [(0.0,) * 6] * len(study.images)
        for k, reading in zip(kept, found.readings, strict=True):
            readings[k] = reading
    errors = exact_errors(study, found.point, readings)
    drawn = []
    for k, name in enumerate(study.images):
        worst = largest([errors[n] for n in np.flatnonzero(study.image == k)])
        drawn.append((name, math.inf if worst is None else above(worst), k in kept))
    return image_errors_svg(drawn, found.eps_hi, found.tolerance, "Largest error of the best frames in each image")


def _listed(images: tuple[str, ...], without: str) -> str:
    return ", ".join(name for name in images if name != without)


def _numbers(values: tuple[float, ...], digits: int) -> str:
    return ", ".join(nearest(v, digits) for v in values)
