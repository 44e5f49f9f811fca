"""A robust claim stands by its certificates alone: every way to say more than they prove is refused."""

import json
import shutil
from itertools import combinations

import numpy as np
import pytest

import cpcal
from cpcal.checker import Refused, check, check_run
from cpcal.checker.files import Budget
from cpcal.checker.rule import hitting_set
from cpcal.files import load_campaign_json
from cpcal.simulate import simulate


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robust")
    made = simulate(seed=1, extremal=False, random_poses=14, factor=0.0, noise=0.02, joint_error=0.05)
    length = made.length.copy()
    length[3, 0] += 2.0
    campaign = cpcal.Campaign.of(made.robot, made.position, made.quaternion, length, pose=made.pose, exact=True)
    cpcal.save_result(cpcal.certify(campaign, outliers=1, legs=(1,), delta=5.0, certificates=folder), folder)
    return folder


@pytest.fixture
def copy(good, tmp_path):
    return shutil.copytree(good, tmp_path / "copy")


def changed(folder, change):
    path = folder / "result.json"
    value = json.loads(path.read_text())
    change(value, value["legs"][0]["bracket"])
    path.write_text(json.dumps(value))
    for certificate in folder.glob("*.cert.jsonl"):
        if certificate.name not in path.read_text():  # what lies beside is refused as well
            certificate.unlink()
    return check_run(folder)


def test_the_claim_as_written_is_accepted(good):
    (leg,) = check_run(good)
    assert leg.refused is None
    assert leg.robust.lo > 0
    assert len(leg.robust.left_out) == 1
    assert [name.split(".")[1] for name, _ in leg.proofs] == ["recommended", "passes"]
    assert all(len(of.chosen) == 13 and of.claims.point.factor == 1 for _, of in leg.proofs)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v, leg: leg.update(lo=leg["lo"] * 1.001), "eps_lo"),
        (lambda v, leg: leg.update(hi=leg["hi"] * 0.999), "eps_hi"),
        (lambda v, leg: leg["proofs"].pop(), "could spoil all of its proofs"),
        (lambda v, leg: leg.update(proofs=[leg["proofs"][0]] * 1000), "names a proof twice"),
        (lambda v, leg: leg["point"].__setitem__(0, leg["point"][0] + 1e-9), "point"),
        (lambda v, leg: leg.update(left_out=["r000/1"]), "measurements of the point"),
        (lambda v, leg: leg.update(left_out=[*leg["left_out"], "r000/1"]), "more than may be wrong"),
        (lambda v, leg: leg.update(left_out=[]), "measurements of the point"),
        (lambda v, leg: leg.update(left_out=["nobody"]), "a measurement that is none"),
        (lambda v, leg: leg["center"].__setitem__(0, leg["center"][0] + 1.0), "range of unknown 0"),
        (lambda v, leg: v["options"].update(delta=6.0), "range of unknown 0"),
        (lambda v, leg: v["model"].update(name="gain"), "model"),
        (lambda v, leg: leg["proofs"].append(leg["point_certificate"]), "eps_lo"),
        (lambda v, leg: leg["proofs"].append("../leg1.point.cert.jsonl"), "names no certificate"),
        (lambda v, leg: leg.pop("point"), "lacks the key"),
        (lambda v, leg: leg.update(center=None), "wrong kind"),
        (lambda v, leg: v["options"].update(eps=0.1), "another eps asked about"),
        (lambda v, leg: v["options"].update(outliers=0), "another proofs"),
        (lambda v, leg: leg.update(certificate=leg["point_certificate"]), "another certificate of all measurements"),
        (lambda v, leg: leg.update(status="proved"), "states status without a proof"),
    ],
)
def test_whatever_says_more_is_refused(copy, change, said):
    (leg,) = changed(copy, change)
    assert leg.refused is not None
    assert said in leg.refused


def test_a_recommendation_without_another_measurement_is_refused(copy):
    """Of the point's certificate nothing is left, so nothing else compares which measurement that is."""
    (copy / "leg1.point.cert.jsonl").unlink()

    def change(v, leg):
        unproved = {key: leg.pop(key) for key in ("hi", "point")} | {"left_out": ["r000/1"]}
        leg.pop("left_out")
        leg.update(point_certificate=None, information=leg["information"] | unproved)

    (leg,) = changed(copy, change)
    assert leg.refused == "states another measurements than is proved"


