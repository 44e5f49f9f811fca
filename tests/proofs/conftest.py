"""True certificates of small campaigns, whole ones and one step by step, for the tests to believe and to forge."""

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
from cpcal import plugins
from cpcal.calibration import leg_box, leg_network
from cpcal.interval import get_arithmetic
from cpcal.proof.bounds import Bounder, ExactBox, RowWeight, Weights
from cpcal.proof.campaign import ExactCampaign
from cpcal.proof.checker import FORMAT, Accepted, check
from cpcal.proof.writer import Certifying, number, rounded
from cpcal.prove import write_certificate

Lines = list[dict[str, Any]]


def exact_weights(value: dict[str, Any]) -> Weights:
    """The exact form of the JSON of weights."""

    def f(text: str) -> F:
        return F(float.fromhex(text))

    rows: tuple[RowWeight, ...] = tuple((side, k, f(w)) for side, k, w in value["rows"])
    return Weights(
        rows,
        tuple((i, j, F(p), F(q), f(w)) for i, j, p, q, w in value["products"]),
        tuple((i, f(t), f(w)) for i, t, w in value["tangents"]),
    )


@dataclass(frozen=True)
class Proof:
    """A true certificate in lines, its campaign, and what is known of the answer."""

    folder: Path
    lines: Lines
    eps_lo: float
    eps_hi: float
    point: tuple[float, ...]

    @property
    def exact(self) -> ExactCampaign:
        return ExactCampaign(self.folder, self.lines[0]["leg"])

    def copy(self) -> Lines:
        copied: Lines = json.loads(json.dumps(self.lines))
        return copied

    def bounder(self, lo: Sequence[float], hi: Sequence[float]) -> Bounder:
        exact = self.exact
        rows = {k: exact.measurement(k) for k in range(len(exact))}
        return Bounder(rows, ExactBox(tuple(F(v) for v in lo), tuple(F(v) for v in hi)))


def saved(folder: Path, **options: Any) -> cpcal.Campaign:
    cpcal.save_campaign(cpcal.simulate(seed=1, **options), folder)
    return cpcal.load_campaign(folder)


@dataclass(frozen=True)
class Certified:
    folder: Path
    path: Path
    leg: cpcal.LegResult


@pytest.fixture(scope="session")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Certified]:
    """Simulate, certify leg 1 and write the certificate."""
    known: dict[str, Certified] = {}

    def make(**options: Any) -> Certified:
        name = json.dumps(options, sort_keys=True)
        if name not in known:
            folder = tmp_path_factory.mktemp("campaign")
            campaign = saved(folder, **options)
            result = cpcal.certify(campaign, legs=[1], delta=100.0)
            path = write_certificate(campaign, folder, result, result.legs[0], folder / "leg1.jsonl")
            known[name] = Certified(folder, path, result.legs[0])
        return known[name]

    return make


def bounds_of(lo: Sequence[float], hi: Sequence[float]) -> dict[str, list[str]]:
    return {"lo": [number(v) for v in lo[:7]], "hi": [number(v) for v in hi[:7]]}


def tightest(bounder: Bounder, given: list[Any], lo: list[float], hi: list[float]) -> list[Any]:
    """The last float64 that the weights prove, for every bound that improves a box; eps first. Changes lo and hi."""
    bounds = []
    for i, side, _, weights in sorted(given, key=lambda entry: -entry[0]):
        value = rounded(bounder.improved(i, side, exact_weights(weights)), side == "lo")
        if value > lo[i] if side == "lo" else value < hi[i]:
            bounds.append([i, side, number(value), weights])
            (lo if side == "lo" else hi)[i] = value
    return bounds


