"""True certificates of small problems, whole ones and one step by step, for the tests to believe and to forge."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from cpcal.checker import Accepted, check
from cpcal.checker.problem import Box as ExactBox
from cpcal.checker.problem import Problem, Unknowns
from cpcal.checker.rule import Rule, Weights
from cpcal.files.campaign_json import NAME, save_campaign_json
from cpcal.legs import leg_box, leg_model, leg_network, leg_statement
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.readings import failing, holding
from cpcal.solver.certificate.recording import with_readings
from cpcal.solver.certificate.statement import Statement, free, limits, number
from cpcal.solver.certificate.writer import WeightProver, rounded
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from tests.checker.second import Second, encoded, second_checker

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


def unknowns(point: Sequence[Any]) -> Unknowns:
    """At a point."""
    x = tuple(F(v) for v in point)
    return Unknowns(ExactBox(x, x), free)


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


def saved(folder: Path, **options: Any) -> cpcal.Campaign:
    cpcal.save_campaign(cpcal.simulate(seed=1, **options), folder)
    campaign = cpcal.load_campaign(folder)
    save_campaign_json(campaign, folder)
    return campaign


@dataclass(frozen=True)
class Certified:
    folder: Path
    path: Path
    result: cpcal.Result

    @property
    def leg(self) -> cpcal.LegResult:
        return self.result.legs[0]


@pytest.fixture(scope="session")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Certified]:
    """Simulate, and certify leg 1 with a certificate; `ask` are the options of certify."""
    known: dict[str, Certified] = {}

    def make(ask: dict[str, Any] | None = None, **options: Any) -> Certified:
        name = json.dumps([ask, options], sort_keys=True)
        if name not in known:
            folder = tmp_path_factory.mktemp("campaign")
            campaign = saved(folder, **options)
            result = cpcal.certify(campaign, certificates=folder / "run", **({"legs": [1]} | (ask or {})))
            known[name] = Certified(folder, folder / "run" / str(result.legs[0].certificate), result)
        return known[name]

    return make


def tightest(rule: Rule, given: Sequence[Any], lo: list[float], hi: list[float]) -> list[Any]:
    """The last float64 that the weights prove, for every bound that improves a box; the objective first.

    Changes lo and hi.
    """
    bounds = []
    for i, side, _, weights in sorted(given, key=lambda entry: -entry[0]):
        value = rounded(rule.bound(i, side, exact_weights(weights)), side == "lo")
        if value > lo[i] if side == "lo" else value < hi[i]:
            bounds.append([i, side, number(value), weights])
            (lo if side == "lo" else hi)[i] = value
    return bounds


def short(
    folder: Path | None,
    statement: Statement,
    network: ConstraintNetwork,
    goal: str,
    point: Sequence[float],
) -> Proof:
    """A proof in the network's small box about the best point: one pass with bounds of the objective and two others."""
    lifted = plugins.build(network, ("lifted",), objective=goal)
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
        "point": {"at": [number(v) for v in point], "holds": "all", "fails": []},
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


def _leg_proof(folder: Path, name: str = "plain", **options: Any) -> Proof:
    """In a small box about the best point: bounds on eps and two other unknowns."""
    campaign, model = saved(folder, **options), leg_model(name)
    leg = cpcal.certify(campaign, legs=[1], delta=20.0, model=name).legs[0]
    assert leg.point is not None
    box = leg_box(np.asarray(leg.point), 1e-2)
    extra = np.array(leg.point[7:])
    small = 1e-4 * model.half_widths
    box = Box(model.parameters, np.append(box.lo, extra - small), np.append(box.hi, extra + small))
    network = leg_network(campaign, 1, box, engine=get_arithmetic("float64"), eps=(0.0, leg.eps_hi), model=model)
    return short(folder, leg_statement(campaign, 1, model=name), network, "eps", (*leg.point, leg.eps_hi))


@pytest.fixture(scope="session")
def exact_proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """Exact readings, eps* known to a small part."""
    return _leg_proof(tmp_path_factory.mktemp("exact"), joint_error=10.0, factor=0.0, extremal=False, random_poses=12)


