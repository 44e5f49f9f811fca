"""True certificates are accepted by the standard library alone; what is written of a search, in order."""

import ast
import json
import shutil
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from fractions import Fraction as F
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.checker import ExactCampaign, Refused, check
from cpcal.checker.leg import At, Measurement
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Unknowns
from cpcal.files.folders import save_campaign_json
from cpcal.models import leg_statement
from cpcal.models.leg import leg_readings
from cpcal.questions import save_result
from cpcal.solver.certificate.exact_network import free, network_statement, number
from cpcal.solver.certificate.prover import claims
from cpcal.solver.certificate.recording import Recording, UncertifiedError, claims_of
from cpcal.solver.contract import Contraction, Limits
from cpcal.solver.interval import Box
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.search.search import Decision, Event, EventKind, Node
from tests.checker.proofs import all_readings
from tests.checker.valid.exact_legs import in_fractions, parts
from tests.networks import network

SMALL: dict[str, Any] = {"ask": {"delta": 2.0}, "extremal": False, "random_poses": 16, "joint_error": 10.0}


def test_handmade_certificates_are_accepted(verdict: Any, any_proof: Any) -> None:
    found, proof = verdict(any_proof.lines, any_proof.folder), any_proof
    claims = found.claims
    assert claims.eps_lo == F(proof.eps_lo) > 0
    assert claims.eps_hi == claims.cap == F(proof.eps_hi)
    assert not claims.infeasible
    assert claims.point.at == tuple(map(F, proof.point))
    assert (claims.point.holds, claims.point.fails) == (found.chosen, ())
    assert found.chosen == tuple(range(found.count))
    (lo, hi), at = claims.enclosure, claims.point.at
    assert all(a <= b <= x <= c <= d for a, b, x, c, d in zip(found.lo, lo, at, hi, found.hi, strict=True))
    assert found.steps == len(proof.lines) - proof.head - 1
    assert found.unknowns[found.objective] in ("eps", "t")
    assert found.used <= set(found.chosen)


def test_a_lower_bound_needs_no_point(verdict: Any, any_proof: Any) -> None:
    lines = any_proof.copy()
    claims = lines[any_proof.head]
    claims.update(enclosure=None, point=None)
    claims["epsilon"]["hi"] = None
    found = verdict(lines, any_proof.folder).claims
    assert (found.eps_lo, found.eps_hi, found.enclosure, found.point) == (F(any_proof.eps_lo), None, None, None)


@pytest.mark.parametrize("name", ["split_proof", "network_split_proof"])
def test_infeasible_below_a_cap(name: str, verdict: Any, request: pytest.FixtureRequest) -> None:
    """Everything is excluded there."""
    proof = request.getfixturevalue(name)
    lines = proof.copy()
    claims, split, exclude = lines[proof.head : proof.head + 3]
    at = split["at"]
    claims.update(cap=at, infeasible=True, epsilon={"lo": at, "hi": None}, enclosure=None, point=None)
    exclude.update(exclude=0, cap=at)
    found = verdict([*lines[: proof.head], claims, exclude], proof.folder)
    assert found.claims.infeasible
    assert found.claims.eps_lo == found.claims.cap == F(float.fromhex(at))


def test_only_the_measurements_with_weights(verdict: Any, exact_proof: Any) -> None:
    """Those and no others are needed for the lower bound; the point is judged by them alone."""
    lines, used = exact_proof.copy(), sorted(verdict(exact_proof.lines, exact_proof.folder).used)
    assert 2 <= len(used) < lines[0]["measurements"]
    lines[0]["only"] = used
    found = verdict(lines, exact_proof.folder)
    assert found.chosen == found.claims.point.holds == tuple(used)
    assert (found.used, found.count) == (set(used), 12)
    assert found.claims.eps_lo == F(exact_proof.eps_lo)
    lines[0]["only"] = list(range(12))
    named, stated = verdict(lines, exact_proof.folder), verdict(exact_proof.lines, exact_proof.folder)
    assert replace(named, header=stated.header) == stated


def test_a_point_meets_a_measurement_from_the_eps_on_that_fractions_say_to_80_bits(exact_proof: Any) -> None:
    campaign, (*x, _) = ExactCampaign(exact_proof.folder / "campaign.json"), map(F, exact_proof.point)

    def met(model: str, rows: list[int], *point: F) -> bool:
        return not list(campaign.unmet(1, At(Unknowns(ExactBox(point, point), free), model, None), rows))

    for model, extra in (("plain", []), ("gain", [F(1, 1024)]), ("lateral", [F(-77)])):
        for k in range(12):
            square, length = parts(in_fractions(campaign.measurement(k, 1)), model, x + extra, [F(0)] * 7)
            least = abs(F(isqrt((square * 2**160).__floor__()), 2**80) - length)
            assert [met(model, [k], *x, *extra, least + F(side, 2**79)) for side in (-1, 1)] == [False, True]
    most = campaign.shortest(1) + x[6]
    assert [met("gain", [*range(12)], *x, F(1), most + more) for more in (0, 1)] == [True, False]


