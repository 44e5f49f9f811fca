"""How often what a study's calibration states as ± holds the truth, whatever disturbs the readings.

    python -m benchmarks.study_coverage [--seeds 200] [--cases perfect,outliers] [--runs 11] [--json FILE]

Simulated DeltaLab studies as in the paper (64 extremal configurations, 11 runs; 64 random ones, 10 runs), calibrated as
`cpcal calibrate` does. Of every stated deviation: the share of its numbers that are within k = 2 of the truth (the
drawing's frames: within their own k), over all seeds; and the share of studies that say that the noise does not
explain the residuals, so that the model is wrong and nothing stated need hold. Words in capitals are counted too.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.calibration import Alignment, StudyCalibration, aligned, calibrate_study, in_own_frame, own_frame_covariance
from cpcal.common.arrays import Floats
from cpcal.robot import Pose, Study, compose, inverse, rotation_vector, transformed
from cpcal.simulate import disturbances as disturbed
from cpcal.simulate import simulate_study

_ROOT = np.array([[0.02, 0.0], [0.0, 0.01], [0.02, 0.0], [5e-5, 0.0], [0.0, 5e-5], [5e-5, 5e-5]])  # mm, rad

CASES: dict[str, Callable[[int, dict[str, Any]], Study]] = {
    "perfect": lambda seed, size: simulate_study(seed=seed, **size),
    "correlated noise": lambda seed, size: disturbed.with_pose_noise(
        simulate_study(seed=seed, **size), _ROOT, seed=seed
    ),
    "shared servo noise": lambda seed, size: disturbed.with_robot_scatter(
        simulate_study(seed=seed, **size), 0.1, seed=seed
    ),
    "common error": lambda seed, size: disturbed.with_common_error(
        simulate_study(seed=seed, **size), 0.02, 5e-5, 0.01, seed=seed
    ),
    "smooth model error": lambda seed, size: simulate_study(seed=seed, joint_error=0.2, **size),
    "outliers": lambda seed, size: disturbed.with_outliers(simulate_study(seed=seed, **size), 0.01, 1.0, seed=seed),
}


def truth_of(study: Study) -> Floats:
    """(n, 7): the true joint centres where the calibration has them, in the frames of camera and target."""
    truth = study.truth
    assert truth is not None
    base = transformed(truth.camera, truth.robot.base)
    mobile = transformed(inverse(truth.target), truth.robot.mobile)
    return np.concatenate([base, mobile, truth.robot.offset[:, None]], axis=1)


def held(study: Study, found: StudyCalibration) -> dict[str, list[bool]]:
    """For every stated deviation, number by number, whether the truth is within it."""
    true, out = truth_of(study), {}
    for name, fit in (("x_c", found.x_c), ("x_c of f", found.x_c_f), ("x_c_sigma", found.x_c_sigma)):
        out[name] = (np.abs(fit.parameters - true) <= 2.0 * fit.standard_errors).ravel().tolist()
    sigma = found.x_c_sigma
    variance = np.diagonal(own_frame_covariance(sigma.parameters, sigma.covariance)).reshape(true.shape)
    apart = np.abs(in_own_frame(sigma.parameters) - in_own_frame(true))
    free = variance > 1e-12  # what the frame fixes is exact
    out["x_c_sigma, own frames"] = (apart <= 2.0 * np.sqrt(variance))[free].tolist()
    truth = study.truth
    assert truth is not None
    size = 3 * len(true)
    for part, drawn, frame, placed in (
        (slice(0, 3), study.robot.base, found.base_frame, inverse(truth.camera)),
        (slice(3, 6), study.robot.mobile, found.mobile_frame, truth.target),
    ):
        joints = aligned(true[:, part], drawn, np.zeros((size, size))).motion
        out.setdefault("frames of the joints", []).extend(_within(frame, joints, 2.0 * frame.sigma))
        reach = frame.coverage_factor * frame.drawing_sigma
        out.setdefault("frames of the drawing", []).extend(_within(frame, placed, reach))
    return out


def _within(frame: Alignment, true: Pose, reach: Floats) -> list[bool]:
    turn = rotation_vector(compose(frame.motion, inverse(true)).quaternion)
    apart = np.concatenate([frame.motion.position - true.position, turn])
    return [bool(inside) for inside in np.abs(apart) <= reach]


def studied(case: str, seed: int, size: dict[str, Any]) -> dict[str, Any]:
    """What one study states, and says in words."""
    study = CASES[case](seed, size)
    found = calibrate_study(study)
    return {
        "held": {name: float(np.mean(values)) for name, values in held(study, found).items()},
        "explained": found.x_c_sigma.explained,
        "not normal": any("NOT NORMAL" in one.sentence() for one in found.statistics),
        "modes": any("MORE" in one.sentence() for one in found.statistics) or bool(found.tests.found("modes")),
        "runs": bool(found.tests.found("runs")),
        "variances": bool(found.tests.found("variances")),
        "named": list(found.diagnosis.named),
        "unexplained": found.diagnosis.unexplained,
        "left out": len(found.screening.left_out),
    }


def table(rows: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Lines of Markdown: percent of the numbers that are held; then what was said."""
    names = list(next(iter(rows.values()))[0]["held"])
    lines = [
        "| | " + " | ".join(names) + " | says that the noise does not explain |",
        "| --- " * (len(names) + 2) + "|",
    ]
    for case, each in rows.items():
        shares = [100.0 * float(np.mean([one["held"][name] for one in each])) for name in names]
        flagged = 100.0 * float(np.mean([not one["explained"] for one in each]))
        lines.append(f"| {case} | " + " | ".join(f"{share:.1f}" for share in shares) + f" | {flagged:.0f} % |")
    lines.append("")
    for case, each in rows.items():
        said: dict[str, int] = defaultdict(int)
        for one in each:
            for word in ("not normal", "modes", "runs", "variances"):
                said[word] += one[word]
            for name in one["named"]:
                said[f"names {name}"] += 1
            said["none of these"] += one["unexplained"]
        told = ", ".join(f"{word} {count}" for word, count in said.items() if count) or "nothing"
        lines.append(f"{case}: of {len(each)} studies these say: {told}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--runs", type=int, default=11)
    parser.add_argument("--cases", default=",".join(CASES), help="with commas")
    parser.add_argument("--json", type=Path, help="write the figures here too, after every seed")
    options = parser.parse_args()
    rows: dict[str, list[dict[str, Any]]] = {case: [] for case in options.cases.split(",")}
    for seed in range(options.seeds):
        for case, each in rows.items():
            each.append(studied(case, seed, {"runs": options.runs}))
        if options.json:
            options.json.write_text(json.dumps(rows) + "\n", encoding="utf-8")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
