"""A run that was tampered with, or states what its true certificates do not, is refused, leg by leg or as a whole."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

import cpcal
from cpcal.checker import ExactCampaign, Refused, Unusable, check, check_run
from cpcal.checker.__main__ import PROVED, REFUSED, UNUSABLE, main
from cpcal.checker.files import parsed
from cpcal.checker.run import _Leg, certificates_of
from cpcal.questions import save_result
from tests.changed import put

Data = dict[str, Any]


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two legs with certificates."""
    folder = tmp_path_factory.mktemp("run")
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=16, joint_error=10.0, factor=1.0)
    save_result(cpcal.certify(campaign, legs=[1, 2], delta=2.0, certificates=folder), folder)
    return folder


@pytest.fixture
def run(honest: Path, tmp_path: Path) -> Path:
    shutil.copytree(honest, tmp_path / "run")
    return tmp_path / "run"


def test_an_honest_run_is_proved_wherever_it_is_moved(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    legs = check_run(run)
    assert [leg.leg for leg in legs] == [1, 2]
    assert all(leg.proofs and leg.refused is None for leg in legs)
    assert main([str(run)]) == PROVED
    assert capsys.readouterr().out.count("PROVED") == 2


def up(value: float) -> float:
    return math.nextafter(value, math.inf)


def changed(*path: Any, to: Any) -> Callable[[Data, Path], None]:
    """The tampering that puts `to`, or what it makes of the old value, at a path of result.json."""
    return lambda data, run: put(*path, to=to)(data)


def of_certificate(line: int, *path: Any, to: Any) -> Callable[[Data, Path], None]:
    def change(data: Data, run: Path) -> None:
        file = run / "leg1.cert.jsonl"
        lines = [json.loads(text) for text in file.read_text().splitlines()]
        put(line, *path, to=to)(lines)
        file.write_text("".join(json.dumps(value) + "\n" for value in lines))

    return change


def uncertified(leg: Data) -> None:
    """A leg as it is written without a certificate: nothing stands outside of the information that needs one."""
    of, proved = leg["bracket"], ("status", "lo", "hi", "point", "center", "enclosure")
    of["information"] |= {key: of.pop(key) for key in proved}
    of["certificate"] = None


def swapped(data: Data, run: Path) -> None:
    (run / "leg1.cert.jsonl").rename(run / "x")
    (run / "leg2.cert.jsonl").rename(run / "leg1.cert.jsonl")
    (run / "x").rename(run / "leg2.cert.jsonl")


def of_campaign(change: Callable[[Data], object]) -> Callable[[Data, Path], None]:
    def tampered(data: Data, run: Path) -> None:
        campaign = json.loads((run / "campaign.json").read_text())
        change(campaign)
        (run / "campaign.json").write_text(json.dumps(campaign))

    return tampered


LEG = ("legs", 0)
OF = (*LEG, "bracket")
TAMPERED: dict[str, Callable[[Data, Path], object]] = {
    "eps_lo up": changed(*OF, "lo", to=up),
    "eps_lo true": changed(*OF, "lo", to=True),
    "eps_lo null": changed(*OF, "lo", to=None),
    "eps_hi down": changed(*OF, "hi", to=lambda v: math.nextafter(v, 0.0)),
    "eps_hi infinite": changed(*OF, "hi", to="inf"),
    "the point shorter": changed(*OF, "point", to=lambda v: v[:-1]),
    "an empty point": changed(*OF, "point", to=[]),
    "the enclosure larger": changed(*OF, "enclosure", "hi", 0, to=up),
    "no enclosure": changed(*OF, "enclosure", "lo", to=None),
    "the center moved": changed(*OF, "center", 0, to=lambda v: v + 1e-6),
    "a larger box": changed("options", "delta", to=100.0),
    "a smaller box": changed("options", "delta", to=1.0),
    "another question": changed("options", "eps", to=0.0),
    "refuted": changed(*OF, "status", to="refuted"),
    "the other leg's number": changed(*LEG, "leg", to=2),
    "a leg twice": changed("legs", to=lambda legs: [legs[0], *legs]),
    "legs in another order of numbers": changed("legs", to=lambda legs: [{**legs[0], "leg": 2}, {**legs[1], "leg": 1}]),
    "a leg left out": changed("legs", to=lambda legs: legs[:1]),
    "no legs": changed("legs", to=[]),
    "legs that are none": changed("legs", to=[1]),
    "support of one twice": changed(*LEG, "information", "support", to=lambda v: [v[0], v[0]]),
    "not certified, with a certificate": lambda data, run: uncertified(data["legs"][0]),
    "a point by a certificate of its own": changed(*OF, "point_certificate", to="leg1.cert.jsonl"),
    "proofs of its own": changed(*OF, "proofs", to=["leg1.cert.jsonl"]),
    "no number may be wrong": changed("options", "outliers", to=False),
    "certificate left out": lambda data, run: data["legs"][0]["bracket"].pop("certificate"),
    "a model of other letters": changed("model", "name", to="pl\u0430in"),
    "the other leg's certificate": changed(*OF, "certificate", to="leg2.cert.jsonl"),
    "a certificate elsewhere": changed(*OF, "certificate", to="../leg1.cert.jsonl"),
    "a user-defined model": changed("model", "name", to="own"),
    "a certificate deleted": lambda data, run: (run / "leg1.cert.jsonl").unlink(),
    "certificates swapped": swapped,
    "a certificate beside": lambda data, run: shutil.copy(run / "leg1.cert.jsonl", run / "leg3.cert.jsonl"),
    "the claim of the certificate too": of_certificate(1, "epsilon", "lo", to="0x1p+0"),
    "a certificate that claims less": of_certificate(1, "enclosure", to=None),
    "a certificate of some measurements": of_certificate(0, "only", to=list(range(15))),
    "a reading of the campaign": of_campaign(lambda c: c["measurements"][0].__setitem__(9, "100.0")),
    "no measurements in the campaign": of_campaign(lambda c: c.update(measurements=[])),
}


def refused(run: Path) -> str:
    """Why the run, or a leg of it, is refused."""
    try:
        legs = check_run(run)
    except Refused as reason:
        return str(reason)
    return "; ".join(leg.refused for leg in legs if leg.refused is not None)


@pytest.mark.parametrize("name", TAMPERED)
def test_tampering_is_refused(name: str, run: Path) -> None:
    data = json.loads((run / "result.json").read_text())
    before = json.dumps(data)
    TAMPERED[name](data, run)
    if json.dumps(data) != before:
        (run / "result.json").write_text(json.dumps(data))
    reason = refused(run)
    assert reason
    assert reason.isascii()
    assert len(reason) < 300
    assert main([str(run)]) == REFUSED


CONTENTS = (b"", b"{}", b"[]", b"null", b'{"format": "cpcal-result/14"}', b"\xff", b"[" * 100_000, b'{"a": 1e999}',
            b'{"format": "cpcal-result/14", "legs": ' + b"9" * 5000 + b"}", b'{"format": 1, "format": 1}')  # fmt: skip


@pytest.mark.parametrize("content", CONTENTS, ids=range(len(CONTENTS)))
def test_results_that_are_none_are_refused(content: bytes, run: Path) -> None:
    (run / "result.json").write_bytes(content)
    assert refused(run).startswith("result.json ")


@pytest.mark.parametrize("name", ["result.json", "campaign.json"])
def test_a_missing_file_is_nothing_to_check(name: str, run: Path) -> None:
    (run / name).unlink()
    with pytest.raises(Unusable, match=name):
        check_run(run)
    assert main([str(run)]) == UNUSABLE
    (run / name).mkdir()
    assert main([str(run)]) == UNUSABLE


def test_a_folder_that_there_is_not(tmp_path: Path) -> None:
    assert main([str(tmp_path / "nowhere")]) == UNUSABLE


def test_a_leg_is_refuted_at_any_eps_only_above_its_shortest_length(honest: Path) -> None:
    """No leg is longer than eps from min(L - lambda) + the upper end of l on; a cap just below excludes less."""
    campaign, accepted = ExactCampaign(honest / "campaign.json"), check_run(honest)[0].proofs[0][1]
    assert accepted is not None
    rows = json.loads((honest / "campaign.json").read_text())["measurements"]
    shortest, offset = min(F(float(row[9])) - F(float(row[21])) for row in rows), accepted.hi[6]
    assert accepted.lo[6] < offset
    certificates, result = certificates_of(honest), {"options": {"eps": None}}
    for cap, refuted in (
        (shortest + offset, True),
        (shortest + offset - F(1, 2**60), False),
        (shortest + accepted.lo[6], False),
        (shortest, shortest >= shortest + offset),
    ):
        claims = replace(accepted.claims, cap=cap, infeasible=True, point=None)
        found = _Leg(certificates, campaign, result, {"leg": 1}).lowest(replace(accepted, claims=claims))
        assert found == (refuted, "inf" if refuted else accepted.claims.eps_lo)


def test_a_leg_that_says_so_is_not_certified(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is neither proved nor refused; with no leg proved there is nothing to check."""
    data = json.loads((run / "result.json").read_text())
    uncertified(data["legs"][1])
    (run / "result.json").write_text(json.dumps(data))
    (run / "leg2.cert.jsonl").unlink()
    one, two = check_run(run)
    assert one.proofs
    assert two.refused is None
    assert not [name for name, _ in two.proofs if name == "leg2.cert.jsonl"]
    assert main([str(run)]) == PROVED
    assert "leg 2: PROVED: leg2.recommended.cert.jsonl: " in capsys.readouterr().out
    uncertified(data["legs"][0])
    (run / "result.json").write_text(json.dumps(data))
    for leg in data["legs"]:
        leg |= dict.fromkeys(("recommended", "passes_from"))
    (run / "result.json").write_text(json.dumps(data))
    for certificate in run.glob("*.cert.jsonl"):
        certificate.unlink()
    assert main([str(run)]) == UNUSABLE


@pytest.mark.parametrize("eps", [0.1, 2.0])
def test_runs_that_asked_for_one_eps(eps: float, tmp_path: Path) -> None:
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=16, joint_error=10.0, factor=0.0)
    save_result(cpcal.certify(campaign, legs=[1], delta=2.0, eps=eps, certificates=tmp_path), tmp_path)
    (leg,) = check_run(tmp_path)
    assert leg.proofs, leg.refused
    data = json.loads((tmp_path / "result.json").read_text())
    data["options"]["eps"] = up(eps)
    (tmp_path / "result.json").write_text(json.dumps(data))
    assert refused(tmp_path)


@pytest.mark.parametrize("side", [-0.5, 0.5])
def test_a_box_that_is_wider_on_one_side_alone_is_refused(run: Path, side: float) -> None:
    data = json.loads((run / "result.json").read_text())
    data["options"]["delta"] += abs(side)
    for leg in data["legs"]:
        leg["bracket"]["center"] = [c + side for c in leg["bracket"]["center"]]
    (run / "result.json").write_text(json.dumps(data))
    assert all("range of unknown 0" in (leg.refused or "") for leg in check_run(run))


def test_a_bracket_that_is_wider_than_the_gap_is_not_closed(tmp_path: Path) -> None:
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=16, joint_error=10.0, factor=1.0)
    save_result(cpcal.certify(campaign, legs=[1], delta=20.0, gap=0.5, certificates=tmp_path), tmp_path)
    assert [leg.refused for leg in check_run(tmp_path)] == [None]
    data = json.loads((tmp_path / "result.json").read_text())
    data["options"]["information"]["gap"] = 1e-3
    (tmp_path / "result.json").write_text(json.dumps(data))
    assert ["status" in (leg.refused or "") for leg in check_run(tmp_path)] == [True]


@pytest.mark.parametrize("side", ["lo", "hi"])
def test_a_point_beyond_the_box_of_its_leg_is_none_of_it(run: Path, side: str) -> None:
    data = parsed((run / "result.json").read_bytes(), float)
    leg, campaign = data["legs"][0], ExactCampaign(run / "campaign.json")
    accepted = check_run(run)[0].proofs[0][1]
    assert accepted is not None
    assert accepted.claims.point is not None
    asked = _Leg(certificates_of(run), campaign, data, leg)
    for k in range(7):
        ends = list(getattr(accepted, side))
        ends[k] = accepted.claims.point.at[k] + (1 if side == "lo" else -1)
        beyond = replace(accepted, **{side: tuple(ends)})
        assert {what: due for what, _, due in asked.of_the_bracket(leg["bracket"], beyond)}["eps_hi"] == "inf"


@pytest.fixture(scope="session")
def stating(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A leg with a certificate of each kind: of its bracket, ranges, and of what is met by all readings."""
    folder = tmp_path_factory.mktemp("stating")
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=16, joint_error=1.0, factor=0.5)
    asked = {"legs": [1], "delta": 2.0, "support": "none", "ranges": True, "tolerance": 0.1537}
    save_result(cpcal.certify(campaign, certificates=folder, **asked), folder)
    return folder


def as_in(name: str, *keys: str) -> Callable[[Data, Path], None]:
    """Claims that are those of another certificate of the run, and as true."""

    def change(claims: Data, run: Path) -> None:
        other = json.loads((run / name).read_text().splitlines()[1])
        claims.update({key: other[key] for key in keys})

    return change


def wider(claims: Data, run: Path) -> None:
    claims["enclosure"]["lo"][0] = (float.fromhex(claims["enclosure"]["lo"][0]) - 2.0**-20).hex()


def least(claims: Data, run: Path) -> None:
    claims["epsilon"]["lo"] = "0x1p-30"


def at_point(**changes: Any) -> Callable[[Data, Path], None]:
    """Of the claimed point."""

    def change(claims: Data, run: Path) -> None:
        point = claims["point"]
        point.update({key: new(point[key]) if callable(new) else new for key, new in changes.items()})

    return change


def best_in_place(claims: Data, run: Path) -> None:
    """Of parameters that meet more than the tolerance, so its claim is true with any factor."""
    factor, eps = claims["point"]["factor"], claims["point"]["at"][-1]
    as_in(PASSES, "point")(claims, run)
    claims["point"].update(factor=factor, at=[*claims["point"]["at"][:-1], eps])


def own_box(run: Path) -> Data:
    head = json.loads((run / REDUCED).read_text().splitlines()[0])
    return {"lo": head["lo"], "hi": head["hi"]}


RECOMMENDED, PASSES, REDUCED = (f"leg1.{what}.cert.jsonl" for what in ("recommended", "passes", "reduced"))
BRACKET, RANGES = "leg1.cert.jsonl", "ranges-leg1.cert.jsonl"
TRUE: dict[str, tuple[str, Callable[[Data, Path], object], str]] = {
    "the enclosure of fewer": (BRACKET, lambda c, run: c.update(cap=c["epsilon"]["lo"]),
        "eps up to which the enclosure holds"),
    "a wider enclosure": (BRACKET, wider, "enclosure"),
    "a smaller lower bound": (BRACKET, least, "eps_lo"),
    "no point": (BRACKET, lambda c, run: c.update(point=None) or c["epsilon"].update(hi=None),
        "eps up to which the enclosure holds"),
    "wider ranges": (RANGES, wider, "enclosure"),
    "a point of the ranges": (RANGES, as_in(BRACKET, "point"), "point of the ranges"),
    "ranges at less": (RANGES, as_in(BRACKET, "cap"), "eps of the ranges"),
    "all readings of smaller sets": (RECOMMENDED, at_point(factor="0x1p-1"), "factor of recommended"),
    "some readings": (PASSES, at_point(factor=None), "factor of passes_from"),
    "a larger error": (RECOMMENDED, at_point(at=lambda x: [*x[:-1], (float.fromhex(x[-1]) + 1.0).hex()]),
        "eps of recommended"),
    "fewer measurements": (PASSES, at_point(holds=list(range(15))), "of which its certificate claims nothing"),
    "another factor": (REDUCED, at_point(factor=lambda f: (float.fromhex(f) / 2).hex()), "factor of reduced"),
    "another tolerance": (REDUCED, at_point(at=lambda x: [*x[:-1], (float.fromhex(x[-1]) + 1.0).hex()]),
        "eps of reduced"),
    "reduced for other parameters": (REDUCED, best_in_place, "point of reduced"),
    "an enclosure of nothing": (REDUCED, lambda c, run: c.update(enclosure=own_box(run)), "another claims"),
}  # fmt: skip


@pytest.mark.parametrize("name", TRUE)
def test_a_true_claim_that_the_run_does_not_state_is_refused(name: str, stating: Path, tmp_path: Path) -> None:
    """The certificate is accepted by itself, and claims something else than result.json says."""
    run = Path(shutil.copytree(stating, tmp_path / "run"))
    file, change, reason = TRUE[name]
    head, claims, *steps = (run / file).read_text().splitlines()
    value = json.loads(claims)
    change(value, run)
    (run / file).write_text("\n".join([head, json.dumps(value), *steps]) + "\n")
    if name != "a support up to more":  # which needs other steps
        check(run / file)
    assert reason in refused(run)


def of(key: str, **changes: Any) -> Callable[[Data], object]:
    return lambda leg: leg[key].update({name: new(leg[key][name]) for name, new in changes.items()})


BESIDE = "does not name the certificate"
STATED: dict[str, tuple[Callable[[Data], object], str]] = {
    "a smaller error": (of("recommended", largest=lambda v: v / 2), "eps of recommended"),
    "each by the file of the other": (
        lambda leg: (leg["recommended"].update(certificate=PASSES), leg["passes_from"].update(certificate=RECOMMENDED)),
        "point of recommended",
    ),
    "passes from more": (of("passes_from", eps=up), "eps of passes_from"),
    "a larger factor": (of("reduced", factor=up), "factor of reduced"),
    "no recommendation, and its file beside": (lambda leg: leg.update(recommended=None), BESIDE),
}


@pytest.mark.parametrize("name", STATED)
def test_a_leg_states_what_its_certificates_prove(name: str, stating: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(stating, tmp_path / "run"))
    assert not refused(run)
    data = json.loads((run / "result.json").read_text())
    change, reason = STATED[name]
    change(data["legs"][0])
    (run / "result.json").write_text(json.dumps(data))
    assert reason in refused(run)
