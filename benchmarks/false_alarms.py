"""How many perfect studies have a word in capitals about their repeats; one in a hundred is aimed at.

    python -m benchmarks.false_alarms [--seeds 600]

Repeats of simulated DeltaLab studies as in the paper (64 extremal configurations, 11 runs), at the true joint centres.
"""

from __future__ import annotations

import argparse
from collections import Counter

from cpcal.calibration import campaign_deviations, describe, redefined, repeat_tests, repeatability
from cpcal.calibration.repeat_tests import MODES, RUNS, VARIANCES
from cpcal.calibration.study_rows import study_rows
from cpcal.robot import inverse
from cpcal.simulate import simulate_study


def words(seed: int) -> set[str]:
    """What a perfect study is accused of."""
    study = simulate_study(seed=seed, random_poses=1, validation_runs=1)
    assert study.truth is not None
    rows = study_rows(study.calibration, redefined(study.robot, inverse(study.truth.camera), study.truth.target))
    repeats = repeatability(rows.runs)
    channels = (*describe(campaign_deviations(rows.good), slice(6)), *describe(repeats.spread, slice(6, None)))
    tests, channels = repeat_tests(repeats, rows.run_names, channels)
    found = {kind for kind in (RUNS, VARIANCES, MODES) if tests.found(kind)}
    said = " ".join(one.sentence() for one in channels)
    return found | {word for word in ("NOT NORMAL", "MORE THAN ONE") if word in said}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=600)
    options = parser.parse_args()
    each = [words(seed) for seed in range(options.seeds)]
    told = ", ".join(f"{word} {count}" for word, count in Counter(word for one in each for word in one).items())
    print(f"of {options.seeds} perfect studies {sum(map(bool, each))} have a word in capitals: {told or 'none'}")


if __name__ == "__main__":
    main()
