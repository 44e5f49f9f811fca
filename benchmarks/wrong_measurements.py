"""Wrong measurements, found and proved: eps* with up to q of 64 wrong, with certificates that are checked again.

    python -m benchmarks.wrong_measurements [--campaigns 50] [--outliers 1,2,3] [--seed 1]

For each q, simulated campaigns of 64 extremal poses (joint error 0.1 mm, a tenth of the paper's noise, sets of three
standard deviations); q readings of leg 1, drawn at random, are off by 1 to 10 mm. A case counts as found when exactly
these are left out, as proved when the bracket is closed and the checker accepts the claim.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import cpcal
from cpcal.checker.robust_claim import check_robust
from cpcal.questions.outliers import certify_robust
from cpcal.simulate import simulate


def spoiled(seed: int, outliers: int) -> tuple[cpcal.Campaign, set[str]]:
    """A campaign, and the names of its wrong measurements."""
    good = simulate(seed=seed, joint_error=0.1, noise=0.1, truncate=3.0)
    rng = np.random.default_rng([seed, outliers])
    wrong = rng.choice(len(good), outliers, replace=False)
    length = good.length.copy()
    length[wrong, 0] += rng.choice([-1.0, 1.0], outliers) * rng.uniform(1.0, 10.0, outliers)
    campaign = cpcal.Campaign.of(
        good.robot,
        good.position,
        good.quaternion,
        length,
        pose=good.pose,
        run=good.run,
        uncertainty=good.uncertainty,
    )
    return campaign, {campaign.measurement_ids[k] for k in wrong}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=50)
    parser.add_argument("--outliers", default="1,2,3")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(f"{'q':>2} {'found':>6} {'proved':>7} {'of':>4}  median: certificates  kB  searches  seconds (largest)")
    for outliers in map(int, options.outliers.split(",")):
        found = proved = 0
        figures = []
        for seed in range(options.seed, options.seed + options.campaigns):
            campaign, wrong = spoiled(seed, outliers)
            with tempfile.TemporaryDirectory() as name:
                began = time.process_time()
                (leg,) = certify_robust(campaign, outliers=outliers, legs=(1,), certificates=name).legs
                seconds = time.process_time() - began
                (checked,) = check_robust(Path(name))
                size = sum(path.stat().st_size for path in Path(name).glob("*.cert.jsonl"))
            right = set(leg.left_out) == wrong
            good = leg.complete and checked.refused is None and checked.lo is not None and checked.hi is not None
            found, proved = found + right, proved + good
            figures.append((len(leg.proofs), size / 1000.0, leg.searches, seconds))
            if not (right and good):
                print(f"   seed {seed}: wrong {sorted(wrong)}, left out {leg.left_out}, {checked}", flush=True)
        files, size_, searches, cpu = np.median(np.array(figures), axis=0)
        worst = max(row[3] for row in figures)
        print(
            f"{outliers:>2} {found:>6} {proved:>7} {options.campaigns:>4}  {files:20.0f} {size_:5.0f} {searches:9.0f}"
            f"  {cpu:7.1f} ({worst:.1f})",
            flush=True,
        )


if __name__ == "__main__":
    main()
