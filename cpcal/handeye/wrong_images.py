"""Some images may be wrong: a slipped board, a wrong robot pose. What is proved whichever at most q of them are.

Let q + 1 groups of images have no image in common. If q images are wrong, some group holds none of them. So

- eps_lo: when no frames explain any one of the groups to eps_lo, none explain all images but some q to it.
- an image k is wrong (at a tolerance) when no frames explain any one of q + 1 groups together with k to the tolerance:
  were k right, each of these groups would hold a wrong image, which makes q + 1.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cpcal.checker.hand_eye import WRONG_FORMAT, WRONG_NAME, errors, largest
from cpcal.checker.readers import up
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_most
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files.codec import INFORMED, checked, informed, load, save
from cpcal.handeye.certify import (
    LARGEST_ERROR,
    AskedBox,
    Reading,
    Within,
    best_frames,
    check_finite,
    check_inside,
    exact_readings,
    stated_readings,
)
from cpcal.handeye.classical_answer import classical_answer
from cpcal.handeye.minimax_fit import excess
from cpcal.handeye.model import PlacedFrames, Proof, Prover, exact_study
from cpcal.handeye.study import HandEyeFrames, HandEyeStudy, PixelModel, ReadingModel

_LEAST = 4  # images of a group
_TRIALS = 30  # of random images that the fit starts from
_BEYOND = 1.1  # of eps_hi: the tolerance at which images are called wrong, unless one is given
_SHARES = (0.999, 0.97, 0.9, 0.7)  # of the least error of the groups: what is tried to prove

Tell = Callable[[str], None]


@dataclass(frozen=True)
class RefutedGroup:
    """PROVED: no frames in the box explain these images to within the tolerance of what the group is for."""

    images: tuple[str, ...] = field(
        metadata=checked("no so many images as `outliers` meet all groups; the certificate speaks of no others")
    )
    certificate: str = field(
        metadata=checked("a file of the run, which is accepted, and so are those that it rests on")
    )


@dataclass(frozen=True)
class WrongImages:
    """When at most `outliers` images may be wrong.

    PROVED: whichever so many are left out, no frames in the box explain all others to within `eps_lo` px (`groups`);
    `point` explains all but `left_out` to within `eps_hi`, at the `readings` of uncertain poses. Each image of `blamed`
    is wrong if right ones fit to `tolerance`; the others of `left_out` may be right.
    The box is about the least-squares answer of all images but those left out. `asked_tolerance`: px, at which images
    were to be blamed. Raises ValueError for numbers that are not finite.
    """

    outliers: int = field(metadata=checked("so many are left out, and each claim has a group more"))
    asked: AskedBox
    eps_lo: float = field(metadata=checked("that of each of `groups`; 0 without these"))
    eps_hi: float = field(metadata=checked(LARGEST_ERROR))
    point: PlacedFrames = field(metadata=checked(LARGEST_ERROR))
    readings: tuple[Reading, ...] = field(metadata=checked(LARGEST_ERROR))
    left_out: tuple[str, ...] = field(metadata=checked("images of the study; all others are explained by the point"))
    groups: tuple[RefutedGroup, ...]
    blamed: tuple[tuple[str, tuple[RefutedGroup, ...]], ...] = field(
        metadata=checked("images left out, each once, and in all of its groups; these as `groups`, at `tolerance`")
    )
    tolerance: float | None = field(metadata=checked("that of the certificates of `blamed`; null without these"))
    version: str = field(metadata=INFORMED)
    asked_tolerance: float = field(metadata=informed("tolerance"))
    seconds: float = field(metadata=INFORMED)

    def __post_init__(self) -> None:
        check_finite(self)


def save_wrong_images(found: WrongImages, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye-wrong.json` into the folder; its path. Raises InputError."""
    return save(found, Path(folder) / WRONG_NAME, WRONG_FORMAT)


def load_wrong_images(folder: str | os.PathLike[str]) -> WrongImages:
    """Read `handeye-wrong.json` from the folder. Raises InputError."""
    return load(WrongImages, Path(folder) / WRONG_NAME, WRONG_FORMAT, remedy="run cpcal handeye certify again")


