"""Random mutations of true certificates of feasible problems: nothing false is ever accepted.

CPCAL_MUTATIONS=10000 in the environment makes that many of them.
"""

import contextlib
import json
import math
import os
import random
from collections.abc import Sequence
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Accepted, ExactCampaign, Refused, check
from cpcal.files.folders import CAMPAIGN_NAME
from tests.checker.valid.exact_legs import in_fractions, parts

TOTAL = int(os.environ.get("CPCAL_MUTATIONS", "1200"))
SHARE = {
    "exact_proof": 0.15, "split_proof": 0.2, "uncertain_proof": 0.03, "gain_proof": 0.03, "network_proof": 0.34,
    "network_split_proof": 0.25,
}  # fmt: skip
ODD = [
    *("0x0p+0", "0x1p-60", "0x1p+0", "-0x1p+0", "nan", "0x1p9999", "all", "", "lower", "sign"),
    *(0, 1, -1, 2, 8, 1 << 60, 1.0, True, None, [], {}),
]
Vector = Sequence[F]


def exact(text: str) -> F:
    mantissa, exponent = text.replace("0x", "").split("p")
    whole, _, part = mantissa.partition(".")
    return int(whole + part, 16) * F(2) ** (int(exponent) - 4 * len(part))


# the mutations ------------------------------------------------------------------------------------------------------


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
        with contextlib.suppress(OverflowError, ValueError):
            x = float.fromhex(value)
            up = rng.choice([-math.inf, math.inf])
            choices = [math.nextafter(x, up), x * (1 + rng.choice([-1, 1]) * 2.0 ** -rng.randint(1, 50))]
            choices += [-x, 2 * x, x / 2, x + rng.uniform(-1e-3, 1e-3)]
            return rng.choice(numbers) if rng.random() < 0.2 else rng.choice(choices).hex()
    if isinstance(value, bool) or value is None:
        return rng.choice([*ODD, not value])
    if isinstance(value, int):
        return rng.choice([value + 1, value - 1, -value, 2 * value, value // 2, rng.randint(0, 12)])
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
    if isinstance(value, str) and value and set(value) <= set("-0+"):
        at = rng.randrange(len(value))
        return value[:at] + rng.choice("-0+") + value[at + 1 :]
    if value in ("lo", "hi"):
        return "hi" if value == "lo" else "lo"
    return rng.choice(["upper", "lower", "length", "sign", "body"]) if isinstance(value, str) else rng.choice(ODD)


def bolder(lines: list[Any], head: int, rng: random.Random) -> None:
    """A claim that says more than was proved, or a little more."""
    claims, part = lines[head], 2.0 ** -rng.randint(1, 52)
    epsilon, hull, point = claims["epsilon"], claims["enclosure"], claims["point"]
    kind = rng.randint(0, 5)
    if kind == 0:
        epsilon["lo"] = (float.fromhex(epsilon["lo"]) * (1 + part)).hex()
    elif kind == 1:
        point["at"][-1] = epsilon["hi"] = (float.fromhex(epsilon["hi"]) * (1 - part)).hex()
    elif kind == 2:
        claims["infeasible"] = True
    elif kind == 3:
        i = rng.randrange(len(hull["lo"]) - 1)
        lo, hi = (float.fromhex(hull[side][i]) for side in ("lo", "hi"))
        side = rng.choice(["lo", "hi"])
        hull[side][i] = (lo + part * (hi - lo) if side == "lo" else hi - part * (hi - lo)).hex()
    elif kind == 4:
        count = lines[0].get("measurements") or lines[0].get("constraints")
        some = sorted(rng.sample(range(count), rng.randint(0, 3)))
        epsilon["hi"] = None
        point["at"][-1] = (float.fromhex(point["at"][-1]) * (1 - part)).hex()
        signs = point["readings"]
        good = [k for k in range(count) if k not in some]
        point.update(holds=good, readings=signs and [signs[k] for k in good])
        point["fails"] = [[rng.choice(["upper", "lower"]), k] for k in some]
    elif "only" in lines[0]:
        count = lines[0]["measurements"]
        lines[0]["only"] = sorted(rng.sample(range(count), count - rng.randint(0, 4)))
        epsilon["lo"] = (float.fromhex(epsilon["lo"]) * (1 + part)).hex()


def mutate(lines: list[Any], head: int, rng: random.Random) -> None:
    if rng.random() < 0.4:
        bolder(lines, head, rng)
    spots = places(lines)
    numbers = [box[key] for box, key in spots if isinstance(box[key], str) and "0x" in box[key]]
    steps = places(lines[head:])
    for _ in range(rng.choice([0, 1, 1, 2, 3])):
        box, key = rng.choice(spots if rng.random() < 0.3 else steps)
        if (isinstance(box, dict) and key not in box) or (isinstance(box, list) and key >= len(box)):
            continue
        box[key] = rng.choice(ODD) if rng.random() < 0.05 else changed(box[key], rng, numbers)
    if rng.random() < 0.1 and len(lines) > 2:
        kind, at = rng.randint(0, 2), rng.randrange(len(lines))
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines)), lines[at])
        else:
            rng.shuffle(lines)


# the truth, independently of the checker ----------------------------------------------------------------------------


def polynomial(p: Any, x: Vector) -> F:
    return sum((exact(c) * math.prod((x[i] for i in monomial), start=F(1)) for monomial, c in p), F(0))


