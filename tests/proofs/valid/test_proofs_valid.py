"""True certificates are accepted, and nothing but the standard library is needed to accept them."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

import cpcal
from cpcal.proof.checker import check
from cpcal.prove import write_certificate

SMALL: dict[str, Any] = {"extremal": False, "random_poses": 10}

ALONE = """
import sys, types
blocked = ("numpy", "scipy", "ortools", "flint", "jinja2", "gmpy2")
for name in blocked:
    sys.modules[name] = None
parent = types.ModuleType("cpcal")
parent.__path__ = [sys.argv[1]]
sys.modules["cpcal"] = parent
from pathlib import Path
from cpcal.proof.checker import check
found = check(Path(sys.argv[2]), Path(sys.argv[3]))
ours = sorted(name for name in sys.modules if name.split(".")[0] == "cpcal")
theirs = [n for n in sys.modules if n.split(".")[0] not in sys.stdlib_module_names and n.split(".")[0] != "cpcal"]
assert set(theirs) <= {"__main__", "__mp_main__", *blocked}, theirs
print(ours, float(found.eps_lo).hex(), float(found.eps_hi).hex())
"""


@pytest.mark.parametrize("factor", [0.0, 3.0])
@pytest.mark.parametrize("joint_error", [0.0, 1.0, 10.0])
def test_certificates_of_simulated_campaigns_are_accepted(certified: Any, factor: float, joint_error: float) -> None:
    made = certified(factor=factor, joint_error=joint_error, **SMALL)
    leg, found = made.leg, check(made.path, made.folder)
    assert found.leg == 1
    assert found.measurements == 10
    assert found.steps >= 1
    assert found.eps_hi == F(leg.eps_hi)
    assert found.eps_lo <= found.eps_hi
    assert float(found.eps_hi - found.eps_lo) <= 1e-6 * max(1.0, leg.eps_hi) + 2 * (leg.eps_hi - leg.eps_lo)
    assert found.enclosure is not None
    assert leg.point is not None
    for lo, value, hi in zip(found.enclosure[0], leg.point, found.enclosure[1], strict=True):
        assert lo <= F(float(value)) <= hi
    for a, b, c, d in zip(found.lo, *found.enclosure, found.hi, strict=True):
        assert a <= b <= c <= d


def test_consistent_uncertain_readings_prove_zero(certified: Any) -> None:
    made = certified(factor=3.0, joint_error=0.0, **SMALL)
    found = check(made.path, made.folder)
    assert found.eps_lo == found.eps_hi == 0


def test_all_extremal_poses(certified: Any) -> None:
    made = certified(factor=0.0, joint_error=10.0)
    found = check(made.path, made.folder)
    assert found.measurements == 64
    assert found.eps_lo > 4.8
    assert float(found.eps_hi - found.eps_lo) < 1e-5


def test_one_pose_repeated_64_times(tmp_path: Path) -> None:
    """Rank deficient: nothing but the length of one arm is determined, and still what is claimed is proved."""
    few = cpcal.simulate(seed=3, extremal=False, random_poses=1, runs=64, factor=0.0)
    cpcal.save_campaign(few, tmp_path)
    campaign = cpcal.load_campaign(tmp_path)
    result = cpcal.certify(campaign, legs=[1], delta=10.0, gap=1e-3, time_limit=3.0)
    leg = result.legs[0]
    if leg.point is None or leg.verdict is not cpcal.Verdict.PROVED:
        pytest.skip("no proved bracket for the repeated pose in 3 s")
    found = check(write_certificate(campaign, tmp_path, result, leg, tmp_path / "leg.jsonl"), tmp_path)
    assert found.measurements == 64
    assert 0 <= found.eps_lo <= found.eps_hi == F(leg.eps_hi)


def test_handmade_certificates_are_accepted(
    verdict: Any, exact_proof: Any, uncertain_proof: Any, split_proof: Any
) -> None:
    for proof in (exact_proof, uncertain_proof, split_proof):
        found = verdict(proof.lines, proof.folder)
        assert found.eps_lo == F(proof.eps_lo) > 0
        assert found.eps_hi == F(proof.eps_hi)


def test_keys_in_any_order(verdict: Any, split_proof: Any) -> None:
    lines = [dict(reversed(line.items())) for line in split_proof.lines]
    assert verdict(lines, split_proof.folder).eps_lo == F(split_proof.eps_lo)


def test_a_lower_bound_needs_no_witness(verdict: Any, exact_proof: Any) -> None:
    lines = exact_proof.copy()[:-1]
    lines[1].update(eps_hi=None, enclosure=None)
    found = verdict(lines, exact_proof.folder)
    assert found.eps_hi is None
    assert found.enclosure is None
    assert found.eps_lo == F(exact_proof.eps_lo)


def test_infeasible_below_a_cap(verdict: Any, split_proof: Any) -> None:
    """No open box remains below the cap: everything is excluded there."""
    header, claims, split, exclude = split_proof.copy()[:4]
    at = split["at"]
    header["cap"] = at
    claims.update(cap=at, eps_lo=at, enclosure=None, eps_hi=None)
    exclude.update(exclude=0, cap=at)
    assert verdict([header, claims, exclude], split_proof.folder).eps_lo == F(float.fromhex(at))


def test_the_checker_needs_the_standard_library_only(certified: Any) -> None:
    made = certified(factor=3.0, joint_error=10.0, **SMALL)
    package = str(Path(cpcal.__file__).parent)
    command = [sys.executable, "-I", "-S", "-c", ALONE, package, str(made.path), str(made.folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found = check(made.path, made.folder)
    assert found.eps_hi is not None
    assert float(found.eps_lo).hex() in done.stdout
    assert float(found.eps_hi).hex() in done.stdout
    assert "cpcal.proof.writer" not in done.stdout