def _near(folder: Path, around: float, wanted: Sequence[tuple[int, str]], **options: Any) -> Proof:
    """A short proof in a small box about the best point: one pass with the bounds `wanted`."""
    campaign = saved(folder, **options)
    leg = cpcal.certify(campaign, legs=[1], delta=100.0).legs[0]
    assert leg.point is not None
    point = np.asarray(leg.point)
    box = leg_box(point, around)
    exact = ExactCampaign(folder, 1)
    network = leg_network(campaign, 1, box, engine=get_arithmetic("float64"), eps=(0.0, leg.eps_hi))
    contractor = Certifying(plugins.build(network, ("lifted",), objective="eps"), exact.measurement)
    start = network.domain
    contractor.contract(start)
    record = contractor.record
    assert record is not None
    lo, hi = [float(v) for v in start.lo], [float(v) for v in start.hi]
    rows = {k: exact.measurement(k) for k in range(len(exact))}
    given = [entry for entry in record["bounds"] if (entry[0], entry[1]) in wanted]
    bounds = tightest(Bounder(rows, ExactBox(tuple(map(F, lo)), tuple(map(F, hi)))), given, lo, hi)
    cap = number(leg.eps_hi)
    claims = {"cap": cap, "eps_lo": number(lo[7]), "enclosure": bounds_of(lo, hi), "eps_hi": cap}
    header = {"format": FORMAT, "campaign": exact.sha256, "leg": 1, "measurements": len(exact), "cap": cap}
    lines = [
        header | bounds_of(start.lo, start.hi),
        claims,
        {"pass": 0, "cap": record["cap"], "bounds": bounds},
        {"point": [number(v) for v in point]},
    ]
    return Proof(folder, lines, float(lo[7]), leg.eps_hi, tuple(float(v) for v in point))


FEW = ((7, "lo"), (0, "lo"), (6, "hi"))


@pytest.fixture(scope="session")
def exact_proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """Exact readings, eps* known to a small part."""
    options = {"joint_error": 10.0, "factor": 0.0, "extremal": False, "random_poses": 12}
    return _near(tmp_path_factory.mktemp("exact"), 1e-3, FEW, **options)


@pytest.fixture(scope="session")
def uncertain_proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """Reading sets, eps* > 0."""
    options = {"joint_error": 10.0, "factor": 3.0, "extremal": False, "random_poses": 16}
    return _near(tmp_path_factory.mktemp("uncertain"), 1e-3, FEW, **options)


@pytest.fixture(scope="session")
def split_proof(exact_proof: Proof) -> Proof:
    """The exact one with every kind of step: pass, split, exclusion of one part, pass again, split, witness."""
    lines = exact_proof.copy()
    header, claims, step, witness = lines
    weights = next(entry[3] for entry in step["bounds"] if entry[0] == 7)
    lo = [*(float.fromhex(v) for v in header["lo"]), 0.0]
    hi = [*(float.fromhex(v) for v in header["hi"]), float.fromhex(header["cap"])]
    at = exact_proof.eps_lo * 0.75
    assert exact_proof.bounder(lo, [*hi[:7], at]).excludes(exact_weights(weights))
    middle = exact_proof.point[3]
    again = exact_proof.bounder([*lo[:7], at], hi)
    lo[7] = at
    bounds = tightest(again, step["bounds"], lo, hi)
    lowest = lo[7]
    claims["eps_lo"] = number(lowest)
    claims["enclosure"] = bounds_of(lo, hi)
    steps = [
        {"split": 0, "unknown": 7, "at": number(at), "into": [1, 2]},
        {"exclude": 1, "cap": header["cap"], "weights": weights},
        {"pass": 2, "cap": header["cap"], "bounds": bounds},
        {"split": 2, "unknown": 3, "at": number(middle), "into": [3, 4]},
    ]
    return Proof(exact_proof.folder, [header, claims, *steps, witness], lowest, exact_proof.eps_hi, exact_proof.point)


@pytest.fixture
def verdict(tmp_path: Path) -> Callable[[Lines, Path], Accepted]:
    """Check a certificate given as lines."""

    def judge(lines: Lines, folder: Path) -> Accepted:
        path = tmp_path / "certificate.jsonl"
        path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        return check(path, folder)

    return judge
