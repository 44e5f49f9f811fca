"""Certificates that are true, but claim something else than result.json states: the run is refused."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cpcal
from cpcal.checker import check
from cpcal.questions import save_result
from tests.checker.forged.test_checker_run import refused, up

Data = dict[str, Any]


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


def at_the_lower_bound(claims: Data, run: Path) -> None:
    claims["cap"] = claims["epsilon"]["lo"]


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
    "the enclosure of fewer": (BRACKET, at_the_lower_bound, "eps up to which the enclosure holds"),
    "a wider enclosure": (BRACKET, wider, "enclosure"),
    "a smaller lower bound": (BRACKET, least, "eps_lo"),
    "no point": (BRACKET, lambda c, run: c.update(point=None) or c["epsilon"].update(hi=None),
        "eps up to which the enclosure holds"),
    "wider ranges": (RANGES, wider, "enclosure"),
    "a point of the ranges": (RANGES, as_in(BRACKET, "point"), "point of the ranges"),
    "ranges at less": (RANGES, as_in(BRACKET, "cap"), "the cap is not an eps of the problem"),
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
    if name not in ("a support up to more", "ranges at less"):  # which need other steps
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
