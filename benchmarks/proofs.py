"""Certificates: their size, and the time to write and to check them.

    python -m benchmarks.proofs [--legs 1,5] [--json FILE]

Simulated DeltaLab campaigns (joint error 1 mm, box +-100 mm, gap 1e-6), readings exact and uncertain, with 64, 704 and
7,744 measurements. Checking is done in pure `fractions`, reading the campaign included.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import cpcal
from cpcal.proof.checker import check
from cpcal.prove import write_certificate


def measured(factor: float, runs: int, legs: list[int], folder: Path) -> list[dict[str, float | int | str]]:
    """One line per leg."""
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=factor, runs=runs), folder / "campaign")
    campaign = cpcal.load_campaign(folder / "campaign")
    lines: list[dict[str, float | int | str]] = []
    for leg in cpcal.certify(campaign, legs=legs).legs:
        result = cpcal.certify(campaign, legs=[leg.leg])
        began = time.perf_counter()
        path = write_certificate(campaign, folder / "campaign", result, leg, folder / "leg.cert.jsonl")
        written = time.perf_counter()
        accepted = check(path, folder / "campaign")
        lines.append(
            {
                "readings": "uncertain" if factor else "exact",
                "measurements": len(campaign),
                "leg": leg.leg,
                "steps": accepted.steps,
                "kB": path.stat().st_size / 1000,
                "write s": written - began,
                "check s": time.perf_counter() - written,
                "gap lost": float(leg.eps_lo - accepted.eps_lo) / leg.eps_hi,
            }
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--legs", default="1,5", help="legs to certify")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    lines = []
    print("readings       N  leg  steps      kB  write s  check s  eps_lo given away (relative)")
    for factor in (0.0, 3.0):
        for runs in (1, 11, 121):
            with tempfile.TemporaryDirectory() as folder:
                for found in measured(factor, runs, [int(leg) for leg in options.legs.split(",")], Path(folder)):
                    lines.append(found)
                    print(
                        f"{found['readings']:9} {found['measurements']:6} {found['leg']:4} {found['steps']:6}"
                        f" {found['kB']:7.1f} {found['write s']:8.2f} {found['check s']:8.2f}  {found['gap lost']:.0e}",
                        flush=True,
                    )
    if options.json:
        options.json.write_text(json.dumps(lines, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
