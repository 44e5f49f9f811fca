"""How large a model error each mechanism of an imperfect leg makes: eps* by mechanism and size.

    python -m benchmarks.mechanism_errors [--sizes 1,3,10,30,45] [--seed 1] [--time-limit 60] [--json FILE]

A simulated DeltaLab study for each mechanism alone: 64 extremal configurations, one run, no noise, seen in the true
base and mobile frames and declared exact, box +-100 mm around the fit. So eps* is what seven parameters a leg cannot
describe of the mechanism, and nothing else. Sizes are in mm; the gain's is what it adds at the end of the stroke.
Backlash comes twice: its side decided by the platform's weight alone, and mostly by the direction of approach.
Each figure is eps_lo, with "+" where eps_hi is over 1 % larger when the time is up.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import cpcal
from cpcal.robot import KinematicsError, Study
from cpcal.simulate import simulate_study
from cpcal.simulate.campaigns import STROKE

CASES: dict[str, tuple[str, dict[str, float]]] = {
    "axis offset, lower joint": ("axis_offset", {}),
    "offsets of three axes, upper joint": ("joint_offset", {}),
    "backlash, side by load": ("backlash", {"friction": 0.0}),
    "backlash, side by approach": ("backlash", {"friction": 100.0}),
    "sag": ("sag", {}),
    "gain of the sensor": ("gain", {}),
    "joint error": ("joint_error", {}),
}


def campaign(study: Study) -> cpcal.Campaign:
    """The calibration table of a simulated study in the true frames, readings exact."""
    truth, table = study.truth, study.calibration
    assert truth is not None
    poses = truth.mobile_in_base(table)
    return cpcal.Campaign.of(
        study.robot, poses.position, poses.quaternion, table.length, pose=table.pose, run=table.run, exact=True
    )


def brackets(mechanism: str, size: float, more: dict[str, float], seed: int, limit: float) -> list[tuple[float, float]]:
    """[eps_lo, eps_hi] of each leg."""
    if mechanism == "gain":
        size /= 0.5 * (STROKE[1] - STROKE[0])
    options = {mechanism: size, **more}
    study = simulate_study(seed=seed, runs=1, validation_runs=1, random_poses=1, noise=0.0, **options)  # type: ignore[arg-type]
    result = cpcal.certify(campaign(study), delta=100.0, time_limit=limit)
    return [(leg.eps_lo, leg.eps_hi) for leg in result.legs]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="1,3,10,30,45", help="mm")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds a leg")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    print(f"{'mechanism':35} {'size':>5}  " + " ".join(f"{f'leg {leg}':>8}" for leg in range(1, 7)) + "  seconds")
    figures = []
    for case, (mechanism, more) in CASES.items():
        for size in map(float, options.sizes.split(",")):
            began = time.perf_counter()
            try:
                found = brackets(mechanism, size, more, options.seed, options.time_limit)
            except KinematicsError as error:
                print(f"{case:35} {size:5g}  {error}", flush=True)
                continue
            cells = [f"{lo:7.3f}{'+' if hi > 1.01 * lo else ' '}" for lo, hi in found]
            print(f"{case:35} {size:5g}  {' '.join(cells)}  {time.perf_counter() - began:7.1f}", flush=True)
            figures.append({"mechanism": mechanism, "case": case, "size": size, "legs": found})
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
