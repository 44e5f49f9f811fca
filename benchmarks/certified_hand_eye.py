"""Certified hand-eye calibration of simulated studies: does the truth lie in the guaranteed ranges, and at which cost?

    python -m benchmarks.certified_hand_eye [--seeds 200] [--images 20] [--corners 8,6] [--within any,2000]
        [--setup both] [--pixel-error 0.2] [--position-error 0.1 --rotation-error 0.05] [--opencv]

Pixel errors are uniform in plus and minus `--pixel-error` on each axis, which is the tolerance; robot errors are
uniform too, and are stated as half-widths. `--setup both`: even seeds with the camera in the hand, odd ones with it
beside the robot. `--opencv`: only compare the answers of OpenCV's closed forms (OpenCV 4 with
calibrateHandEye), from poses of single images, with least squares and the best frames: distance of the camera to the
truth, and the largest error of a pixel.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.values import Floats
from cpcal.handeye.certify import Within, best_frames, certify_hand_eye, save_hand_eye_result
from cpcal.handeye.classical_answer import classical_answer, image_poses
from cpcal.handeye.files import hand_eye_files
from cpcal.handeye.rows import unknowns_of
from cpcal.handeye.study import (
    SETUPS,
    HandEyeFrames,
    HandEyeStudy,
    PixelModel,
    Setup,
    SimulatedHandEye,
    simulate_hand_eye,
)
from cpcal.handeye.verify import verify_hand_eye
from cpcal.vision.opencv import opencv

_METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")


def setup_of(seed: int, asked: argparse.Namespace) -> Setup:
    """Of a seed."""
    if asked.setup == "both":
        return SETUPS[seed % 2]
    return SETUPS[SETUPS.index(asked.setup)]


def simulated(seed: int, asked: argparse.Namespace) -> SimulatedHandEye:
    """A study with the errors asked for, the robot's stated as half-widths; the board is 240 mm wide."""
    columns, rows = (int(part) for part in asked.corners.split(","))
    angle = float(np.radians(asked.rotation_error))
    found = simulate_hand_eye(
        setup=setup_of(seed, asked),
        images=asked.images,
        corners=(columns, rows),
        pitch=240.0 / columns,
        pixel_error=asked.pixel_error,
        position_error=asked.position_error,
        rotation_error=angle,
        seed=seed,
    )
    wide = np.tile([asked.position_error] * 3 + [angle] * 3, (asked.images, 1))
    return SimulatedHandEye(replace(found.study, pose_half_width=wide), found.truth)


def certified(seed: int, asked: argparse.Namespace) -> dict[str, Any]:
    """One row."""
    case = simulated(seed, asked)
    with tempfile.TemporaryDirectory() as name:
        folder, began = Path(name), time.process_time()
        found = certify_hand_eye(
            case.study, within=Within.parsed(asked.within), tolerance=asked.pixel_error, certificates=folder
        )
        spent = time.process_time() - began
        for file, content in hand_eye_files(case.study).items():
            (folder / file).write_bytes(content)
        save_hand_eye_result(found, folder)
        began = time.process_time()
        accepted = all(good for good, _ in verify_hand_eye(folder))
        size = sum(path.stat().st_size for path in folder.glob("*.cert.jsonl"))
    x = unknowns_of(case.truth)
    inside = bool(((np.array(found.ranges.lo) <= x) & (x <= np.array(found.ranges.hi))).all())
    width = np.array(found.ranges.high) - np.array(found.ranges.low)
    return {
        "seed": seed,
        "inside": inside,
        "closed": found.complete,
        "accepted": accepted,
        "eps": f"{found.eps_lo:.7f}..{found.eps_hi:.7f}",
        "camera mm": float(width[:3].max()),
        "camera deg": float(width[3:6].max()),
        "seconds": spent,
        "verify": time.process_time() - began,
        "MB": size / 1e6,
    }


