"""Certified hand-eye calibration of KinHEC's generated sequences, beside their truth.

    python -m benchmarks.certified_kinhec [--tier medium] [--sequences 2] [--images 30] [--within any,2000] [--at-truth]

KinHEC has pairs of poses and no pixels: nine points of a square of 100 mm stand in, seen by a camera of 1000 px focal
length; key frames in which it would be less than 150 mm in front of the camera are left out. Printed are the error of
least squares on these pixels, the bracket of eps*, the largest error that KinHEC's true X leaves (with the best other
frame), the widest ranges of X at 1.1 eps*, or with `--at-truth` at the error of the truth, and whether the truth lies
in them: at 1.1 eps* it need not.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.hand_eye import Sequence, in_mm, noise_track
from cpcal.common.arrays import Floats
from cpcal.handeye.certify_hand_eye import Within, certify_hand_eye
from cpcal.handeye.classical_answer import classical_answer
from cpcal.handeye.frame_equations import unknowns_of
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy, Setup
from cpcal.handeye.minimax_fit import minimax_fit
from cpcal.handeye.pixel_model import PixelModel, moved
from cpcal.handeye.pose_pairs_study import study_of_pairs
from cpcal.robot import Pose, inverse

_NEAREST = 150.0  # mm


def study_of(sequence: Sequence, images: int) -> HandEyeStudy:
    """Key frames that see the stand-in, evenly thinned out."""
    every = sequence.key_frames()
    seen = in_mm(every.b)
    seen = inverse(seen) if sequence.eye_in_hand else seen
    front = np.flatnonzero(seen.position[:, 2] > _NEAREST)
    chosen = front[np.unique(np.linspace(0, len(front) - 1, images).astype(int))]
    setup: Setup = "eye-in-hand" if sequence.eye_in_hand else "eye-to-hand"
    return study_of_pairs(in_mm(every.a[chosen]), Pose(seen.position[chosen], seen.quaternion[chosen]), setup=setup)


def true_unknowns(sequence: Sequence) -> tuple[slice, Floats]:
    """Where KinHEC's X stands among the unknowns, and its values."""
    values = np.concatenate([sequence.x[:3, :3].ravel(), 1000.0 * sequence.x[:3, 3]])
    return (slice(0, 12) if sequence.eye_in_hand else slice(12, 24)), values


class _TrueX:
    """Residuals with X at its truth: only the other frame moves."""

    def __init__(self, study: HandEyeStudy, in_hand: bool) -> None:
        self.study, self.size = study, 6
        self._model, self._free = PixelModel(study), slice(6, 12) if in_hand else slice(0, 6)

    def __call__(self, at: HandEyeFrames) -> Floats:
        return self._model(at)

    def jacobian(self, at: HandEyeFrames) -> Floats:
        return self._model.jacobian(at)[:, self._free]

    def moved(self, at: HandEyeFrames, step: Floats) -> HandEyeFrames:
        whole = np.zeros(12)
        whole[self._free] = step
        return moved(at, whole)

    def reach(self, at: HandEyeFrames) -> Floats:
        return self._model.reach(at)[self._free]

    def room(self, at: HandEyeFrames) -> tuple[Floats, Floats]:
        return np.full(6, -np.inf), np.full(6, np.inf)


def error_of_truth(study: HandEyeStudy, fitted: HandEyeFrames, true: Floats, in_hand: bool) -> float:
    """px: the largest error with X (9 entries and 3 mm) at its truth."""
    turn, shift = true[:9].reshape(3, 3), true[9:]
    if in_hand:
        start = HandEyeFrames(turn.T, -turn.T @ shift, fitted.f_rotation, fitted.f_translation)
    else:
        start = HandEyeFrames(fitted.e_rotation, fitted.e_translation, turn, shift)
    return minimax_fit(_TrueX(study, in_hand), start)[1]


def main() -> None:
    """Print a row a sequence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tier", default="medium")
    parser.add_argument("--sequences", type=int, default=2)
    parser.add_argument("--images", type=int, default=30)
    parser.add_argument("--within", default="any,2000")
    parser.add_argument("--at-truth", action="store_true")
    asked = parser.parse_args()
    for number, sequence in enumerate(noise_track(asked.tier, list(range(asked.sequences)))):
        study, began = study_of(sequence, asked.images), time.process_time()
        where, true = true_unknowns(sequence)
        classical = classical_answer(study).frames
        fitted = unknowns_of(classical)[where]
        eps = 1.0001 * error_of_truth(study, classical, true, sequence.eye_in_hand)
        found = certify_hand_eye(study, within=Within.parsed(asked.within), tolerance=eps if asked.at_truth else None)
        lo, hi = np.array(found.ranges.lo)[where], np.array(found.ranges.hi)[where]
        ends = slice(0, 6) if sequence.eye_in_hand else slice(6, 12)
        width = (np.array(found.ranges.high) - np.array(found.ranges.low))[ends]
        print(
            f"sequence {number} ({study.setup}, {len(study.images)} images): least squares off "
            f"{np.linalg.norm(fitted[9:] - true[9:]):.3f} mm; eps* in [{found.eps_lo:.5f}, {found.eps_hi:.5f}] px; "
            f"true X leaves {eps:.4f} px; ranges at {found.ranges.eps:.4f} px up to "
            f"{width[:3].max():.3f} mm, {width[3:].max():.4f} deg wide; "
            f"truth inside: {bool(((lo <= true) & (true <= hi)).all())}; {time.process_time() - began:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
