"""The certified answer to a hand-eye study: eps* between two bounds, ranges of the frames, least squares judged."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cpcal.checker import Refused, Unusable
from cpcal.checker.frames import holds
from cpcal.checker.hand_eye import (
    HAND_EYE_FORMAT,
    HAND_EYE_NAME,
    UNKNOWNS,
    WRONG_FORMAT,
    WRONG_NAME,
    Readings,
    check_hand_eye,
    errors,
    largest,
    parameter_ranges,
)
from cpcal.checker.readers import up
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_least, at_most
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files.codec import INFORMED, checked, informed, load, save
from cpcal.models.frames import PlacedFrames, Proof, Prover, exact, exact_study
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy, load_study_json
from cpcal.models.hand_eye_fit import (
    ClassicalAnswer,
    PixelModel,
    ReadFrames,
    classical_answer,
    excess,
    image_poses,
    minimax_fit,
)
from cpcal.robot import quaternion_from_matrix, rotation_vector

Reading = tuple[float, ...]  # of a pose: d in mm and w in rad, see `cpcal.models.hand_eye`

# ------------------------------------------------------------------------------------------------------------------
# The answer to a hand-eye study, as plain values.

_FILE = "a file of the run, which is accepted, and so are those that it rests on"
LARGEST_ERROR = (  # how `eps_hi`, the point and its readings are checked
    "the largest error at the point is computed again, exactly, and is `eps_hi`; the point in the box, readings within "
    "half-widths"
)

PARAMETERS = tuple(f"{frame} {name}" for frame in ("camera", "target") for name in ("x", "y", "z", "rx", "ry", "rz"))


REACH = 2000.0  # mm: the box around the classical positions
_ASKED = "the box of the certificates"


@dataclass(frozen=True)
class Within:
    """A box about frames: positions within `reach` mm on each axis, rotations within `angle` degrees (None: any).

    Raises InputError for a reach or an angle that is none.
    """

    reach: float = field(default=REACH, metadata=checked(_ASKED))
    angle: float | None = field(default=None, metadata=checked(_ASKED))

    def __post_init__(self) -> None:
        if not 0.0 < self.reach < 1e6 or (self.angle is not None and not 0.0 < self.angle <= 180.0):
            what = f"has an angle of {self.angle} degrees and a reach of {self.reach} mm"
            remedy = "give degrees up to 180 and mm above 0, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("the box", what, remedy)])

    @staticmethod
    def parsed(text: str) -> Within:
        """Of `DEGREES,MM`, or `any,MM`. Raises InputError."""
        try:
            angle, reach = (part.strip() for part in text.split(","))
            return Within(float(reach), None if angle == "any" else float(angle))
        except ValueError:
            remedy = "give degrees and mm, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("option --within", f"is {text!r:.60}", remedy)]) from None


@dataclass(frozen=True, kw_only=True)
class AskedBox(Within):
    """The box of frames that everything speaks of, about the least-squares answer."""

    center: PlacedFrames = field(
        metadata=checked(
            "least squares, computed again (of wrong images: without those left out): a thousandth of its deviations, "
            "or of the box, apart at most; and the box of the certificates"
        )
    )

    def holds(self, placed: PlacedFrames) -> bool:
        """Whether frames are in the box, exactly."""
        return holds(placed.numbers, self.center.numbers, F(self.reach), None if self.angle is None else F(self.angle))


@dataclass(frozen=True)
class FrameRanges:
    """PROVED: frames in the box that explain every pixel to within `eps` px have these parameters.

    In the order of PARAMETERS: positions in mm, and the rotation vector in degrees by which a frame is turned from that
    of the point (in base or hand coordinates); 180 either way where nothing is known. `lo`, `hi` (24): of the unknowns.
    Without numbers there are no such frames. `certificate`: the file that claims it.
    """

    eps: float = field(metadata=checked("`tolerance`, or 1.1 `eps_hi` without one; the certificates' constraints"))
    low: tuple[float, ...] = field(metadata=checked("computed again from `lo`, `hi` and `point`, exactly"))
    high: tuple[float, ...] = field(metadata=checked("computed again from `lo`, `hi` and `point`, exactly"))
    lo: tuple[float, ...] = field(metadata=checked("the claim of `ranges.certificate`"))
    hi: tuple[float, ...] = field(metadata=checked("the claim of `ranges.certificate`"))
    certificate: str = field(metadata=checked(_FILE))

    def __post_init__(self) -> None:
        sizes = len(self.low), len(self.high), len(self.lo), len(self.hi)
        if sizes not in ((0, 0, 0, 0), (len(PARAMETERS), len(PARAMETERS), UNKNOWNS, UNKNOWNS)):
            raise ValueError(f"ranges are not of {len(PARAMETERS)} parameters and {UNKNOWNS} unknowns")

    @property
    def empty(self) -> bool:
        return not self.lo


@dataclass(frozen=True)
class ImageVerdict:
    """The least-squares answer in one image: its largest excess in px, exactly, rounded up; `ok`: to the tolerance.

    At the answer's own reading of an uncertain pose: another reading may do better.
    """

    image: str = field(metadata=checked("the study"))
    largest: float = field(metadata=checked("computed again, exactly"))
    ok: bool = field(metadata=checked("computed again, exactly"))


@dataclass(frozen=True)
class Classical:
    """The least-squares answer, `asked.center`, judged; `largest`: its largest excess, exactly, rounded up.

    `readings`: of the robot's poses, image by image, where these are uncertain.
    """

    readings: tuple[Reading, ...] = field(
        metadata=checked("least squares, computed again: a thousandth of the half-widths apart at most, and in them")
    )
    largest: float = field(metadata=checked("computed again, exactly"))
    images: tuple[ImageVerdict, ...]


@dataclass(frozen=True)
class HandEyeResult:
    """eps* lies in [eps_lo, eps_hi] px.

    PROVED: no frames in the box explain every pixel to within `eps_lo`, where that is above 0 (the certificate
    `lower`); `point` explains every one to within `eps_hi` (exact arithmetic), at the `readings` of uncertain poses,
    image by image. `support`: image and point of each pixel row with a weight in the last step of the proof. Raises
    ValueError for numbers that are not finite.

    `gap`: relative, that was asked for. Of the least-squares answer `rms` (px per axis), `sigma` (in the order of E and
    F of `ClassicalAnswer.covariance`) and `remarks`. `programs`: linear ones that were solved. `timed`: the
    time limit ended a search.
    """

    setup: str = field(metadata=checked("the study"))
    images: int = field(metadata=checked("the study"))
    points: int = field(metadata=checked("the study"))
    asked: AskedBox
    eps_lo: float = field(metadata=checked("the certificate `lower`; 0 without it"))
    eps_hi: float = field(metadata=checked(LARGEST_ERROR))
    point: PlacedFrames = field(metadata=checked(LARGEST_ERROR))
    readings: tuple[Reading, ...] = field(metadata=checked(LARGEST_ERROR))
    support: tuple[tuple[str, str], ...] = field(metadata=checked("the last step of the certificate `lower`"))
    lower: str | None = field(metadata=checked(_FILE))
    tolerance: float | None = field(metadata=checked("`ranges.eps`"))
    ranges: FrameRanges
    classical: Classical
    version: str = field(metadata=INFORMED)
    gap: float = field(metadata=INFORMED)
    rms: float = field(metadata=INFORMED)
    sigma: tuple[float, ...] = field(metadata=INFORMED)
    remarks: tuple[str, ...] = field(metadata=INFORMED)
    programs: int = field(metadata=INFORMED)
    timed: bool = field(metadata=INFORMED)
    seconds: float = field(metadata=INFORMED)

    def __post_init__(self) -> None:
        check_finite(self)

    @property
    def complete(self) -> bool:
        """Whether the bracket is as narrow as asked."""
        return self.eps_hi - self.eps_lo <= self.gap * max(self.eps_hi, 1e-6)

    @property
    def passes(self) -> bool | None:
        """Whether some frames explain every pixel to the tolerance; None where that is open, or was not asked."""
        if self.tolerance is None:
            return None
        if self.eps_hi <= self.tolerance:
            return True
        refuted = self.ranges.empty and self.ranges.eps >= self.tolerance
        return False if refuted or self.eps_lo >= self.tolerance > 0.0 else None

    @property
    def uncertain(self) -> bool:
        """Whether the robot's poses have half-widths."""
        return bool(self.readings)