def test_the_largest_numbers_and_degrees(verdict: Any, network_proof: Any) -> None:
    lines = network_proof.copy()
    lines[1]["body"].append([[0] * 8, "0x" + "0" * 64 + "." + "0" * 64 + "p+1100"])
    lines[-1]["bounds"][0][3]["products"].append([0, 0, -1, 1, 0])
    lines[-1]["bounds"][0][3]["tangents"].append([0, "0x1p-1100", 0])
    assert verdict(lines, None).claims == verdict(network_proof.lines, None).claims
    weights = {"rows": [[0, (1 << 60) - 1]], "products": [], "tangents": [], "exponents": [999, -1000, -1000]}
    lines[-1].update(rows=[["upper", 0]], bounds=[[0, "lo", "-0x1p+1100", weights]])
    lines[network_proof.head].update(epsilon=None, enclosure=None)
    assert verdict(lines, None).used == {0}


@pytest.mark.parametrize("model", ["gain", "lateral"])
def test_whole_proofs_of_models(certified: Any, model: str) -> None:
    """Of uncertain readings; the result says what they prove, the checker alone as well."""
    ask = {"delta": 2.0, "model": model}
    made = certified(ask, factor=1.0, extremal=False, random_poses=24, joint_error=10.0)
    found = check(made.path)
    assert found.model == model
    assert (found.claims.eps_lo, found.claims.eps_hi) == (made.leg.bracket.lo, made.leg.bracket.hi)
    assert 0 < found.claims.eps_lo < found.claims.eps_hi < found.claims.eps_lo + F(1, 1000)