def obeys(constraint: Any, x: Vector) -> bool:
    """As the lines of a certificate state it."""
    body = polynomial(constraint["body"], x)
    low, high = (None if constraint[k] is None else polynomial(constraint[k], x) for k in ("at_least", "at_most"))
    if not constraint["root"]:
        return (low is None or low <= body) and (high is None or body <= high)
    if body < 0 or (high is not None and (high < 0 or high * high < body)):
        return False
    return low is None or low < 0 or low * low <= body


def solves(m: Any, x: Vector) -> bool:
    """At the centre of the reading set: | ||v|| - (L + l) | <= eps, the leg longer than eps; a gain makes L longer."""
    square, base = parts(m, "gain" if len(x) > 8 else "plain", list(x[:-1]), [F(0)] * 7)
    eps, shortest = x[-1], m.length - m.radii[6] + x[6]
    return 0 <= eps <= min(shortest, base) and (base - eps) ** 2 <= square <= (base + eps) ** 2


class Truth:
    """What is known of a proof's problem: solutions, and that none is better than eps_lo."""

    def __init__(self, proof: Any) -> None:
        self.proof = proof
        rng = random.Random(0)
        if proof.folder is not None:
            self.campaign = ExactCampaign(proof.folder / CAMPAIGN_NAME)
        self.solutions = [[F(v) for v in proof.point]]
        for size in (1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
            x = [v + rng.uniform(-size, size) for v in proof.point[:-1]]
            low, high = 0.0, 4 * proof.eps_hi
            while high - low > 1e-12:  # the least eps, a little too large
                middle = (low + high) / 2
                low, high = (low, middle) if self._all([*map(F, x), F(middle)]) else (middle, high)
            if self._all([*map(F, x), F(high)]):
                self.solutions.append([*map(F, x), F(high)])

    def _all(self, x: Vector) -> bool:
        problem = self.proof.problem
        if self.proof.folder is None:
            return all(obeys(c, x) for c in self.proof.lines[1 : self.proof.head])
        return all(solves(in_fractions(self.campaign.measurement(k, 1)), x) for k in range(problem.count))

    def holds(self, lines: Any, found: Accepted, k: int, x: Vector) -> bool:
        return obeys(lines[1 + k], x) if found.leg is None else solves(in_fractions(self.campaign.measurement(k, 1)), x)

    def false(self, lines: Any, found: Accepted) -> str | None:
        """What is false of an accepted certificate."""
        proof, claims = self.proof, found.claims
        if found.leg is not None and (found.leg, found.model) != tuple(proof.lines[0][k] for k in ("leg", "model")):
            silent = claims.eps_hi is None and claims.eps_lo in (None, 0) and not claims.infeasible
            return None if silent else "another leg, or another model"
        exact_readings = found.leg is None or not any(proof.problem.radii(0))
        if claims.point is not None:
            for k in claims.point.holds:
                if exact_readings and not self.holds(lines, found, k, claims.point.at):
                    return "the point does not hold"
            for k in claims.point.fails:
                if self.holds(lines, found, k, claims.point.at):
                    return "the point does not fail"
        if claims.eps_hi is not None:
            assert claims.point is not None
            if claims.point.holds != found.chosen or found.objective is None:
                return "eps_hi without all measurements"
            if claims.point.at[found.objective] != claims.eps_hi:
                return "eps_hi is not that of the point"
        same = lines[0] == proof.lines[0] and (
            found.leg is not None or lines[1 : proof.head] == proof.lines[1 : proof.head]
        )
        if same and claims.eps_hi is not None and claims.eps_hi < F(proof.eps_lo):
            return "eps_hi below what was proved"
        return self._refuted(lines, found)

    def _refuted(self, lines: Any, found: Accepted) -> str | None:
        """By a solution of the (perhaps changed) problem."""
        claims, o = found.claims, found.objective
        for k, x in enumerate(self.solutions):
            if not all(a <= v <= b for a, v, b in zip(found.lo, x, found.hi, strict=True)):
                continue
            unchanged = k == 0 and found.leg is not None  # the best point solves every measurement
            if not unchanged and not all(self.holds(lines, found, n, x) for n in found.chosen):
                continue
            if o is not None and claims.eps_lo is not None and x[o] < claims.eps_lo:
                return f"eps_lo above that of solution {k}"
            if claims.cap is None or (o is not None and x[o] <= claims.cap):
                if claims.infeasible:
                    return f"infeasible, but there is solution {k}"
                sides = (
                    None if claims.enclosure is None else zip(claims.enclosure[0], x, claims.enclosure[1], strict=True)
                )
                if sides is not None and not all(a <= v <= b for i, (a, v, b) in enumerate(sides) if i != o):
                    return f"solution {k} is outside the enclosure"
        return None


@pytest.mark.parametrize("name", SHARE)
def test_no_mutation_is_believed(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    proof, rng, accepted, rounds = request.getfixturevalue(name), random.Random(name), 0, int(TOTAL * SHARE[name])
    truth = Truth(proof)
    assert len(truth.solutions) > (0 if name in ("uncertain_proof", "gain_proof") else 3)
    path = tmp_path / "certificate.jsonl"
    for number in range(rounds):
        lines = proof.copy()
        mutate(lines, proof.head, rng)
        path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        try:
            found = check(path, proof.folder and proof.folder / CAMPAIGN_NAME)
        except Refused:
            continue
        accepted += 1
        wrong = truth.false(lines, found)
        assert wrong is None, (number, wrong, json.dumps(lines)[:2000])
    assert 0 < accepted < rounds / 2
