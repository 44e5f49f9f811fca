"""From a box of the 24 unknowns to ranges of twelve parameters, in exact arithmetic and rounded outward."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_most
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files.codec import INFORMED, checked, load, save
from cpcal.handeye.chain import Chain, ChainProof, prove_chain
from cpcal.handeye.classical_answer import ClassicalAnswer, classical_answer
from cpcal.handeye.lower_end import lower_end, support
from cpcal.handeye.minimax_fit import minimax_fit
from cpcal.handeye.rows import (
    R_F,
    R_X,
    SIZE,
    T_F,
    T_X,
    UNKNOWNS,
    Matrix,
    PlacedFrames,
    Reading,
    above,
    exact_errors,
    exact_rotation,
    largest,
)
from cpcal.handeye.study import HandEyeStudy, PixelModel, ReadFrames, ReadingModel
from cpcal.solver.certificate.recording import rounded
from cpcal.solver.interval import Box

Interval = tuple[F, F]
_DEGREE_UP = F(math.nextafter(180.0, math.inf)) / F(math.nextafter(math.pi, 0.0))  # more than a radian has of them


def parameter_ranges(
    lo: Sequence[float], hi: Sequence[float], about: PlacedFrames
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Lower and upper ends (12): position in mm, turn in degrees from the frames `about`, of camera and target."""
    low: list[float] = []
    high: list[float] = []
    for turn, shift, quaternion in ((R_X, T_X, about.camera_quaternion), (R_F, T_F, about.target_quaternion)):
        low += [lo[i] for i in shift]
        high += [hi[i] for i in shift]
        box = [[(F(lo[turn[3 * a + b]]), F(hi[turn[3 * a + b]])) for b in range(3)] for a in range(3)]
        for ends in turns(box, exact_rotation(quaternion)):
            low.append(ends[0])
            high.append(ends[1])
    return tuple(low), tuple(high)


def turns(box: list[list[Interval]], center: Matrix) -> list[tuple[float, float]]:
    """Rotation vectors w, in degrees, of all rotations exp([w]) C in a box of matrices; +-180 beyond 60 degrees.

    M = R C^T lies in a box. Its skew part is sin(theta) times the axis, and ||M - I||^2 = 8 sin^2(theta / 2), so with
    k = sin(theta / 2) <= 1/2, w is the skew part times theta / sin(theta), which lies between 1 and
    1 / (1 - theta^2 / 6); theta <= 2 k / sqrt(1 - k^2).
    """
    product = [[_dot([box[a][j] for j in range(3)], center[b]) for b in range(3)] for a in range(3)]
    square = F(0)
    for a in range(3):
        for b in range(3):
            low, high = (end - (a == b) for end in product[a][b])
            square += max(low * low, high * high)
    k2 = square / 8
    if k2 > F(1, 4):
        return [(-180.0, 180.0)] * 3
    factor = 1 / (1 - 4 * k2 / (1 - k2) / 6)
    found = []
    for p, q in ((2, 1), (0, 2), (1, 0)):
        low = (product[p][q][0] - product[q][p][1]) / 2
        high = (product[p][q][1] - product[q][p][0]) / 2
        found.append((-_degrees(-low, factor), _degrees(high, factor)))
    return found


def _dot(row: list[Interval], numbers: list[F]) -> Interval:
    ends = [(low * c, high * c) if c >= 0 else (high * c, low * c) for (low, high), c in zip(row, numbers, strict=True)]
    return sum((end[0] for end in ends), F(0)), sum((end[1] for end in ends), F(0))


def _degrees(sine: F, factor: F) -> float:
    """An upper bound in degrees of a component, whose sine-weighted value is at most this."""
    value = sine * factor * _DEGREE_UP if sine >= 0 else sine
    # of a negative upper end the factor 1 is the safe one; degrees rounded towards zero
    if sine < 0:
        value = sine * F(math.nextafter(180.0, 0.0)) / F(math.nextafter(math.pi, math.inf))
    near = float(value)
    return near if F(near) >= value else math.nextafter(near, math.inf)


# ------------------------------------------------------------------------------------------------------------------
# The answer to a hand-eye study, as plain values.

