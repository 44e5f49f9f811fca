"""Certificates in lines, with what is known of the answer: whole ones and every kind of step."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Problem, Rule, Unknowns, Weights
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import free, limits, number
from cpcal.solver.certificate.float_rows import AllReadings, failing, holding, measured
from cpcal.solver.certificate.prover import WeightProver
from cpcal.solver.certificate.recording import with_readings
from cpcal.solver.interval import Box
from cpcal.solver.interval.numbers import round_down, round_up

Lines = list[dict[str, Any]]
STEPS = ("split", "exclude", "pass", "halve")  # of the proofs that have every kind of step


def dyadic(text: str) -> F:
    """The number that a text of the format stands for."""
    mantissa, exponent = text.replace("0x", "").split("p")
    return int(mantissa, 16) * F(2) ** int(exponent)


def exact_weights(value: dict[str, Any]) -> Weights:
    """The exact form of the JSON of weights."""
    r, p, t = value["exponents"]
    return Weights(
        tuple((row, w) for row, w in value["rows"]),
        tuple(map(tuple, value["products"])),
        tuple((i, dyadic(touch), w) for i, touch, w in value["tangents"]),
        (r, p, t),
    )


# matrices of fractions, apart from the checker's own ------------------------------------------------------------------

Matrix = list[list[F]]


def rotation_of(q: Sequence[F]) -> Matrix:
    """R(q), divided by |q|^2: the columns are q e q' for the axes e."""
    w, x, y, z = q
    norm = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return [[v / norm for v in row] for row in rows]


def applied(a: Sequence[Sequence[F]], v: Sequence[F]) -> list[F]:
    return [sum((x * y for x, y in zip(row, v, strict=True)), F(0)) for row in a]


def across(a: Sequence[Sequence[F]]) -> Matrix:
    return [list(column) for column in zip(*a, strict=True)]


def times(a: Sequence[Sequence[F]], b: Sequence[Sequence[F]]) -> Matrix:
    return [applied(across(b), row) for row in a]


def value_at(terms: Mapping[tuple[int, ...], int], at: Sequence[F]) -> F:
    """Of a row at the values of its unknowns."""
    return sum((c * math.prod((at[i] for i in monomial), start=F(1)) for monomial, c in terms.items()), F(0))


def unknowns(point: Sequence[Any]) -> Unknowns:
    """At a point."""
    x = tuple(F(v) for v in point)
    return Unknowns(ExactBox(x, x), free)


def all_readings(problem: Problem, point: Sequence[float]) -> AllReadings:
    """Of all measurements of a leg's problem, at a point without eps."""
    return AllReadings(problem.model, point, *measured(problem, range(problem.count), unknowns([*point, 0])))


@dataclass(frozen=True)
class Proof:
    """A true certificate in lines, what it is about, and what is known of the answer."""

    folder: Path | None
    problem: Problem
    lines: Lines
    eps_lo: float
    eps_hi: float
    point: tuple[float, ...]

    @property
    def head(self) -> int:
        """The index of the claims, the last line before the steps."""
        return next(k for k, line in enumerate(self.lines) if "infeasible" in line)

    def index(self, name: str) -> int:
        if name == "header":
            return 0
        return self.head + 1 + STEPS.index(name) if name in STEPS else self.head

    def copy(self) -> Lines:
        copied: Lines = json.loads(json.dumps(self.lines))
        return copied

    def rule(self, lo: Sequence[float], hi: Sequence[float], rows: Sequence[Any]) -> Rule:
        """With the rows of a step."""
        none = "0" * len(self.problem.radii(0))
        table = [(row[0], row[1], row[2] if row[2:] else none) for row in rows]
        return Rule(self.problem, ExactBox(tuple(F(v) for v in lo), tuple(F(v) for v in hi)), table, free)

    def holds(self, k: int, point: Sequence[Any]) -> bool:
        return holding(self.problem, unknowns(point), k) is not None

    def fails(self, k: int, point: Sequence[Any]) -> list[Any] | None:
        """The row that proves it, as in a certificate."""
        row = failing(self.problem, unknowns(point), k)
        return None if row is None else [*row]

    def bounds(self) -> tuple[list[float], list[float]]:
        lo, hi = ([float(dyadic(v)) for v in self.lines[0][side]] for side in ("lo", "hi"))
        return lo, hi


