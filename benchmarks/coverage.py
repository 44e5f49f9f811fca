"""How often confidence intervals of least-squares fits hold the true parameters, on simulated campaigns.

    python -m benchmarks.coverage [--seeds 200] [--level 0.95] [--joint-error 0] [--noise 1] [--json FILE]

DeltaLab campaigns of 64 extremal poses with the paper's noise. Without joint error the model holds and the intervals
should cover at their level, for each of the 42 parameters to within the study's own chance: with 200 seeds and a level
of 0.95, a standard deviation of 0.015. With joint error none of them can: no interval knows of a model's error.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import cpcal
from cpcal.calibration import Noise, fit
from cpcal.simulate import true_robot

KINDS: dict[str, dict[str, Any]] = {
    "x_c of g, errors from the residuals": {"covariance": "residuals"},
    "x_c of f, errors from the residuals": {"form": "f", "covariance": "residuals"},
    "x_c of g, errors from the noise": {},
    "x_c_sigma leg by leg, from the noise": {"weights": "legs"},
    "x_c_sigma jointly, from the noise": {"weights": "joint"},
}


def studied(seeds: int, level: float, kinds: dict[str, dict[str, Any]], **options: Any) -> dict[str, dict[str, Any]]:
    """For each kind of fit: coverage (6, 7), its mean, and root mean squares of error and standard error (mm).

    `options` are those of `cpcal.simulate`.
    """
    hits: dict[str, list[Any]] = {kind: [] for kind in kinds}
    for seed in range(seeds):
        campaign = cpcal.simulate(seed=seed, **options)
        robot = true_robot(campaign)
        assert robot is not None
        noise = Noise.of(campaign)
        for kind, chosen in kinds.items():
            found = fit(campaign, noise=noise, **chosen)
            lower, upper = found.interval(level)
            inside = (lower <= robot.parameters) & (robot.parameters <= upper)
            hits[kind].append((inside, (found.parameters - robot.parameters) ** 2, found.standard_errors**2))
    result = {}
    for kind, rows in hits.items():
        inside, squares, variances = (np.mean([row[k] for row in rows], axis=0) for k in range(3))
        errors = {
            "rms error mm": float(np.sqrt(squares.mean())),
            "rms standard error mm": float(np.sqrt(variances.mean())),
        }
        result[kind] = {"coverage": inside.tolist(), "mean": float(inside.mean()), **errors}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--level", type=float, default=0.95)
    parser.add_argument("--joint-error", type=float, default=0.0, help="mm")
    parser.add_argument("--noise", type=float, default=1.0, help="scale of the paper's standard deviations")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    found = studied(options.seeds, options.level, KINDS, joint_error=options.joint_error, noise=options.noise)
    chance = np.sqrt(options.level * (1 - options.level) / options.seeds)
    print(f"{options.seeds} seeds, level {options.level:g}: a parameter's coverage has the deviation {chance:.3f}")
    for kind, figures in found.items():
        print(f"\n{kind}: {figures['mean']:.3f} on average; errors {figures['rms error mm']:.3f} mm,", end=" ")
        print(f"stated {figures['rms standard error mm']:.3f} mm (root mean squares)")
        print("leg    a_x    a_y    a_z    b_x    b_y    b_z      l")
        for leg, row in enumerate(figures["coverage"], start=1):
            print(f"{leg:3} " + " ".join(f"{share:6.3f}" for share in row))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