RESULT_FORMAT = "cpcal-handeye-result/3"
RESULT_NAME = "handeye.json"
LARGEST_ERROR = (  # how `eps_hi`, the point and its readings are checked
    "the largest error at the point is computed again, exactly, and is `eps_hi`; the point in the box, readings within "
    "half-widths"
)
LOWER, RANGES = "lower", "ranges"  # with which the names of certificates begin

PARAMETERS = tuple(f"{frame} {name}" for frame in ("camera", "target") for name in ("x", "y", "z", "rx", "ry", "rz"))


@dataclass(frozen=True)
class AskedBox:
    """The box of frames that everything speaks of.

    `center`: least-squares answer; positions within `reach` mm of it on each axis. `angle`: degrees from its rotations,
    or None for any rotation. Raises InputError for a reach or an angle that is none.
    """

    center: PlacedFrames = field(
        metadata=checked(
            "least squares, computed again (of wrong images: without those left out): a thousandth of its deviations, "
            "or of the box, apart at most; and the box of the certificates"
        )
    )
    reach: float = field(metadata=checked("the box of the certificates"))
    angle: float | None = field(metadata=checked("the box of the certificates"))

    def __post_init__(self) -> None:
        if not 0.0 < self.reach < 1e6 or (self.angle is not None and not 0.0 < self.angle <= 180.0):
            what = f"has an angle of {self.angle} degrees and a reach of {self.reach} mm"
            remedy = "give degrees up to 180 and mm above 0, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("the box", what, remedy)])

    @property
    def box(self) -> Box:
        """Of the unknowns, see `cpcal.handeye.rows`; the same on every machine."""
        # entries of rotations that differ by an angle differ by at most 2 sin(angle / 2)
        span = F(2) if self.angle is None else 2 * _sine_above(F(self.angle) * _PI_ABOVE / 360)
        lo, hi = [], []
        for k, value in enumerate(self.center.unknowns):
            shift = k in T_X or k in T_F
            away = F(self.reach) if shift else span
            low, high = value - away, value + away
            lo.append(rounded(low if shift else max(low, F(-1)), True))
            hi.append(rounded(high if shift else min(high, F(1)), False))
        return Box(UNKNOWNS, lo, hi)

    def holds(self, placed: PlacedFrames) -> bool:
        """Whether frames are in the box, exactly."""
        box = self.box
        ends = zip(placed.unknowns, box.lo.tolist(), box.hi.tolist(), strict=True)
        return all(F(low) <= value <= F(high) for value, low, high in ends)


_PI_ABOVE = F(math.nextafter(math.pi, math.inf))


def _sine_above(angle: F) -> F:
    """An upper bound of the sine of an angle from 0: its series, which alternates, to x^17 / 17!."""
    term, total = angle, angle
    for k in range(1, 9):
        term *= -angle * angle / (2 * k * (2 * k + 1))
        total += term
    return min(total, F(1))