def tightest(rule: Rule, given: Sequence[Any], lo: list[float], hi: list[float]) -> list[Any]:
    """The last float64 that the weights prove, for every bound that improves a box; the objective first.

    Changes lo and hi.
    """
    bounds = []
    for i, side, _, weights in sorted(given, key=lambda entry: -entry[0]):
        value = (round_down if side == "lo" else round_up)(rule.bound(i, side, exact_weights(weights)))
        if value > lo[i] if side == "lo" else value < hi[i]:
            bounds.append([i, side, number(value), weights])
            (lo if side == "lo" else hi)[i] = value
    return bounds


def short(folder, statement, network, goal, point):
    """A proof in the network's small box about the best point: one pass with bounds of the objective and two others."""
    ((_, lifted),) = plugins.build_each(network, ("lifted",), objective=goal)
    domain, o = network.domain, network.names.index(goal)
    record = json.loads(json.dumps(WeightProver(statement)(domain, lifted.contract(domain)).record))
    lo, hi = [float(v) for v in domain.lo], [float(v) for v in domain.hi]
    shell = Proof(folder, statement.problem, [], 0.0, 0.0, tuple(point))
    rule = shell.rule(lo, hi, record["rows"])
    given = [entry for entry in record["bounds"] if (entry[0], entry[1]) == (o, "lo")]
    given += [entry for entry in record["bounds"] if entry[0] != o][:2]
    bounds = tightest(rule, given, lo, hi)
    assert len(bounds) == 3
    best = float(domain.hi[o])
    claims = {
        "cap": number(best),
        "infeasible": False,
        "epsilon": {"lo": number(lo[o]), "hi": number(best)},
        "enclosure": limits(Box(network.names, np.array(lo), np.array(hi))),
        "point": {"at": [number(v) for v in point], "holds": "all", "factor": None, "fails": []},
    }
    claims = with_readings(statement.problem, claims)
    step = {"pass": 0, "cap": record["cap"], "rows": record["rows"], "bounds": bounds}
    lines = [*statement.header(domain), claims, step]
    return Proof(folder, statement.problem, json.loads(json.dumps(lines)), lo[o], best, tuple(point))


def halved(proof: Proof) -> Proof:
    """The same with every kind of step: split, exclusion of one part, pass, split."""
    o = proof.problem.objective
    assert o is not None
    lines, at = proof.copy(), proof.eps_lo * 0.75
    head, (claims, step) = lines[: proof.head], lines[proof.head :]
    weights = next(entry[3] for entry in step["bounds"] if entry[0] == o)
    lo, hi = proof.bounds()
    below = [*hi[:o], at, *hi[o + 1 :]]
    rows = step["rows"]
    assert proof.rule(lo, below, rows).excludes(exact_weights(weights))
    lo[o] = at
    bounds = tightest(proof.rule(lo, hi, rows), step["bounds"], lo, hi)
    claims["epsilon"]["lo"] = number(lo[o])
    claims["enclosure"] = limits(Box(proof.problem.unknowns, np.array(lo), np.array(hi)))
    axis = 3 if o > 3 else 0
    steps = [
        {"split": 0, "unknown": o, "at": number(at), "into": [1, 2]},
        {"exclude": 1, "cap": step["cap"], "rows": rows, "weights": weights},
        {"pass": 2, "cap": step["cap"], "rows": rows, "bounds": bounds},
        {"split": 2, "unknown": axis, "at": number(proof.point[axis]), "into": [3, 4]},
    ]
    return Proof(proof.folder, proof.problem, [*head, claims, *steps], lo[o], proof.eps_hi, proof.point)
