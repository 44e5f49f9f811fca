"""The answers of 20 campaigns and of the demo, to compare two revisions of the program.

    python -m benchmarks.answers write FILE            with the program as it is here
    python -m benchmarks.answers compare OLD NEW       exit status 1 when an answer contradicts the other's

Answers are verdicts, brackets, proved points, enclosures and supports of legs, and what their certificates claim. Times
and the names of fields may differ between revisions; the public functions used here may not. The least-squares start
depends on the last bits of the linear algebra library: write both files on one machine.

Two programs may prove different bounds of the same numbers. They contradict each other where verdicts differ, where the
brackets of eps* have no number in common, or where the point that solves all equations at the smaller eps is not in
the enclosure that the other one proved for the larger. What is not contradicted may differ; the table says how much:
the share of numbers that are not equal to 1e-9, how far apart the bounds are, by how much boxes grew, what moved in the
supports.
"""

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
        "verdict": leg.bracket.verdict.value,
        "eps": [leg.bracket.lo, leg.bracket.hi],
        "point": None if leg.bracket.point is None else list(leg.bracket.point),
        "enclosure": [leg.bracket.enclosure.lo.tolist(), leg.bracket.enclosure.hi.tolist()],
        "support": sorted(leg.support),
        "claimed": [float.fromhex(v) if isinstance(v, str) else v for v in claims["epsilon"].values()],
    }


def campaigns() -> dict[str, Answer]:
    """One leg of each, by the name of what was asked."""
    out = {}
    for seed in SEEDS:
        leg = 1 + seed % 6
        with tempfile.TemporaryDirectory() as folder:
            result = cpcal.certify(campaign(seed), legs=[leg], certificates=folder)
            out[f"campaign {seed}, leg {leg}"] = leg_answer(result.legs[0], Path(folder) / f"leg{leg}.cert.jsonl")
    return out


def demo() -> dict[str, Answer]:
    """Every leg of the study that `cpcal demo` makes."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "demo"
        command = [sys.executable, "-m", "cpcal", "demo", "-o", str(where)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        result = cpcal.load_result(next(where.rglob("result.json")).parent)
        files = {leg.leg: next(where.rglob(f"leg{leg.leg}.cert.jsonl")) for leg in result.legs}
        return {f"demo, leg {leg.leg}": leg_answer(leg, files[leg.leg]) for leg in result.legs}


def contradictions(old: Answer, new: Answer) -> list[str]:
    """What cannot both be true of one leg."""
    out = [] if old["verdict"] == new["verdict"] else [f"{old['verdict']} became {new['verdict']}"]
    if max(old["eps"][0], new["eps"][0]) > min(old["eps"][1], new["eps"][1]):
        out.append(f"eps* in {old['eps']} and in {new['eps']}")
    first, second = sorted((old, new), key=lambda answer: float(answer["eps"][1]))
    lo, hi = second["enclosure"]
    if first["point"] and not all(a <= v <= b for a, v, b in zip(lo, first["point"], hi, strict=True)):
        out.append(f"the point {first['point']} at {first['eps'][1]} is not in the enclosure at {second['eps'][1]}")
    return out


def told(old: Answer, new: Answer) -> str:
    """How far two answers are apart, in one line."""
    numbers = list(zip(numbers_of(old), numbers_of(new), strict=False))
    same = sum(math.isclose(a, b, rel_tol=DIGITS, abs_tol=DIGITS) for a, b in numbers)
    lower, upper = (new["eps"][k] - old["eps"][k] for k in (0, 1))
    widths = [[b - a for a, b in zip(*answer["enclosure"], strict=True)] for answer in (old, new)]
    grown = [b / a for a, b in zip(*widths, strict=True) if a > 0.0]
    box = f"{min(grown):.4f} to {max(grown):.4f}" if grown else "none"
    kept = len(set(old["support"]) & set(new["support"]))
    support = f"{kept} of {len(old['support'])} kept, {len(new['support'])} now"
    return f"{same} of {len(numbers)} numbers equal; eps {lower:+.2e}, {upper:+.2e}; widths x {box}; support {support}"


def numbers_of(answer: Answer) -> list[float]:
    """Brackets, point and box."""
    return [*answer["eps"], *(answer["point"] or []), *answer["enclosure"][0], *answer["enclosure"][1]]


def compare(old: dict[str, Answer], new: dict[str, Answer]) -> int:
    """Prints both; how many answers are contradicted or missing."""
    wrong = 0
    for name, before in old.items():
        found = contradictions(before, new[name]) if name in new else ["is missing"]
        wrong += bool(found)
        print(f"{name}: {'CONTRADICTED: ' + '; '.join(found) if found else told(before, new[name])}")
    print(f"{len(old)} answers, {wrong} contradicted or missing")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    written = verbs.add_parser("write")
    written.add_argument("file", type=Path)
    written.add_argument("--only", choices=["campaigns", "demo"], help="one part of it")
    compared = verbs.add_parser("compare")
    compared.add_argument("old", type=Path)
    compared.add_argument("new", type=Path)
    asked = parser.parse_args()
    if asked.verb == "write":
        parts = {"campaigns": campaigns, "demo": demo}
        found: dict[str, Answer] = {}
        for name in [asked.only] if asked.only else parts:
            found |= parts[name]()
        asked.file.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    return int(compare(*(json.loads(path.read_text()) for path in (asked.old, asked.new))) > 0)


if __name__ == "__main__":
    sys.exit(main())
