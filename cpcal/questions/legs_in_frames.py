"""Legs that were certified in the frames of camera and target, in the frames of base and platform.

A campaign that `cpcal calibrate` makes of a robot's study is in the frames of camera and target. Its legs are

    | P + R b - a | = L + l        a: base joint in the camera frame, b: mobile joint in the target frame

so the bracket of eps* of a leg needs no frames, and stays what it is however little is known of them. What the frames
are for is the joints: X a in the base frame, and F b in the mobile frame. Both are bounded here over all frames that
the ranges of a hand-eye run hold, in exact arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F

from cpcal.checker.frames import R_F, R_X, T_F, T_X, Interval
from cpcal.common.errors import InputError, Problem
from cpcal.questions import Result
from cpcal.questions.hand_eye import HandEyeResult
from cpcal.solver.interval.numbers import round_down, round_up

JOINTS = ("base x", "base y", "base z", "mobile x", "mobile y", "mobile z")


@dataclass(frozen=True)
class LegInFrames:
    """PROVED by the two runs together: the leg's joints, mm, lie in [low, high] (6, in the order of JOINTS).

    For all frames in the hand-eye run's ranges, and all parameters in the leg's ranges at `eps` mm. `eps_lo`, `eps_hi`:
    of the leg, which no frame changes.
    """

    leg: int
    eps: float
    eps_lo: float
    eps_hi: float
    low: tuple[float, ...]
    high: tuple[float, ...]


def legs_in_frames(run: Result, frames: HandEyeResult) -> tuple[LegInFrames, ...]:
    """The legs of a run of `cpcal certify` with the frames of a run of `cpcal handeye certify`.

    Raises InputError where the camera is not beside the robot, or frames or a leg have no ranges.
    """
    problems = []
    if frames.setup != "eye-to-hand":
        what = f"are of a study {frames.setup}"
        problems.append(Problem("frames", what, "give one with the camera beside the robot"))
    if frames.ranges.empty:
        problems.append(Problem("frames", "have no ranges: nothing explains their pixels", "give a larger tolerance"))
    without = [leg.leg for leg in run.legs if leg.ranges is None]
    if without:
        problems.append(Problem("legs", f"{without} have no ranges", "certify again, with --tolerance"))
    if problems:
        raise InputError(problems)
    unknowns = [(F(a), F(b)) for a, b in zip(frames.ranges.lo, frames.ranges.hi, strict=True)]
    found = []
    for leg in run.legs:
        ranges = leg.ranges
        assert ranges is not None
        box = [(F(a), F(b)) for a, b in zip(ranges.box.lo.tolist(), ranges.box.hi.tolist(), strict=True)]
        ends = [*_moved(unknowns, R_X, T_X, box[:3]), *_moved(unknowns, R_F, T_F, box[3:6])]
        found.append(
            LegInFrames(
                leg=leg.leg,
                eps=ranges.eps,
                eps_lo=leg.bracket.lo,
                eps_hi=leg.bracket.hi,
                low=tuple(round_down(low) for low, _ in ends),
                high=tuple(round_up(high) for _, high in ends),
            )
        )
    return tuple(found)


def _moved(unknowns: list[Interval], turn: Sequence[int], shift: Sequence[int], at: list[Interval]) -> list[Interval]:
    """R x + t over boxes of R, t and x."""
    found = []
    for a in range(3):
        ends = [_product(unknowns[turn[3 * a + b]], at[b]) for b in range(3)] + [unknowns[shift[a]]]
        found.append((sum((low for low, _ in ends), F(0)), sum((high for _, high in ends), F(0))))
    return found


def _product(one: Interval, other: Interval) -> Interval:
    corners = [p * q for p in one for q in other]
    return min(corners), max(corners)
