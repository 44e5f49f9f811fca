"""The answers of 20 campaigns and of the demo, to compare two revisions of the program.

    python -m benchmarks.answers write FILE            with the program as it is here
    python -m benchmarks.answers compare OLD NEW       exit status 1 when an answer contradicts the other's

Answers are verdicts, brackets, proved points and enclosures of legs. Times and the names of fields may differ between
revisions; the public functions used here may not. The least-squares start depends on the last bits of the linear
algebra library: write both files on one machine.

Two programs may prove different bounds of the same numbers. They contradict each other where verdicts differ, where the
brackets of eps* have no number in common, or where the point that solves all equations at the smaller eps is not in
the enclosure that the other one proved for the larger.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cpcal
from benchmarks import run_by_hand

SEEDS = range(100, 120)
JOINT_ERRORS = (0.0, 1.0, 3.0, 10.0)  # mm, campaign by campaign in turn

Answer = dict[str, Any]


def campaign(seed: int) -> cpcal.Campaign:
    """Every second one has exact readings."""
    k = seed - SEEDS.start
    factor, truncate = (0.0, None) if k % 2 else (3.0, 2.9)
    return cpcal.simulate(seed=seed, joint_error=JOINT_ERRORS[k // 2 % 4], factor=factor, truncate=truncate)


def leg_answer(leg: cpcal.LegResult) -> Answer:
    """Of one leg, as plain numbers."""
    return {
        "verdict": leg.bracket.verdict.value,
        "eps": [leg.bracket.lo, leg.bracket.hi],
        "point": None if leg.bracket.point is None else list(leg.bracket.point),
        "enclosure": [leg.bracket.enclosure.lo.tolist(), leg.bracket.enclosure.hi.tolist()],
    }


def campaigns() -> dict[str, Answer]:
    """One leg of each, certified, by the name of what was asked."""
    out = {}
    for seed in SEEDS:
        leg = 1 + seed % 6
        with tempfile.TemporaryDirectory() as folder:
            result = cpcal.certify(campaign(seed), legs=[leg], certificates=folder)
        out[f"campaign {seed}, leg {leg}"] = leg_answer(result.legs[0])
    return out


def demo() -> dict[str, Answer]:
    """Every leg of the study that `cpcal demo` makes."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "demo"
        command = [sys.executable, "-m", "cpcal", "demo", "-o", str(where)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        result = cpcal.load_result(next(where.rglob("result.json")).parent)
    return {f"demo, leg {leg.leg}": leg_answer(leg) for leg in result.legs}


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


def write(file: Path) -> None:
    file.write_text(json.dumps(campaigns() | demo(), indent=1) + "\n")


def compare(old: Path, new: Path) -> None:
    """How many answers are contradicted or missing; each is printed."""
    before, after = (json.loads(path.read_text()) for path in (old, new))
    wrong = 0
    for name, answer in before.items():
        found = contradictions(answer, after[name]) if name in after else ["is missing"]
        wrong += bool(found)
        if found:
            print(f"{name}: CONTRADICTED: {'; '.join(found)}")
    print(f"{len(before)} answers, {wrong} contradicted or missing")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    run_by_hand(write, compare)
