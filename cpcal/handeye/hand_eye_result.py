"""The answer to a hand-eye study, as plain values."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, fields, is_dataclass
from fractions import Fraction as F
from pathlib import Path

from cpcal.common.errors import InputError, Problem
from cpcal.files.codec import load, save
from cpcal.handeye.exact_errors import PlacedFrames, Reading
from cpcal.handeye.frame_equations import SIZE, T_F, T_X, UNKNOWNS
from cpcal.handeye.frames_chain import Chain
from cpcal.solver.certificate.writer import rounded
from cpcal.solver.interval import Box

RESULT_FORMAT = "cpcal-handeye-result/3"
RESULT_NAME = "handeye.json"
LOWER, RANGES = "lower", "ranges"  # with which the names of certificates begin

PARAMETERS = tuple(f"{frame} {name}" for frame in ("camera", "target") for name in ("x", "y", "z", "rx", "ry", "rz"))


@dataclass(frozen=True)
class AskedBox:
    """The box of frames that everything speaks of.

    `center`: least-squares answer; positions within `reach` mm of it on each axis. `angle`: degrees from its rotations,
    or None for any rotation. Raises InputError for a reach or an angle that is none.
    """

    center: PlacedFrames
    reach: float
    angle: float | None

    def __post_init__(self) -> None:
        if not 0.0 < self.reach < 1e6 or (self.angle is not None and not 0.0 < self.angle <= 180.0):
            what = f"has an angle of {self.angle} degrees and a reach of {self.reach} mm"
            remedy = "give degrees up to 180 and mm above 0, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("the box", what, remedy)])

    @property
    def box(self) -> Box:
        """Of the unknowns, see `cpcal.handeye.frame_equations`; the same on every machine."""
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

    eps: float
    low: tuple[float, ...]
    high: tuple[float, ...]
    lo: tuple[float, ...]
    hi: tuple[float, ...]
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

    image: str
    largest: float
    ok: bool


@dataclass(frozen=True)
class Classical:
    """The least-squares answer, `asked.center`, judged; `largest`: its largest excess, exactly, rounded up.

    `readings`: of the robot's poses, image by image, where these are uncertain.
    """

    readings: tuple[Reading, ...]
    largest: float
    images: tuple[ImageVerdict, ...]


@dataclass(frozen=True)
class Information:
    """What nothing proves, and `cpcal verify` does not compare.

    `gap`: relative, that was asked for. Of the least-squares answer `rms` (px per axis), `sigma` (in the order of E and
    F of `ClassicalAnswer.covariance`) and `remarks`. `programs`: linear ones that were solved.
    """

    version: str
    gap: float
    rms: float
    sigma: tuple[float, ...]
    remarks: tuple[str, ...]
    programs: int
    seconds: float


@dataclass(frozen=True)
class HandEyeResult:
    """eps* lies in [eps_lo, eps_hi] px.

    PROVED: no frames in the box explain every pixel to within `eps_lo`, where that is above 0 (certificates `lower`,
    which begin with the box of the ranges, if that is not empty); `point` explains every one to within `eps_hi` (exact
    arithmetic), at the `readings` of uncertain poses, image by image. `support`: image and point of each pixel row with
    a weight in the last step of the proof. Raises ValueError for numbers that are not finite.
    """

    setup: str
    images: int
    points: int
    asked: AskedBox
    eps_lo: float
    eps_hi: float
    point: PlacedFrames
    readings: tuple[Reading, ...]
    support: tuple[tuple[str, str], ...]
    lower: Chain
    tolerance: float | None
    ranges: FrameRanges
    classical: Classical
    information: Information

    def __post_init__(self) -> None:
        check_finite(self)

    @property
    def complete(self) -> bool:
        """Whether the bracket is as narrow as asked."""
        return self.eps_hi - self.eps_lo <= self.information.gap * max(self.eps_hi, 1e-6)

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
    return load(HandEyeResult, Path(folder) / RESULT_NAME, RESULT_FORMAT, remedy="run cpcal handeye again")


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