@pytest.fixture(scope="session")
def uncertain_proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """Reading sets, eps* > 0."""
    return _leg_proof(
        tmp_path_factory.mktemp("uncertain"), joint_error=10.0, factor=3.0, extremal=False, random_poses=16
    )


@pytest.fixture(scope="session")
def gain_proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """The same in a model with a gain, with every kind of step."""
    options = {"joint_error": 10.0, "factor": 3.0, "extremal": False, "random_poses": 16}
    return halved(_leg_proof(tmp_path_factory.mktemp("gain"), "gain", **options))


@pytest.fixture(scope="session")
def split_proof(exact_proof: Proof) -> Proof:
    return halved(exact_proof)


PLACES = np.array([[4.0, 0.0], [2.0, 3.5], [-2.0, 3.0], [-4.0, 0.5], [-1.0, -4.0], [2.5, -3.0]])
RANGES = np.array([3.5, 3.75, 3.375, 4.0, 4.25, 3.625])


def anchored(box: Sequence[Sequence[float]]) -> tuple[cpcal.Network, cpcal.Expr]:
    """A place from distances to known ones with a common offset, and squares that the first two must keep."""
    net = cpcal.Network()
    lo, hi = np.array(box[0]), np.array(box[1])
    a = net.variable("a", 2, (lo[:2], hi[:2]))
    offset, t = net.variable("offset", (), (lo[2], hi[2])), net.variable("t", (), (lo[3], hi[3]))
    net.add((cpcal.norm(PLACES - a) - (RANGES + offset)).within((-t, t)))
    net.add(RANGES + offset >= t)
    net.add((cpcal.sqr(a - 0.5).sum() - t).within((0.0, 8.0)))
    return net, t


@pytest.fixture(scope="session")
def network_proof() -> Proof:
    """Constraints that the certificate states itself."""
    net, t = anchored([(-3.0, -3.0, -1.0, 0.0), (3.0, 3.0, 1.0, 8.0)])
    found = net.minimize(t)
    assert found.witness is not None
    point = [float(v) for v in found.witness.point]
    box = [v - 0.01 for v in point[:3]], [v + 0.01 for v in point[:3]]
    near, _ = anchored([(*box[0], 0.0), (*box[1], found.hi)])
    return short(None, network_statement(near, "t", "a place"), near, "t", (*point[:3], found.hi))


@pytest.fixture(scope="session")
def network_split_proof(network_proof: Proof) -> Proof:
    return halved(network_proof)


def judge(path: Path, folder: Path | None) -> Accepted:
    """The checker's verdict of a certificate, by the campaign.json in that folder."""
    return check(path, None if folder is None else folder / NAME)


@pytest.fixture
def checked(tmp_path: Path) -> Callable[[bytes, Path | None], Accepted]:
    """Check the bytes of a certificate."""

    def checked_bytes(content: bytes, folder: Path | None) -> Accepted:
        path = tmp_path / "certificate.jsonl"
        path.write_bytes(content)
        return judge(path, folder)

    return checked_bytes


@pytest.fixture
def verdict(checked: Callable[[bytes, Path | None], Accepted]) -> Callable[[Lines, Path | None], Accepted]:
    """Check a certificate given as lines."""
    return lambda lines, folder: checked(encoded(lines), folder)


@pytest.fixture(scope="session")
def second() -> Second | None:
    """The checker in JavaScript; None where nothing runs it."""
    return second_checker()


KINDS = ("exact_proof", "split_proof", "uncertain_proof", "gain_proof", "network_proof", "network_split_proof")


@pytest.fixture(params=KINDS)
def any_proof(request: pytest.FixtureRequest) -> Proof:
    proof: Proof = request.getfixturevalue(request.param)
    return proof


@pytest.fixture(params=["exact_proof", "network_proof"])
def short_proof(request: pytest.FixtureRequest) -> Proof:
    """One of a leg and one of constraints, a pass each."""
    proof: Proof = request.getfixturevalue(request.param)
    return proof
