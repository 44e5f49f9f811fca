"""The answers of 20 campaigns and of the demo, to compare two revisions of the program.

    python -m benchmarks.answers write FILE            with the program as it is here
    python -m benchmarks.answers compare OLD NEW       exit status 1 when an answer differs

Answers are brackets, proved points, enclosures and supports of legs, and what their certificates claim. Times and the
names of fields may differ between revisions; the public functions used here may not. The least-squares start depends
on the last bits of the linear algebra library: write both files on one machine.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cpcal

SEEDS = range(100, 120)
JOINT_ERRORS = (0.0, 1.0, 3.0, 10.0)  # mm, campaign by campaign in turn
DIGITS = 1e-9  # relative: numbers closer than this are the same
GAP = 2e-6  # relative: brackets and points of closed gaps may differ by this

Answer = dict[str, Any]


def campaign(seed: int) -> cpcal.Campaign:
    """Every second one has exact readings."""
    k = seed - SEEDS.start
    factor, truncate = (0.0, None) if k % 2 else (3.0, 2.9)
    return cpcal.simulate(seed=seed, joint_error=JOINT_ERRORS[k // 2 % 4], factor=factor, truncate=truncate)


def leg_answer(leg: cpcal.LegResult, certificate: Path) -> Answer:
    """Of one leg, as plain numbers."""
    claims = next(line for line in map(json.loads, certificate.read_text().splitlines()) if "epsilon" in line)
    return {
        "eps": [leg.eps_lo, leg.eps_hi],
        "point": None if leg.point is None else list(leg.point),
        "enclosure": [leg.enclosure.lo.tolist(), leg.enclosure.hi.tolist()],
        "support": sorted(leg.support),
        "claimed": [float.fromhex(v) if isinstance(v, str) else v for v in claims["epsilon"].values()],
    }


def answers() -> dict[str, Answer]:
    """By the name of what was asked."""
    out = {}
    for seed in SEEDS:
        leg = 1 + seed % 6
        with tempfile.TemporaryDirectory() as folder:
            result = cpcal.certify(campaign(seed), legs=[leg], certificates=folder)
            out[f"campaign {seed}, leg {leg}"] = leg_answer(result.legs[0], Path(folder) / f"leg{leg}.cert.jsonl")
    return out | demo()


def demo() -> dict[str, Answer]:
    """Every leg of the study that `cpcal demo` makes."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "demo"
        command = [sys.executable, "-m", "cpcal", "demo", "-o", str(where)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        result = cpcal.load_result(next(where.rglob("result.json")).parent)
        files = {leg.leg: next(where.rglob(f"leg{leg.leg}.cert.jsonl")) for leg in result.legs}
        return {f"demo, leg {leg.leg}": leg_answer(leg, files[leg.leg]) for leg in result.legs}


def differences(old: Any, new: Any, place: str, within: float) -> list[str]:
    """What differs, one line each."""
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        return [line for key in old for line in differences(old[key], new[key], f"{place}, {key}", within)]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return [line for k, (a, b) in pairs for line in differences(a, b, f"{place}[{k}]", within)]
    if isinstance(old, float) and isinstance(new, float):
        same = math.isclose(old, new, rel_tol=within, abs_tol=within)
    else:
        same = old == new
    return [] if same else [f"{place}: {old} -> {new}"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("write").add_argument("file", type=Path)
    compared = verbs.add_parser("compare")
    compared.add_argument("old", type=Path)
    compared.add_argument("new", type=Path)
    asked = parser.parse_args()
    if asked.verb == "write":
        asked.file.write_text(json.dumps(answers(), indent=1) + "\n")
        return 0
    old, new = (json.loads(path.read_text()) for path in (asked.old, asked.new))
    exact = differences(old, new, "answers", DIGITS)
    beyond = differences(old, new, "answers", GAP)
    print(f"{len(old)} answers; {len(exact)} numbers differ beyond {DIGITS:g}, {len(beyond)} beyond the gap of {GAP:g}")
    print("\n".join(beyond or exact))
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
