"""The answer to a hand-eye study, as plain values."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

from cpcal.files.codec import load, save
from cpcal.handeye.exact_errors import PlacedFrames, Reading
from cpcal.handeye.frames_chain import Chain

RESULT_FORMAT = "cpcal-handeye-result/2"
RESULT_NAME = "handeye.json"
LOWER, RANGES = "lower", "ranges"  # with which the names of certificates begin

PARAMETERS = tuple(f"{frame} {name}" for frame in ("camera", "target") for name in ("x", "y", "z", "rx", "ry", "rz"))


@dataclass(frozen=True)
class AskedBox:
    """The box of frames that everything speaks of.

    `center`: classical answer; positions within `reach` mm of it on each axis. `angle`: degrees from its rotations, or
    None for any rotation. `lo`, `hi` (24): of the unknowns, see `cpcal.handeye.frame_equations`.
    """

    center: PlacedFrames
    reach: float
    angle: float | None
    lo: tuple[float, ...]
    hi: tuple[float, ...]


@dataclass(frozen=True)
class FrameRanges:
    """PROVED: frames in the box that explain every pixel to within `eps` px have these parameters.

    In the order of PARAMETERS: positions in mm, and the rotation vector in degrees by which a frame is turned from that
    of the point (in base or hand coordinates); infinite where nothing is known. `lo`, `hi` (24): of the unknowns.
    `empty`: there are no such frames. `chain`: the certificates, which begin with the box that was asked for.
    """

    eps: float
    empty: bool
    low: tuple[float, ...]
    high: tuple[float, ...]
    lo: tuple[float, ...]
    hi: tuple[float, ...]
    chain: Chain


@dataclass(frozen=True)
class ImageVerdict:
    """The classical answer in one image: its largest excess in px, exactly, rounded up; `ok`: at most the tolerance.

    At the classical answer's reading of an uncertain pose: another reading may do better. `largest` is infinite where a
    point is not in front of the camera.
    """

    image: str
    largest: float
    ok: bool


@dataclass(frozen=True)
class Classical:
    """The least-squares answer, which proves nothing; `largest`: its largest excess, exactly, rounded up.

    `readings`: of the robot's poses, image by image, where these are uncertain.
    """

    placed: PlacedFrames
    readings: tuple[Reading, ...]
    rms: float
    largest: float
    sigma: tuple[float, ...]  # in the order of E and F of `ClassicalAnswer.covariance`
    images: tuple[ImageVerdict, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class HandEyeResult:
    """eps* lies in [eps_lo, eps_hi] px.

    PROVED: no frames in the box explain every pixel to within `eps_lo`, where that is above 0 (certificates `lower`,
    which begin with the box of the ranges, if that is not empty); `point` explains every one to within `eps_hi` (exact
    arithmetic), at the `readings` of uncertain poses, image by image. `support`: image and point of each pixel row with
    a weight in the last step of the proof. `gap`: relative, that was asked for.
    """

    version: str
    setup: str
    images: int
    points: int
    asked: AskedBox
    eps_lo: float
    eps_hi: float
    gap: float
    point: PlacedFrames
    readings: tuple[Reading, ...]
    support: tuple[tuple[str, str], ...]
    lower: Chain
    tolerance: float | None
    ranges: FrameRanges
    classical: Classical
    programs: int
    seconds: float

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
    return load(HandEyeResult, Path(folder) / RESULT_NAME, RESULT_FORMAT, remedy="run cpcal handeye again")


def unknown_range() -> tuple[float, ...]:
    """Of twelve parameters of which nothing is known."""
    return (math.inf,) * len(PARAMETERS)
