"""True certificates of small problems, whole ones and one step by step, for the tests to believe and to forge."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from cpcal.checker import Accepted, check
from cpcal.files.folders import CAMPAIGN_NAME, save_campaign_json
from cpcal.models import leg_box, leg_model, leg_network, leg_statement
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.interval import Box
from tests.checker.proofs import Lines, Proof, halved, short
from tests.checker.second import Second, encoded, second_checker


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
            known[name] = Certified(folder, folder / "run" / str(result.legs[0].bracket.certificate), result)
        return known[name]

    return make


def _leg_proof(folder: Path, name: str = "plain", **options: Any) -> Proof:
    """In a small box about the best point: bounds on eps and two other unknowns."""
    campaign, model = saved(folder, **options), leg_model(name)
    leg = cpcal.certify(campaign, legs=[1], delta=20.0, model=name).legs[0]
    assert leg.bracket.point is not None
    box = leg_box(np.asarray(leg.bracket.point), 1e-2)
    extra = np.array(leg.bracket.point[7:])
    small = 1e-4 * model.half_widths
    box = Box(model.parameters, np.append(box.lo, extra - small), np.append(box.hi, extra + small))
    network = leg_network(campaign, 1, box, eps=(0.0, leg.bracket.hi), model=model)
    return short(folder, leg_statement(campaign, 1, model=name), network, "eps", (*leg.bracket.point, leg.bracket.hi))


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


@pytest.fixture
def checked(tmp_path: Path) -> Callable[[bytes, Path | None], Accepted]:
    """Check the bytes of a certificate, by the campaign.json in a folder."""

    def checked_bytes(content: bytes, folder: Path | None) -> Accepted:
        path = tmp_path / "certificate.jsonl"
        path.write_bytes(content)
        return check(path, None if folder is None else folder / CAMPAIGN_NAME)

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
