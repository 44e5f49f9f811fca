"""Certified hand-eye calibration of KinHEC's generated sequences, beside their truth.

    python -m benchmarks.certified_kinhec [--tier medium] [--sequences 2] [--images 30] [--within any,2000]

KinHEC has pairs of poses and no pixels: nine points of a square of 100 mm stand in, seen by a camera of 1000 px focal
length. Printed are the error of least squares on these pixels, the bracket of eps*, the widest ranges of KinHEC's X at
1.1 eps*, and whether the truth lies in them: it need not, for nothing says that its largest error is that small.
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
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.pose_pairs_study import study_of_pairs
from cpcal.robot import inverse


def study_of(sequence: Sequence, images: int) -> HandEyeStudy:
    """Key frames, evenly thinned out."""
    every = sequence.key_frames()
    chosen = np.unique(np.linspace(0, len(every.a) - 1, images).astype(int))
    hand, seen = in_mm(every.a[chosen]), in_mm(every.b[chosen])
    if sequence.eye_in_hand:
        return study_of_pairs(hand, inverse(seen), setup="eye-in-hand")
    return study_of_pairs(hand, seen, setup="eye-to-hand")


def true_unknowns(sequence: Sequence) -> tuple[slice, Floats]:
    """Where KinHEC's X stands among the unknowns, and its values."""
    values = np.concatenate([sequence.x[:3, :3].ravel(), 1000.0 * sequence.x[:3, 3]])
    return (slice(0, 12) if sequence.eye_in_hand else slice(12, 24)), values


def main() -> None:
    """Print a row a sequence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tier", default="medium")
    parser.add_argument("--sequences", type=int, default=2)
    parser.add_argument("--images", type=int, default=30)
    parser.add_argument("--within", default="any,2000")
    asked = parser.parse_args()
    for number, sequence in enumerate(noise_track(asked.tier, list(range(asked.sequences)))):
        study, began = study_of(sequence, asked.images), time.process_time()
        where, true = true_unknowns(sequence)
        fitted = unknowns_of(classical_answer(study).frames)[where]
        found = certify_hand_eye(study, within=Within.parsed(asked.within))
        lo, hi = np.array(found.ranges.lo)[where], np.array(found.ranges.hi)[where]
        ends = slice(0, 6) if sequence.eye_in_hand else slice(6, 12)
        width = (np.array(found.ranges.high) - np.array(found.ranges.low))[ends]
        print(
            f"sequence {number} ({study.setup}, {len(study.images)} images): least squares off "
            f"{np.linalg.norm(fitted[9:] - true[9:]):.3f} mm; eps* in [{found.eps_lo:.5f}, {found.eps_hi:.5f}] px; "
            f"ranges at 1.1 eps* up to {width[:3].max():.3f} mm, {width[3:].max():.4f} deg wide; "
            f"truth inside: {bool(((lo <= true) & (true <= hi)).all())}; {time.process_time() - began:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