def bare(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The checker's folder alone, copied into an empty one under another name, by a bare Python."""
    copy = folder / "proofreader"
    shutil.copytree(Path(cpcal.__file__).parent / "checker", copy, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-I", "-S", "-B", str(copy), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=folder)


def alone(found: Any, path: Path, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    done = bare(folder, path)
    assert done.returncode == 0, done.stderr
    assert f"eps >= {float(found.claims.eps_lo):.6f}"[:-1] in done.stdout


def test_a_whole_run_is_accepted_by_the_folder_alone(certified: Any, tmp_path: Path) -> None:
    made = certified(factor=3.0, **SMALL)
    shutil.copytree(made.path.parent, tmp_path / "moved")
    save_result(made.result, tmp_path / "moved")
    done = bare(tmp_path, tmp_path / "moved")
    assert done.returncode == 0, done.stderr
    assert "leg 1: PROVED" in done.stdout


def test_the_checker_imports_nobody() -> None:
    for path in (Path(cpcal.__file__).parent / "checker").glob("*.py"):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                assert all(name.name.split(".")[0] in sys.stdlib_module_names for name in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 1 or str(node.module).split(".")[0] in sys.stdlib_module_names


# the same numbers from the campaign in memory -----------------------------------------------------------------------


@pytest.mark.parametrize("overrides", [False, True])
@pytest.mark.parametrize("factor", [0.0, 2.5])
def test_campaigns_in_memory_and_in_files_say_the_same(tmp_path: Path, factor: float, overrides: bool) -> None:
    campaign = cpcal.simulate(seed=9, extremal=False, random_poses=7, factor=factor)
    rng = np.random.default_rng(3)
    radii = {name: getattr(campaign, name) for name in ("position_radius", "rotation_radius", "length_radius")}
    if overrides:
        radii = {name: v + rng.uniform(0, 0.1, v.shape) * (rng.random(v.shape) < 0.5) for name, v in radii.items()}
    scale = 1 + rng.uniform(-9e-7, 9e-7, (7, 1))
    quaternion = campaign.quaternion * scale
    odd = cpcal.Campaign.of(campaign.robot, campaign.position, quaternion, campaign.length, **radii)
    cpcal.save_campaign(odd, tmp_path / "odd")
    loaded = cpcal.load_campaign(tmp_path / "odd")
    file = save_campaign_json(loaded, tmp_path)
    for leg in (1, 4, 6):
        files, statement = ExactCampaign(file), leg_statement(loaded, leg)
        assert statement.head["campaign"] == files.sha256
        assert statement.problem.count == len(files) == 7
        for k in range(7):
            ours = in_fractions(Measurement(*(part[k].tolist() for part in leg_readings(loaded, leg))))
            assert ours == in_fractions(files.measurement(k, leg))
            assert any(ours.radii[:3]) == (factor > 0 or overrides) or overrides
    if overrides:
        assert "dL3" in (tmp_path / "odd" / "measurements.csv").read_text().splitlines()[0]


def test_a_point_for_all_readings_has_the_values_of_its_forms(uncertain_proof: Any, verdict: Any) -> None:
    """A form is no measurement: it has no readings, and the point must have its value exactly."""
    every = all_readings(uncertain_proof.problem, uncertain_proof.point[:-1])
    at = [number(v) for v in (*uncertain_proof.point[:-1], every.least_eps())]
    form = [[[0], "0x1p+0"]]  # a_x
    head = uncertain_proof.lines[0] | {"lo": at, "hi": at, "forms": [form]}
    for more, holds in ((0.0, True), (0.5, False)):
        x = [*at, number(uncertain_proof.point[0] + more)]
        point = {"at": x, "holds": "all", "readings": None, "factor": "0x1p+0", "fails": []}
        claims = {"cap": at[-1], "infeasible": False, "epsilon": None, "enclosure": None, "point": point}
        if holds:
            assert verdict([head, claims], uncertain_proof.folder).claims.point is not None
        else:
            count = uncertain_proof.problem.count
            with pytest.raises(Refused, match=f"satisfies measurement {count} for all readings"):
                verdict([head, claims], uncertain_proof.folder)


def problem() -> cpcal.Network:
    net, x, eps = network(x=(-4, 4), eps=(0, 8))
    net.add([x * x <= 1 + eps])
    return net


def split(node: Node, name: str, at: float, serial: int) -> Event:
    parts = node.box.replace(name, hi=at), node.box.replace(name, lo=at)
    children = tuple(Node(box, node.depth + 1, serial + k) for k, box in enumerate(parts))
    return Event(node, Decision(EventKind.SPLIT, Contraction(node.box)), children)


def test_steps_on_boxes_above_the_claim_are_left_out(tmp_path: Path) -> None:
    net = problem()
    with Recording(network_statement(net, "eps"), net.domain) as recording:
        first = split(Node(net.domain, 0, 0), "eps", 4.0, 1)
        low, high = first.children
        second = split(high, "x", 0.0, 3)  # of no use once the objective need not reach 4
        third = split(low, "x", 0.5, 5)
        for event in (first, second, third):
            recording.event(event)
        path = recording.write(tmp_path / "c.jsonl", claims(2.0, point=np.array([1.0, 0.0])))
    steps = [json.loads(line) for line in path.read_text().splitlines()[2 + len(net.constraints) :]]
    assert [(step["split"], step["into"]) for step in steps] == [(0, [1, 2]), (1, [3, 4])]
    assert steps[1]["unknown"] == 0
    assert check(path).claims.point is not None


def test_steps_that_are_too_large_for_the_checker_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search goes on without them, and what is written is accepted by a checker with these limits."""
    for most, least in ((500_000, 2.9), (3, 0.0)):
        monkeypatch.setattr("cpcal.checker.polynomial.MOST_HELD", most)
        net, x, eps = network(x=(-1, 1), eps=(0, 8))
        net.add([x * x >= 4 - eps])
        found = net.minimize(eps, limits=cpcal.Limits(nodes=1), certificate=tmp_path / "c.jsonl")
        assert float(check(tmp_path / "c.jsonl").claims.eps_lo) == found.lo
        assert least <= found.lo <= 3.0 * (least > 0)


def test_steps_are_not_kept_in_memory() -> None:
    """Three thousand of them, of 200 bytes and more, take less than a third of that."""
    net = problem()
    with Recording(network_statement(net, "eps"), net.domain) as recording:
        node, serial = Node(net.domain, 0, 0), 1
        tracemalloc.start()
        for k in range(1_200):
            if k == 200:
                tracemalloc.reset_peak()
                before = tracemalloc.get_traced_memory()[0]
            event = split(node, "x", float(node.box.lo[0] + node.box.hi[0]) / 2 if k % 2 else 0.0, serial)
            recording.event(event)
            serial += 2
            for child in event.children:  # both are excluded: the tree stays narrow
                recording.event(Event(child, Decision(EventKind.PRUNED, Contraction(Box.empty(net.names)))))
            node = Node(net.domain, 0, serial)
            serial += 1
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak - before < 200_000


def test_a_certificate_that_cannot_be_written_does_not_lose_the_answer(tmp_path: Path) -> None:
    net = problem()
    (tmp_path / "c.jsonl").mkdir()  # in the way
    with pytest.raises(UncertifiedError, match="regular file") as raised:
        net.minimize(net.variables[1], certificate=tmp_path / "c.jsonl")
    assert raised.value.answer.lo <= 0.0 <= raised.value.answer.hi


def test_a_search_that_found_no_point_yet_does_not_claim_that_there_is_none() -> None:
    net = problem()
    states = minimize(net, "eps", [("hc4", HC4(net))], limits=Limits(nodes=1))
    nothing = replace(run(states, None), witness=None, hi=np.inf)
    for lo, infeasible in ((0.25, False), (np.inf, True)):
        claims = claims_of(replace(nothing, lo=lo), net.domain, "eps")
        assert claims["infeasible"] == infeasible
        assert claims["point"] is None