def closed_forms(study: HandEyeStudy) -> dict[str, HandEyeFrames]:
    """The answers of OpenCV, eye in hand, from the poses of single images; F is then the mean over the images."""
    cv2 = opencv()
    _, seen = image_poses(study)
    turn, shift = study.motions  # base in hand
    r_seen, t_seen = seen.rotation, seen.position
    back = np.swapaxes(turn, 1, 2)
    hand = back, -np.einsum("nij,nj->ni", back, shift)
    found = {}
    for method in _METHODS:
        x, t = cv2.calibrateHandEye(
            list(hand[0]), list(hand[1]), list(r_seen), list(t_seen), method=getattr(cv2, f"CALIB_HAND_EYE_{method}")
        )
        found[f"OpenCV {method}"] = _frames(study, np.asarray(x), np.asarray(t).ravel(), r_seen, t_seen)
    for method in ("SHAH", "LI"):
        _, _, r, t = cv2.calibrateRobotWorldHandEye(
            list(r_seen), list(t_seen), list(turn), list(shift),
            method=getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{method}"),
        )  # fmt: skip
        e = np.asarray(r), np.asarray(t).ravel()
        found[f"OpenCV {method}"] = _frames(study, e[0].T, -e[0].T @ e[1], r_seen, t_seen)
    return found


def _frames(study: HandEyeStudy, x: Floats, t: Floats, r_seen: Floats, t_seen: Floats) -> HandEyeFrames:
    """With the mean of H^-1 X B over the images as F."""
    turn, shift = study.motions
    back = np.swapaxes(turn, 1, 2)
    mean = (back @ x @ r_seen).mean(axis=0)
    left, _, right = np.linalg.svd(mean)
    moved = np.einsum("nij,nj->ni", back, t_seen @ x.T + t - shift).mean(axis=0)
    return HandEyeFrames(x.T, -x.T @ t, left @ right, moved)


def compared(seed: int, asked: argparse.Namespace) -> list[tuple[str, float, float, float]]:
    """Method, distance and angle of the camera to the truth, largest error of a pixel."""
    case = simulated(seed, asked)
    model = PixelModel(case.study)
    classical = classical_answer(case.study)
    answers = closed_forms(case.study) if case.study.setup == "eye-in-hand" else {}
    plain = replace(case.study, pose_half_width=np.zeros_like(case.study.pose_half_width))
    answers |= {"least squares on pixels": classical_answer(plain).frames}
    if case.study.pose_half_width.any():
        answers |= {"least squares, poses weighed": classical.frames}
    answers |= {"best frames": best_frames(case.study, classical).frames}
    rows = []
    true = unknowns_of(case.truth)
    for name, frames in answers.items():
        x = unknowns_of(frames)
        turn = x[:9].reshape(3, 3) @ true[:9].reshape(3, 3).T
        angle = float(np.degrees(2.0 * np.arcsin(min(1.0, np.linalg.norm(turn - np.eye(3)) / np.sqrt(8.0)))))
        rows.append((name, float(np.linalg.norm(x[9:12] - true[9:12])), angle, float(np.abs(model(frames)).max())))
    return rows


def main() -> None:
    """Print a row a seed, and what all of them say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--images", type=int, default=20)
    parser.add_argument("--corners", default="8,6", help="of the board, columns and rows")
    parser.add_argument("--within", default="any,2000")
    parser.add_argument("--setup", default="both", choices=("both", *SETUPS))
    parser.add_argument("--pixel-error", type=float, default=0.2)
    parser.add_argument("--position-error", type=float, default=0.0)
    parser.add_argument("--rotation-error", type=float, default=0.0)
    parser.add_argument("--opencv", action="store_true")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    if asked.opencv:
        answers = [compared(seed, asked) for seed in seeds]
        for k, (name, *_) in enumerate(answers[0]):
            mm, degrees, pixel = (np.median([row[k][c] for row in answers]) for c in (1, 2, 3))
            print(f"{name:28} camera off {mm:8.4f} mm {degrees:8.5f} deg   largest error {pixel:8.4f} px (medians)")
        return
    rows = []
    for seed in seeds:
        rows.append(certified(seed, asked))
        print(
            "  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), flush=True
        )
    for name in ("inside", "closed", "accepted"):
        print(f"{name}: {sum(row[name] for row in rows)} of {len(rows)}")
    for name in ("seconds", "verify", "MB", "camera mm", "camera deg"):
        values = [row[name] for row in rows]
        print(f"{name}: median {np.median(values):.4g}, largest {max(values):.4g}")


if __name__ == "__main__":
    main()
