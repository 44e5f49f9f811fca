"""Random mutations of true certificates of feasible problems: nothing false is ever accepted."""

from __future__ import annotations

import json
import math
import random
from fractions import Fraction as F
from typing import Any

import pytest

from cpcal.proof.checker import Accepted
from cpcal.proof.refusal import Refused

ROUNDS = {"exact_proof": 1200, "split_proof": 650, "uncertain_proof": 150}  # 10,000 and more were run by hand
ODD = [
    "0x0p+0",
    "0x1p-60",
    "0x1p+0",
    "-0x1p+0",
    "nan",
    "0x1p9999",
    0,
    1,
    -1,
    2,
    8,
    1.0,
    True,
    None,
    [],
    {},
    "",
    "lower",
]


def places(value: Any) -> list[tuple[Any, Any]]:
    """Every container of a value with every key in it."""
    found: list[tuple[Any, Any]] = []
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in pairs:
        found.append((value, key))
        found.extend(places(inner))
    return found


def changed(value: Any, rng: random.Random, numbers: list[str]) -> Any:
    if isinstance(value, str) and "0x" in value:
        x = float.fromhex(value)
        up = rng.choice([-math.inf, math.inf])
        choices = [math.nextafter(x, up), x * (1 + rng.choice([-1, 1]) * 2.0 ** -rng.randint(1, 50))]
        choices += [-x, 2 * x, x / 2, x + rng.uniform(-1e-3, 1e-3)]
        return rng.choice(numbers) if rng.random() < 0.2 else rng.choice(choices).hex()
    if isinstance(value, bool) or value is None:
        return rng.choice(ODD)
    if isinstance(value, int):
        return rng.choice([value + 1, value - 1, -value, rng.randint(0, 12)])
    if isinstance(value, list) and value:
        copied = list(value)
        kind = rng.randint(0, 2)
        if kind == 0:
            copied.pop(rng.randrange(len(copied)))
        elif kind == 1:
            copied.insert(rng.randrange(len(copied)), rng.choice(copied))
        else:
            rng.shuffle(copied)
        return copied
    if value in ("lo", "hi"):
        return "hi" if value == "lo" else "lo"
    return rng.choice(["upper", "lower", "length"]) if isinstance(value, str) else rng.choice(ODD)


def mutate(lines: list[Any], rng: random.Random) -> None:
    spots = places(lines)
    numbers = [box[key] for box, key in spots if isinstance(box[key], str) and "0x" in box[key]]
    steps = places(lines[1:])
    for _ in range(rng.choice([1, 1, 2, 3])):
        box, key = rng.choice(spots if rng.random() < 0.3 else steps)
        if (isinstance(box, dict) and key not in box) or (isinstance(box, list) and key >= len(box)):
            continue
        box[key] = rng.choice(ODD) if rng.random() < 0.05 else changed(box[key], rng, numbers)
    if rng.random() < 0.5 and len(lines) > 1 and isinstance(lines[1], dict):  # a bolder claim with it
        claim, towards = rng.choice([("eps_lo", 1), ("eps_hi", -1)])
        old = lines[1].get(claim)
        if isinstance(old, str) and "0x" in old:
            lines[1][claim] = (float.fromhex(old) * (1 + towards * 2.0 ** -rng.randint(1, 52))).hex()
    if rng.random() < 0.1 and len(lines) > 2:
        kind, at = rng.randint(0, 2), rng.randrange(len(lines))
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines)), lines[at])
        else:
            rng.shuffle(lines)


def false(found: Accepted, cap: F, proof: Any) -> str | None:
    """What is false of an accepted certificate, as far as the known best point tells."""
    point, best = [F(v) for v in proof.point], F(proof.eps_hi)
    header = proof.lines[0]
    if found.leg != header["leg"]:
        return None if found.eps_hi is None and found.eps_lo == 0 else "another leg"
    lo, hi = ([F(float.fromhex(v)) for v in header[side]] for side in ("lo", "hi"))
    if all(a <= v <= b for a, v, b in zip(found.lo, point, found.hi, strict=True)):
        if found.eps_lo > best:
            return "eps_lo above what the best point attains"
        if found.enclosure is not None and best <= cap:
            inside = zip(found.enclosure[0], point, found.enclosure[1], strict=True)
            if not all(a <= v <= b for a, v, b in inside):
                return "the best point is outside the enclosure"
    within = all(a <= c and d <= b for a, c, d, b in zip(lo, found.lo, found.hi, hi, strict=True))
    if within and found.eps_hi is not None and found.eps_hi < F(proof.eps_lo):
        return "eps_hi below what was proved"
    return None


@pytest.mark.parametrize("name", ROUNDS)
def test_no_mutation_is_believed(name: str, request: pytest.FixtureRequest, verdict: Any) -> None:
    proof, rng, accepted = request.getfixturevalue(name), random.Random(name), 0
    for number in range(ROUNDS[name]):
        lines = proof.copy()
        mutate(lines, rng)
        try:
            found = verdict(lines, proof.folder)
        except Refused:
            continue
        accepted += 1
        wrong = false(found, F(float.fromhex(lines[1]["cap"])), proof)
        assert wrong is None, (number, wrong, json.dumps(lines)[:2000])
    assert 0 < accepted < ROUNDS[name] / 2
