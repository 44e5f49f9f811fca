"""Errors of the frames on KinHEC's generated sequences, next to those of KinHEC's own solvers.

    python -m benchmarks.hand_eye [--tier medium] [--sequences 120] [--seed 0]

Needs the package `kinhec` (extra `test`). Takes sequences of the tier's noise track at random, generates them (about
a second each) and prints the median over sequences of the error of KinHEC's X, in mm and degrees. Poses are used
as in KinHEC's protocol (key frames at least 5 degrees or 20 mm apart, at most 200) and all of them.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from kinhec import io, motions, plans, solvers
from kinhec.generator import generate_sequence

from cpcal.calibration import calibrate_frames
from cpcal.common.arrays import Floats
from cpcal.robot import Pose, inverse, quaternion_from_matrix


@dataclass(frozen=True)
class Sequence:
    """A_i X = Y B_i: measured poses A, B (N, 4, 4) in m, and the true X (4, 4)."""

    a: Floats
    b: Floats
    x: Floats
    eye_in_hand: bool

    def key_frames(self) -> Sequence:
        """KinHEC's choice of poses; all where there would be fewer than three."""
        kept = motions.select_keyframes(self.a, 5.0, 0.02, 200)
        return Sequence(self.a[kept], self.b[kept], self.x, self.eye_in_hand) if len(kept) >= 3 else self


def noise_track(tier: str, numbers: list[int] | None = None) -> Iterator[Sequence]:
    """Sequences of a tier's noise track: those with the given numbers, or all. Each follows from its own seed."""
    plan = plans.build_plan(plans.load_tier(tier), ["noise"])["noise"]
    for number in range(len(plan)) if numbers is None else numbers:
        record = generate_sequence(plan[number])
        sequence = io.Sequence(record.manifest, record.robot_table, record.camera_table)
        a, b = sequence.axyb_poses()
        yield Sequence(a, b, sequence.X, sequence.eye_in_hand)


def in_mm(transforms: Floats) -> Pose:
    """Matrices (N, 4, 4) in m as poses in mm."""
    return Pose(1000.0 * transforms[:, :3, 3], quaternion_from_matrix(transforms[:, :3, :3]))


def errors(sequence: Sequence, method: str, refine: bool) -> tuple[float, float]:
    """Of X: mm and degrees. A camera on the hand is the same problem with base and hand exchanged, A^-1 Y = X B^-1."""
    a, b = in_mm(sequence.a), in_mm(sequence.b)
    if sequence.eye_in_hand:
        found = calibrate_frames(inverse(a), inverse(b), method=method, refine=refine).camera_in_base
    else:
        found = calibrate_frames(a, b, method=method, refine=refine).target_in_mobile
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = found.rotation, found.position / 1000.0
    return compared(matrix, sequence)


def compared(x: Floats, sequence: Sequence) -> tuple[float, float]:
    """mm and degrees between an X (4, 4) in m and the true one."""
    turn = x[:3, :3].T @ sequence.x[:3, :3]
    angle = np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))
    return float(1000.0 * np.linalg.norm(x[:3, 3] - sequence.x[:3, 3])), float(np.degrees(angle))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tier", default="medium")
    parser.add_argument("--sequences", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    count = len(plans.build_plan(plans.load_tier(options.tier), ["noise"])["noise"])
    numbers = np.random.default_rng(options.seed).permutation(count)[: options.sequences].tolist()
    found = defaultdict(list)
    for every in noise_track(options.tier, numbers):
        for poses, sequence in (("key frames", every.key_frames()), ("all poses", every)):
            for method in ("shah", "andreff"):
                for refine in (False, True):
                    name = f"cpcal {method}{' refined' if refine else ''}, {poses}"
                    found[name].append(errors(sequence, method, refine))
        frames = every.key_frames()
        found["kinhec shah, key frames"].append(compared(solvers.shah(frames.a, frames.b)[0], every))
    print(f"{len(numbers)} of the {count} sequences of the noise track, tier {options.tier}: medians")
    for name, values in found.items():
        millimetres, degrees = np.median(values, axis=0)
        print(f"{name:34} {millimetres:7.3f} mm {degrees:7.4f} degrees")


if __name__ == "__main__":
    main()
