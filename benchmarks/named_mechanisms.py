"""Which mechanism a study's calibration names, against the one that was simulated.

    python -m benchmarks.named_mechanisms [--seeds 20] [--json FILE]

Simulated DeltaLab studies as in the paper, each with one mechanism, calibrated as `cpcal calibrate` does. A study is
*right* where it names that mechanism and no other; "none of these" is what it says where no model that was asked
explains the readings. Of an axis offset and of the joint error there is no model: "none of these" is right for them.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from cpcal.calibration import Diagnosis, calibrate_study
from cpcal.robot import Study
from cpcal.simulate import simulate_study
from cpcal.simulate.disturbances import with_drift

NONE = "none of these"

# what is simulated, and the right name for it; None: nothing to name
CASES: dict[str, tuple[Callable[[int], Study], str | None]] = {
    "perfect": (lambda seed: simulate_study(seed=seed), None),
    "gain 0.002": (lambda seed: simulate_study(seed=seed, gain=0.002), "gain"),
    "gain 0.0005": (lambda seed: simulate_study(seed=seed, gain=0.0005), "gain"),
    "sag 2 mm": (lambda seed: simulate_study(seed=seed, sag=2.0), "sag"),
    "sag 0.5 mm": (lambda seed: simulate_study(seed=seed, sag=0.5), "sag"),
    "backlash 0.4 mm": (lambda seed: simulate_study(seed=seed, backlash=0.4), "play"),
    "backlash 0.1 mm": (lambda seed: simulate_study(seed=seed, backlash=0.1), "play"),
    "drift 0.2 mm": (lambda seed: with_drift(simulate_study(seed=seed), 0.2), "drift"),
    "drift 0.02 mm": (lambda seed: with_drift(simulate_study(seed=seed), 0.02), "drift"),
    "axis offset 3 mm": (lambda seed: simulate_study(seed=seed, axis_offset=3.0), NONE),
    "joint error 0.5 mm": (lambda seed: simulate_study(seed=seed, joint_error=0.5), NONE),
}


def answer(found: Diagnosis) -> str:
    """What is named, or said instead."""
    if found.named:
        return " and ".join(found.named)
    return NONE if found.unexplained else "nothing"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--cases", default=",".join(CASES), help="with commas")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    answers: dict[str, Counter[str]] = {}
    print("| truth | named | right or “none of these” |\n| --- | --- | --- |")
    for case in options.cases.split(","):
        simulated, right = CASES[case]
        answers[case] = Counter(answer(calibrate_study(simulated(seed)).diagnosis) for seed in range(options.seeds))
        good = sum(count for said, count in answers[case].items() if said in (right or "nothing", NONE))
        told = ", ".join(f"{said} {count}" for said, count in answers[case].most_common())
        print(f"| {case} | {told} | {100 * good / options.seeds:.0f} % |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