def save_hand_eye_result(found: HandEyeResult, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye.json` into the folder, all or nothing; its path. Raises InputError."""
    return save(found, Path(folder) / HAND_EYE_NAME, HAND_EYE_FORMAT)


def load_hand_eye_result(folder: str | os.PathLike[str]) -> HandEyeResult:
    """Read `handeye.json` from the folder. Raises InputError."""
    return load(HandEyeResult, Path(folder) / HAND_EYE_NAME, HAND_EYE_FORMAT, remedy="run cpcal handeye certify again")


def check_finite(value: object, where: str = "") -> None:
    """Raises ValueError for a dataclass or tuple with a float in it that is not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{where} is {value}")
    if isinstance(value, tuple):
        for part in value:
            check_finite(part, where)
    elif is_dataclass(value):
        for field in fields(value):
            check_finite(getattr(value, field.name), f"{where}.{field.name}" if where else field.name)


# ------------------------------------------------------------------------------------------------------------------
# The certified answer: eps* between two bounds, ranges of the parameters, verdicts of the classical answer.
#
# S(eps) = { (X, F) in the box : for every point a pixel within its half-width is met to within eps on both axes }
# eps*   = min { eps : S(eps) is not empty }

GAP = 1e-6
_BEYOND = 1.1  # of eps_hi: the tolerance of the ranges
LOWER, RANGES = "lower", "ranges"  # with which the names of certificates begin
_NOTHING = 1e-12  # px: what rounding leaves of pixels that fit exactly
_SHARES = (0.0, 1e-4, 1e-2, 0.1)  # below eps_hi: tolerances that are tried for the lower end
_NEAR = (0.0, 1e-6, 1e-4, 1e-2)  # the same below the least error of a single image
_BETWEEN = (0.95, 0.7, 0.4)  # of the way from there to eps_hi: what all images may refute

Tell = Callable[[str], None]


def certify_hand_eye(
    study: HandEyeStudy,
    *,
    within: Within | None = None,
    tolerance: float | None = None,
    gap: float = GAP,
    certificates: Path | None = None,
    time_limit: float = math.inf,
    tell: Tell = lambda text: None,
) -> HandEyeResult:
    """Bracket eps* of a study, and the ranges of its parameters.

    within        the box; default any rotation, positions within 2 m of the classical answer on each axis
    tolerance     px: are there frames that explain every pixel to it, and in which ranges? Default: ranges at 1.1 eps*
    gap           relative width of the bracket that is asked for
    certificates  a folder that exists, for `lower.cert.jsonl`, `ranges.cert.jsonl` and those that these rest on
    time_limit    seconds for each of the proofs; what is proved until then is stated

    Raises InputError for studies without a classical answer, and where its points lie outside of the box.
    """
    began = time.monotonic()
    if tolerance is not None and not 0.0 <= tolerance < math.inf:
        raise InputError([Problem("tolerance", f"is {tolerance}", "give pixels, from 0")])
    begun = _begun(study, within)
    asked, eps_hi = begun.asked, begun.eps_hi
    tell(f"some frames explain every pixel to {at_most(eps_hi, 7)} px")
    at = _BEYOND * eps_hi if tolerance is None else tolerance
    prover = Prover(study, asked.center.numbers, asked.reach, asked.angle, begun.best.frames, tell)
    wide = prover.chain(RANGES, at, range(len(study.images)), time.monotonic() + time_limit)
    eps_lo, lower = _lower_end(prover, wide, begun.best, eps_hi, gap, time_limit)
    proofs, classical = [wide] if lower is None else [wide, lower], begun.classical
    for proof in proofs:
        proof.write(certificates)
    return HandEyeResult(
        setup=study.setup,
        images=len(study.images),
        points=len(study.image),
        asked=asked,
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        point=begun.point,
        readings=begun.readings,
        support=_support(study, lower),
        lower=None if lower is None else lower.certificate,
        tolerance=tolerance,
        ranges=_ranges(wide, begun.point),
        classical=judged(study, asked.center, stated_readings(study, classical.readings), at),
        version=__version__,
        gap=gap,
        rms=classical.rms,
        sigma=tuple(np.sqrt(np.diagonal(classical.covariance)).tolist()),
        remarks=classical.remarks,
        programs=sum(proof.programs for proof in proofs),
        timed=any(proof.timed for proof in proofs),
        seconds=time.monotonic() - began,
    )


class _Begun(NamedTuple):
    """What fits: least squares and the box about it, the frames of the least largest error, and that error."""

    classical: ClassicalAnswer
    asked: AskedBox
    best: ReadFrames
    point: PlacedFrames
    readings: tuple[Reading, ...]
    eps_hi: float


def _begun(study: HandEyeStudy, within: Within | None) -> _Begun:
    """Raises InputError for studies without a classical answer, and for a box without the best frames."""
    classical, box = classical_answer(study), within or Within()
    asked, best = (
        AskedBox(box.reach, box.angle, center=PlacedFrames.of(classical.frames)),
        best_frames(study, classical),
    )
    point, readings = PlacedFrames.of(best.frames), stated_readings(study, best.readings)
    if not asked.holds(point):
        raise InputError([Problem("option --within", "leaves out the best frames found", "give a larger box")])
    worst = largest(errors(exact_study(study), point.numbers, exact_readings(readings)))
    assert worst is not None  # the fit keeps all points in front of the camera
    return _Begun(classical, asked, best, point, readings, up(worst))


def best_frames(study: HandEyeStudy, classical: ClassicalAnswer) -> ReadFrames:
    """The frames of the least largest error near the classical answer, and the readings of uncertain poses."""
    return minimax_fit(PixelModel(study), ReadFrames(classical.frames, classical.readings))[0]


def stated_readings(study: HandEyeStudy, values: Floats) -> tuple[Reading, ...]:
    """As a result states them; none of exact poses."""
    return tuple(map(tuple, values.tolist())) if study.uncertain else ()


def exact_readings(readings: Sequence[Reading]) -> Readings:
    return tuple(map(exact, readings))


# the lower end ------------------------------------------------------------------------------------------------------


def _lower_end(
    prover: Prover, wide: Proof, best: ReadFrames, eps_hi: float, gap: float, time_limit: float
) -> tuple[float, Proof | None]:
    """eps_lo and its proof, which begins with what `wide` leaves, or with the box that was asked for."""
    found = (wide.eps, wide) if wide.refuted else (0.0, None)
    if eps_hi <= _NOTHING:
        return found
    end, most = time.monotonic() + time_limit, eps_hi * (1.0 - 0.9 * gap)
    if prover.exact.uncertain:
        alone = least_errors(prover.study, best)
        k = max(alone, key=lambda k: alone[k])
        for eps in (min(most, alone[k]) * (1.0 - share) for share in _NEAR):
            if eps <= found[0] or time.monotonic() > end:
                break
            prover.tell(f"does {prover.study.images[k]} alone allow anything below {at_least(eps, 7)} px?")
            proof = prover.alone(LOWER, k, eps)
            if proof.refuted:
                found = eps, proof
                break
        tried = [found[0] + share * (most - found[0]) for share in _BETWEEN] if most > found[0] * 1.001 else []
    else:
        tried = [most * (1.0 - share) for share in _SHARES]
    for eps in tried:
        if eps <= found[0] or time.monotonic() > end:
            break
        prover.tell(f"is there anything below {at_least(eps, 7)} px?")
        if wide.refuted or eps > wide.eps:
            proof = prover.chain(LOWER, eps, range(len(prover.study.images)), end)
        else:
            proof = prover.lower(LOWER, wide, eps, end)
        if proof.refuted:
            return eps, proof
    return found


def least_errors(study: HandEyeStudy, best: ReadFrames) -> dict[int, float]:
    """By image, about the least error in px that its pixels allow with any pose of the target; found near `best`."""
    there, found = study.exactly(best.readings), {}
    for k in image_poses(study)[0]:
        model = PixelModel(there.part(np.array([k])))
        found[k] = minimax_fit(model, model.stated(best.frames), restarts=1)[1]
    return found


def _support(study: HandEyeStudy, lower: Proof | None) -> tuple[tuple[str, str], ...]:
    """Image and point of the pixel rows of the last step."""
    points = () if lower is None else dict.fromkeys(k for side, k in lower.last if side[0] in "uv")
    return tuple((study.images[study.image[k]], study.names[k]) for k in points)


# ranges and verdicts -----------------------------------------------------------------------------------------------


def _ranges(wide: Proof, point: PlacedFrames) -> FrameRanges:
    file = wide.certificate or ""
    if wide.left is None:
        return FrameRanges(wide.eps, (), (), (), (), file)
    lo, hi = (tuple(map(float, side[:UNKNOWNS])) for side in (wide.left.lo, wide.left.hi))
    low, high = map(tuple, parameter_ranges(exact(lo), exact(hi), point.numbers))
    return FrameRanges(wide.eps, low, high, lo, hi, file)


def judged(study: HandEyeStudy, placed: PlacedFrames, readings: tuple[Reading, ...], tolerance: float) -> Classical:
    """Frames, exactly, image by image. Raises InputError where they put a point behind the camera."""
    excess = errors(exact_study(study), placed.numbers, exact_readings(readings))
    verdicts = []
    for k, name in enumerate(study.images):
        worst = largest(excess[n] for n in np.flatnonzero(study.image == k))
        if worst is None:
            what = f"puts points of {name} behind the camera"
            raise InputError([Problem("the least-squares answer", what, "check the setup, and the poses")])
        verdicts.append(ImageVerdict(name, up(worst), worst <= F(tolerance)))
    return Classical(readings, max((verdict.largest for verdict in verdicts), default=0.0), tuple(verdicts))


# ------------------------------------------------------------------------------------------------------------------
# Some images may be wrong: a slipped board, a wrong robot pose. What is proved whichever at most q of them are.
#
# Let q + 1 groups of images have no image in common. If q images are wrong, some group holds none of them. So
#
# - eps_lo: when no frames explain any one of the groups to eps_lo, none explain all images but some q to it.
# - an image k is wrong (at a tolerance) when no frames explain any one of q + 1 groups together with k to the
# tolerance:
#   were k right, each of these groups would hold a wrong image, which makes q + 1.

_LEAST = 4  # images of a group
_TRIALS = 30  # of random images that the fit starts from
_GROUP_SHARES = (0.999, 0.97, 0.9, 0.7)  # of the least error of the groups: what is tried to prove


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
    begun = _begun(study.part(np.array(good)), within)
    asked, eps_hi = begun.asked, begun.eps_hi
    tell(f"all but {', '.join(study.images[k] for k in left)} are explained to {at_most(eps_hi)} px")
    proving = Prover(study, asked.center.numbers, asked.reach, asked.angle, begun.best.frames, tell)
    prover = _Groups(proving, folder)
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
        point=begun.point,
        readings=begun.readings,
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
        for share in _GROUP_SHARES:
            found = self.refuted(groups, share * least)
            if found is not None:
                return share * least, found
        return 0.0, ()

    def fitted(self, group: list[int]) -> float:
        """About the least error of a group: where a fit ends, px."""
        part = self.study.part(np.array(sorted(group)))
        best = best_frames(part, classical_answer(part))
        return excess(PixelModel(part), best)

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
    model = PixelModel(study)
    squares = (model(model.stated(frames)) ** 2).reshape(2, -1).sum(axis=0)
    number = np.bincount(study.image, minlength=len(study.images))
    return np.asarray(np.bincount(study.image, weights=squares, minlength=len(study.images)) / np.maximum(number, 1))


# ------------------------------------------------------------------------------------------------------------------
# Runs of `cpcal handeye certify` checked again: by the checker, and what no proof can say beside.
#
# The checker accepts what is proved. That the centre of the box is the least-squares answer is no matter of proof: that
# answer is computed again here.

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
