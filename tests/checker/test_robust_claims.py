"""A robust claim stands by its certificates alone: every way to say more than they prove is refused."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import cpcal
from cpcal.certify.certify_robust import certify_robust
from cpcal.checker import Refused
from cpcal.checker.robust_claim import check_robust, meeting
from cpcal.results.robust import load_robust
from cpcal.simulate import simulate


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robust")
    made = simulate(seed=1, extremal=False, random_poses=14, factor=0.0, noise=0.02, joint_error=0.05)
    length = made.length.copy()
    length[3, 0] += 2.0
    campaign = cpcal.Campaign.of(made.robot, made.position, made.quaternion, length, pose=made.pose, exact=True)
    certify_robust(campaign, outliers=1, legs=(1,), delta=5.0, certificates=folder)
    return folder


@pytest.fixture
def copy(good, tmp_path):
    return shutil.copytree(good, tmp_path / "copy")


def changed(folder, change):
    path = folder / "robust.json"
    value = json.loads(path.read_text())
    change(value, value["legs"][0])
    path.write_text(json.dumps(value))
    return check_robust(folder)


def test_the_claim_as_written_is_accepted(good):
    (leg,) = check_robust(good)
    assert leg.refused is None
    assert leg.lo > 0
    assert len(leg.left_out) == 1


def _set(**values):
    return lambda value, leg: leg.update(values)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v, leg: leg.update(eps_lo=leg["eps_lo"] * 1.001), "eps_lo"),
        (lambda v, leg: leg.update(eps_hi=leg["eps_hi"] * 0.999), "eps_hi"),
        (lambda v, leg: leg["proofs"].pop(), "could spoil all of its proofs"),
        (lambda v, leg: leg.update(proofs=[leg["proofs"][0]] * 3), "names a proof twice"),
        (lambda v, leg: leg["point"].__setitem__(0, leg["point"][0] + 1e-9), "point"),
        (lambda v, leg: leg.update(left_out=["r000/1"]), "measurements of the point"),
        (lambda v, leg: leg.update(left_out=[*leg["left_out"], "r000/1"]), "measurements of the point"),
        (lambda v, leg: leg.update(left_out=["nobody"]), "measurement left out"),
        (lambda v, leg: leg["center"].__setitem__(0, leg["center"][0] + 1.0), "range of unknown 0"),
        (lambda v, leg: v["options"].update(delta=6.0), "range of unknown 0"),
        (lambda v, leg: v["model"].update(name="gain"), "model"),
        (lambda v, leg: leg["proofs"].append(leg["point_certificate"]), "eps_lo"),
        (lambda v, leg: leg["proofs"].append("../leg1.point.cert.jsonl"), "names no certificate"),
        (lambda v, leg: leg.pop("point"), "lacks the key"),
        (lambda v, leg: leg.update(center=None), "wrong kind"),
    ],
)
def test_whatever_says_more_is_refused(copy, change, said):
    (leg,) = changed(copy, change)
    assert leg.refused is not None
    assert said in leg.refused


@pytest.mark.parametrize(
    "change",
    [
        lambda v, leg: (v.update(outliers=2), leg.update(outliers=2)),  # the proofs are for one
    ],
)
def test_proofs_for_fewer_outliers_prove_nothing_for_more(copy, change):
    (leg,) = changed(copy, change)
    assert leg.refused is not None or leg.lo is None


@pytest.mark.parametrize(
    "change",
    [
        lambda v, leg: v["campaign"].update(sha256="0" * 64),
        lambda v, leg: v["campaign"].update(measurements=15),
        lambda v, leg: v.update(outliers=True),
        lambda v, leg: v.update(outliers=0),
        lambda v, leg: v["legs"].append(leg),
        lambda v, leg: v.update(format="cpcal-robust/1"),
        lambda v, leg: v["campaign"].update(robot="another"),
        lambda v, leg: v["options"].update(legs=[1, 2]),
        lambda v, leg: v["options"].update(eps=0.1),
        lambda v, leg: v["model"].update(name="pl\u0430in"),
        lambda v, leg: leg.update(leg=2),
    ],
)
def test_a_claim_that_is_not_of_this_campaign_is_refused_as_a_whole(copy, change):
    with pytest.raises(Refused):
        changed(copy, change)


@pytest.mark.parametrize(
    ("proof", "numbers"), [("proofs", {"eps_lo": 50.0}), ("point_certificate", {"eps_hi": 1e-9, "left_out": []})]
)
def test_a_number_without_its_proof_is_refused(copy, proof, numbers):
    for path in copy.glob("leg1.0*.cert.jsonl" if proof == "proofs" else "leg1.point.cert.jsonl"):
        path.unlink()
    (leg,) = changed(copy, lambda v, leg: leg.update({**numbers, proof: [] if proof == "proofs" else None}))
    assert f"states {next(iter(numbers))} without a proof" in leg.refused
    with pytest.raises(cpcal.InputError, match="without a proof"):
        load_robust(copy)


def test_a_damaged_certificate_is_refused(copy):
    path = next(copy.glob("leg1.0*.cert.jsonl"))
    path.write_text(path.read_text()[:-200])
    (leg,) = check_robust(copy)
    assert leg.refused is not None


def test_what_meets_all_proofs_is_found_exactly():
    rng = np.random.default_rng(3)
    for _ in range(200):
        family = [
            frozenset(rng.choice(7, rng.integers(1, 4), replace=False).tolist()) for _ in range(rng.integers(1, 6))
        ]
        for most in range(3):
            from itertools import combinations

            expected = any(
                all(set(c) & one for one in family) for n in range(most + 1) for c in combinations(range(7), n)
            )
            assert meeting(family, most) == expected