def test_a_measurement_that_is_left_out_twice_is_not_two(copy):
    def twice(v, leg):
        v["options"].update(outliers=2)
        leg.pop("lo")
        leg.update(proofs=[], left_out=2 * leg["left_out"])

    (leg,) = changed(copy, twice)
    assert "one twice" in (leg.refused or "")


def test_proofs_for_one_outlier_prove_nothing_for_two(copy):
    (leg,) = changed(copy, lambda v, leg: v["options"].update(outliers=2))
    assert leg.refused == "states a bound, but so many wrong measurements could spoil all of its proofs"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v, leg: v["options"].update(outliers=True), "another number of outliers"),
        (lambda v, leg: v["options"].update(outliers=14), "another number of outliers"),
        (lambda v, leg: v["options"].update(legs=[1, 2]), "another list of legs"),
        (lambda v, leg: v["model"].update(name="pl\u0430in"), "ASCII identifier"),
    ],
)
def test_a_claim_that_is_not_of_this_campaign_is_refused_as_a_whole(copy, change, said):
    with pytest.raises(Refused, match=rf"result\.json .*{said}"):
        changed(copy, change)


@pytest.mark.parametrize(
    ("proof", "numbers"), [("proofs", {"lo": 50.0}), ("point_certificate", {"hi": 1e-9, "left_out": []})]
)
def test_a_number_without_its_proof_is_refused(copy, proof, numbers):
    for path in copy.glob("leg1.0*.cert.jsonl" if proof == "proofs" else "leg1.point.cert.jsonl"):
        path.unlink()
    (leg,) = changed(copy, lambda v, leg: leg.update({**numbers, proof: [] if proof == "proofs" else None}))
    assert f"states {next(iter(numbers))} without a proof" in leg.refused
    with pytest.raises(cpcal.InputError, match="without a proof"):
        cpcal.load_result(copy)


@pytest.mark.parametrize(
    "names", [[("bad", "1")] * 10, [("a", "b/c"), ("a/b", "c")]], ids=["ten times", "by its sign /"]
)
def test_measurements_that_share_a_name_are_refused_by_both_readers(copy, names):
    """Ten wrong readings with one name were once left out as one."""
    path = copy / "campaign.json"
    value = json.loads(path.read_text())
    for row, name in zip(value["measurements"], names):  # noqa: B905 - the others keep theirs
        row[:2] = name
    path.write_text(json.dumps(value))
    shared = "/".join(names[0])
    with pytest.raises(Refused, match=f"two measurements have the name '{shared}'") as caught:
        check_run(copy)
    assert (caught.value.code, caught.value.line) == ("campaign", 0)
    said = "is given 10 times" if len(names) > 2 else "'b/c' cannot be a name"
    with pytest.raises(cpcal.InputError, match=said):
        load_campaign_json(path)


def test_proofs_that_take_long_to_meet_are_refused_within_the_budget():
    """Four hundred sets of forty numbers, of which any twelve may be wrong, took a minute at a limit of tries."""
    rng, budget = np.random.default_rng(1), Budget(2_000_000)
    family = [frozenset(rng.choice(400, 40, replace=False).tolist()) for _ in range(400)]
    with pytest.raises(Refused, match="more work than the 2000000") as caught:
        hitting_set(family, 12, budget.spend)
    assert caught.value.code == "limit"


def test_all_certificates_of_a_claim_have_one_budget(good):
    """What suffices for all but the last unit of work refuses the claim, and names no other reason."""
    spent = []

    def refused(work):
        (leg,) = check_run(good, work=work)
        spent.append(leg.refused)
        return leg.refused is not None

    low, high = 0, 1 << 24
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if refused(middle) else (low, middle)
    assert not refused(high)
    refused(high - 1)
    assert f"the check takes more work than the {high - 1} that it may cost" in spent[-1]
    for path in good.glob("*.cert.jsonl"):  # each by itself takes less
        check(path, work=high - 1)


def test_a_hitting_set_meets_every_set_and_none_is_missed():
    rng = np.random.default_rng(0)
    for _ in range(200):
        family = [
            frozenset(rng.choice(8, rng.integers(1, 5), replace=False).tolist()) for _ in range(rng.integers(0, 7))
        ]
        most = int(rng.integers(0, 4))
        found = hitting_set(family, most)
        possible = any(
            all(set(chosen) & one for one in family) for n in range(most + 1) for chosen in combinations(range(8), n)
        )
        assert (found is not None) == possible
        if found is not None:
            assert len(found) <= most
            assert all(found & one for one in family)