@dataclass(frozen=True)
class FrameRanges:
    """PROVED: frames in the box that explain every pixel to within `eps` px have these parameters.

    In the order of PARAMETERS: positions in mm, and the rotation vector in degrees by which a frame is turned from that
    of the point (in base or hand coordinates); 180 either way where nothing is known. `lo`, `hi` (24): of the unknowns.
    Without numbers there are no such frames. `chain`: the certificates, which begin with the box that was asked for.
    """

    eps: float = field(metadata=checked("`tolerance`, or 1.1 `eps_hi` without one; the certificates' constraints"))
    low: tuple[float, ...] = field(metadata=checked("computed again from `lo`, `hi` and `point`, exactly"))
    high: tuple[float, ...] = field(metadata=checked("computed again from `lo`, `hi` and `point`, exactly"))
    lo: tuple[float, ...] = field(metadata=checked("the claim of the last certificate of `ranges.chain`"))
    hi: tuple[float, ...] = field(metadata=checked("the claim of the last certificate of `ranges.chain`"))
    chain: Chain

    def __post_init__(self) -> None:
        sizes = len(self.low), len(self.high), len(self.lo), len(self.hi)
        if sizes not in ((0, 0, 0, 0), (len(PARAMETERS), len(PARAMETERS), SIZE, SIZE)):
            raise ValueError(f"ranges are not of {len(PARAMETERS)} parameters and {SIZE} unknowns")

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

    PROVED: no frames in the box explain every pixel to within `eps_lo`, where that is above 0 (certificates `lower`,
    which begin with the box of the ranges, if that is not empty); `point` explains every one to within `eps_hi` (exact
    arithmetic), at the `readings` of uncertain poses, image by image. `support`: image and point of each pixel row with
    a weight in the last step of the proof. Raises ValueError for numbers that are not finite.

    `gap`: relative, that was asked for. Of the least-squares answer `rms` (px per axis), `sigma` (in the order of E and
    F of `ClassicalAnswer.covariance`) and `remarks`. `programs`: linear ones that were solved.
    """

    setup: str = field(metadata=checked("the study"))
    images: int = field(metadata=checked("the study"))
    points: int = field(metadata=checked("the study"))
    asked: AskedBox
    eps_lo: float = field(metadata=checked("the constraints of the certificates of `lower`; 0 without these"))
    eps_hi: float = field(metadata=checked(LARGEST_ERROR))
    point: PlacedFrames = field(metadata=checked(LARGEST_ERROR))
    readings: tuple[Reading, ...] = field(metadata=checked(LARGEST_ERROR))
    support: tuple[tuple[str, str], ...] = field(metadata=checked("the last step of the certificates of `lower`"))
    lower: Chain
    tolerance: float | None = field(metadata=checked("`ranges.eps`"))
    ranges: FrameRanges
    classical: Classical
    version: str = field(metadata=INFORMED)
    gap: float = field(metadata=INFORMED)
    rms: float = field(metadata=INFORMED)
    sigma: tuple[float, ...] = field(metadata=INFORMED)
    remarks: tuple[str, ...] = field(metadata=INFORMED)
    programs: int = field(metadata=INFORMED)
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
    return save(found, Path(folder) / RESULT_NAME, RESULT_FORMAT)


def load_hand_eye_result(folder: str | os.PathLike[str]) -> HandEyeResult:
    """Read `handeye.json` from the folder. Raises InputError."""
    return load(HandEyeResult, Path(folder) / RESULT_NAME, RESULT_FORMAT, remedy="run cpcal handeye certify again")


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

REACH = 2000.0  # mm: the box around the classical positions
GAP = 1e-6
_BEYOND = 1.1  # of eps_hi: the tolerance of the ranges

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Within:
    """The box: positions within `reach` mm of the classical ones, rotations within `angle` degrees (None: any)."""

    reach: float = REACH
    angle: float | None = None

    @staticmethod
    def parsed(text: str) -> Within:
        """Of `DEGREES,MM`, or `any,MM`. Raises InputError."""
        parts = [part.strip() for part in text.split(",")]
        try:
            angle = None if parts[0] == "any" else float(parts[0])
            reach = float(parts[1]) if len(parts) == 2 else math.nan
        except ValueError:
            reach, angle = math.nan, None
        if not 0.0 < reach < 1e6 or (angle is not None and not 0.0 < angle <= 180.0):
            remedy = "give degrees and mm, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("option --within", f"is {text!r:.60}", remedy)])
        return Within(reach, angle)

    def about(self, center: PlacedFrames) -> AskedBox:
        """The box about the classical answer. Raises InputError for a reach or an angle that is none."""
        return AskedBox(center, self.reach, self.angle)


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
    certificates  a folder that exists, for `lower-1.cert.jsonl` and `ranges-1.cert.jsonl`, and so on
    time_limit    seconds for each of the proofs; what is proved until then is stated

    Raises InputError for studies without a classical answer, and where its points lie outside of the box.
    """
    began = time.monotonic()
    if tolerance is not None and not 0.0 <= tolerance < math.inf:
        raise InputError([Problem("tolerance", f"is {tolerance}", "give pixels, from 0")])
    classical = classical_answer(study)
    center = PlacedFrames.of(classical.frames)
    asked = (within or Within()).about(center)
    best = best_frames(study, classical)
    point, readings = PlacedFrames.of(best.frames), stated_readings(study, best.readings)
    worst = largest(exact_errors(study, point, readings))
    assert worst is not None  # the fit keeps all points in front of the camera
    eps_hi = above(worst)
    domain = asked.box
    check_inside(asked, point)
    tell(f"some frames explain every pixel to {at_most(eps_hi, 7)} px")
    at = ranges_tolerance(eps_hi, tolerance)
    about = about_study(study)
    wide = prove_chain(study, at, domain, center, about=about, time_limit=time_limit, tell=tell)
    eps_lo, lower = lower_end(study, wide, center, best, eps_hi, gap, about=about, time_limit=time_limit, tell=tell)
    return HandEyeResult(
        setup=study.setup,
        images=len(study.images),
        points=len(study.image),
        asked=asked,
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        point=point,
        readings=readings,
        support=support(study, lower),
        lower=Chain((), (), ()) if lower is None else lower.written(LOWER, certificates),
        tolerance=tolerance,
        ranges=_ranges(wide, point, wide.written(RANGES, certificates)),
        classical=judged(study, center, stated_readings(study, classical.readings), at),
        version=__version__,
        gap=gap,
        rms=classical.rms,
        sigma=tuple(np.sqrt(np.diagonal(classical.covariance)).tolist()),
        remarks=classical.remarks,
        programs=sum(proof.programs for proof in (wide, lower) if proof is not None),
        seconds=time.monotonic() - began,
    )