def find_wrong_images(
    study: HandEyeStudy,
    outliers: int,
    folder: Path,
    *,
    within: Within | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    tell: Tell = lambda text: None,
) -> WrongImages:
    """Bracket eps* of all but at most `outliers` images, and prove which ones are wrong; certificates go to `folder`.

    tolerance  px at which images are called wrong; default 1.1 times the upper end of the bracket

    Raises InputError for fewer than four images a group, and for studies without a classical answer.
    """
    began = time.monotonic()
    if not 0 < outliers <= len(study.images) // _LEAST - 2:
        most = max(len(study.images) // _LEAST - 2, 0)
        what = f"is {outliers} of {len(study.images)} images"
        remedy = f"these images do for at most {most}: each further one takes {_LEAST} images more"
        raise InputError([Problem("outliers", what, remedy)])
    left = trimmed_fit(study, outliers, np.random.default_rng(seed))
    good = [k for k in range(len(study.images)) if k not in left]
    part = study.part(np.array(good))
    classical = classical_answer(part)
    best = best_frames(part, classical)
    point, readings = PlacedFrames.of(best.frames), stated_readings(part, best.readings)
    worst = largest(errors(exact_study(part), point.numbers, exact_readings(readings)))
    assert worst is not None  # the fit keeps all points in front of the camera
    eps_hi = up(worst)
    tell(f"all but {', '.join(study.images[k] for k in left)} are explained to {at_most(eps_hi)} px")
    center = PlacedFrames.of(classical.frames)
    asked = (within or Within()).about(center)
    check_inside(asked, point)
    prover = _Groups(Prover(study, center.numbers, asked.reach, asked.angle, best.frames, tell), folder)
    eps_lo, groups = prover.lower(_parted(list(range(len(study.images))), outliers + 1))
    at = _BEYOND * eps_hi if tolerance is None else tolerance
    blamed = []
    for k in left:
        reasons = prover.refuted([[*group, k] for group in _parted(good, outliers + 1)], at)
        if reasons is not None:
            blamed.append((study.images[k], reasons))
    return WrongImages(
        outliers=outliers,
        asked=asked,
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        point=point,
        readings=readings,
        left_out=tuple(study.images[k] for k in left),
        groups=groups,
        blamed=tuple(blamed),
        tolerance=at if blamed else None,
        version=__version__,
        asked_tolerance=at,
        seconds=time.monotonic() - began,
    )


def _parted(images: list[int], count: int) -> list[list[int]]:
    """Groups of about the same size, interleaved."""
    return [images[k::count] for k in range(count)]


class _Groups:
    """Proofs about some of the images."""

    def __init__(self, prover: Prover, folder: Path) -> None:
        self.prover, self.study, self.folder, self.count = prover, prover.study, folder, 0

    def lower(self, groups: list[list[int]]) -> tuple[float, tuple[RefutedGroup, ...]]:
        """The largest tolerance tried at which every group is refuted."""
        least = min(self.fitted(group) for group in groups)
        for share in _SHARES:
            found = self.refuted(groups, share * least)
            if found is not None:
                return share * least, found
        return 0.0, ()

    def fitted(self, group: list[int]) -> float:
        """About the least error of a group: where a fit ends, px."""
        part = self.study.part(np.array(sorted(group)))
        best = best_frames(part, classical_answer(part))
        return excess(ReadingModel(part), best)

    def refuted(self, groups: list[list[int]], eps: float) -> tuple[RefutedGroup, ...] | None:
        """The proofs, written, that no frames explain any of the groups to within eps."""
        found: list[tuple[Proof, RefutedGroup]] = []
        for group in (sorted(group) for group in groups):
            if self.fitted(group) <= eps:
                return None
            self.prover.tell(f"{len(group)} images at {at_most(eps)} px")
            proof = self.prover.chain(f"wrong-{self.count + len(found) + 1}", eps, group)
            if not proof.refuted or proof.certificate is None:
                return None
            found.append((proof, RefutedGroup(tuple(self.study.images[k] for k in group), proof.certificate)))
        for proof, _ in found:
            proof.write(self.folder)
        self.count += len(found)
        return tuple(group for _, group in found)


def trimmed_fit(study: HandEyeStudy, outliers: int, random: np.random.Generator) -> list[int]:
    """The `outliers` images that least squares over all others fits worst, in the best of fits from random images.

    Each fit is repeated with the images that fit best, until they stay the same.
    """
    count = len(study.images)
    best: tuple[float, list[int]] | None = None
    for trial in range(_TRIALS):
        chosen = np.arange(count) if not trial else np.sort(random.choice(count, _LEAST, replace=False))
        for _ in range(10):
            try:
                frames = classical_answer(study.part(chosen)).frames
            except InputError:
                break
            squares = _by_image(study, frames)
            order = np.argsort(squares, kind="stable")
            kept = np.sort(order[: count - outliers])
            value = float(squares[kept].sum())
            if math.isfinite(value) and (best is None or value < best[0] * (1.0 - 1e-9)):
                best = value, sorted(order[count - outliers :].tolist())
            if np.array_equal(kept, chosen):
                break
            chosen = kept
    if best is None:
        raise InputError([Problem("study", "has no images that determine the frames", "check poses and points")])
    return best[1]


def _by_image(study: HandEyeStudy, frames: HandEyeFrames) -> Floats:
    """Mean square of the residuals of each image."""
    squares = (PixelModel(study)(frames) ** 2).reshape(2, -1).sum(axis=0)
    number = np.bincount(study.image, minlength=len(study.images))
    return np.asarray(np.bincount(study.image, weights=squares, minlength=len(study.images)) / np.maximum(number, 1))