def ranges_tolerance(eps_hi: float, tolerance: float | None) -> float:
    """px: of the ranges, where a tolerance was asked for or none (None) was."""
    return _BEYOND * eps_hi if tolerance is None else tolerance


def best_frames(study: HandEyeStudy, classical: ClassicalAnswer) -> ReadFrames:
    """The frames of the least largest error near the classical answer, and the readings of uncertain poses."""
    if not study.pose_half_width.any():
        return ReadFrames.stated(minimax_fit(PixelModel(study), classical.frames)[0], study)
    return minimax_fit(ReadingModel(study), ReadFrames(classical.frames, classical.readings))[0]


def stated_readings(study: HandEyeStudy, values: Floats) -> tuple[Reading, ...]:
    """As a result states them; none of exact poses."""
    return tuple(map(tuple, values.tolist())) if study.pose_half_width.any() else ()


def check_inside(asked: AskedBox, point: PlacedFrames) -> None:
    """Raises InputError for frames outside of the box."""
    if not asked.holds(point):
        raise InputError([Problem("option --within", "leaves out the best frames found", "give a larger box")])


def about_study(study: HandEyeStudy) -> str:
    """What certificates say of themselves."""
    return (
        f"cpcal hand-eye, {study.setup}: X camera in {'hand' if study.setup == 'eye-in-hand' else 'base'}, "
        f"F target in {'base' if study.setup == 'eye-in-hand' else 'hand'}, mm"
    )


# ranges and verdicts -----------------------------------------------------------------------------------------------


def _ranges(wide: ChainProof, point: PlacedFrames, chain: Chain) -> FrameRanges:
    if wide.refuted:
        return FrameRanges(wide.eps, (), (), (), (), chain)
    lo, hi = tuple(wide.left.lo.tolist()), tuple(wide.left.hi.tolist())
    low, high = parameter_ranges(lo, hi, point)
    return FrameRanges(wide.eps, low, high, lo, hi, chain)


def judged(study: HandEyeStudy, placed: PlacedFrames, readings: tuple[Reading, ...], tolerance: float) -> Classical:
    """Frames, exactly, image by image. Raises InputError where they put a point behind the camera."""
    errors = exact_errors(study, placed, readings)
    verdicts = []
    for k, name in enumerate(study.images):
        worst = largest([errors[n] for n in np.flatnonzero(study.image == k)])
        if worst is None:
            what = f"puts points of {name} behind the camera"
            raise InputError([Problem("the least-squares answer", what, "check the setup, and the poses")])
        verdicts.append(ImageVerdict(name, above(worst), worst <= F(tolerance)))
    return Classical(readings, max((verdict.largest for verdict in verdicts), default=0.0), tuple(verdicts))
