"""Certificates that are true, but claim something else than result.json states: the run is refused."""

from __future__ import annotations

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
    """A leg with a certificate of each kind: of its bracket, of its ranges, of its support."""
    folder = tmp_path_factory.mktemp("stating")
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=16, joint_error=10.0, factor=1.0)
    asked = {"legs": [1], "delta": 2.0, "support": "irreducible", "ranges": True}
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


def everything(run: Path) -> Data:
    head = json.loads((run / SUPPORT).read_text().splitlines()[0])
    return {"lo": head["lo"], "hi": head["hi"]}


BRACKET, RANGES, SUPPORT = "leg1.cert.jsonl", "ranges-leg1.cert.jsonl", "leg1.support.cert.jsonl"
TRUE: dict[str, tuple[str, Callable[[Data, Path], object]]] = {
    "the enclosure of fewer": (BRACKET, at_the_lower_bound),
    "a wider enclosure": (BRACKET, wider),
    "a smaller lower bound": (BRACKET, least),
    "no point": (BRACKET, lambda c, run: c.update(point=None) or c["epsilon"].update(hi=None)),
    "wider ranges": (RANGES, wider),
    "a point of the ranges": (RANGES, as_in(BRACKET, "point")),
    "ranges at less": (RANGES, as_in(BRACKET, "cap")),
    "a support of less": (SUPPORT, least),
    "a support with an enclosure": (SUPPORT, lambda c, run: c.update(enclosure=everything(run))),
    "a support up to more": (SUPPORT, as_in(BRACKET, "cap")),
}


@pytest.mark.parametrize("name", TRUE)
def test_a_true_claim_that_the_run_does_not_state_is_refused(name: str, stating: Path, tmp_path: Path) -> None:
    """The certificate is accepted by itself, and claims something else than result.json says."""
    run = Path(shutil.copytree(stating, tmp_path / "run"))
    file, change = TRUE[name]
    head, claims, *steps = (run / file).read_text().splitlines()
    value = json.loads(claims)
    change(value, run)
    (run / file).write_text("\n".join([head, json.dumps(value), *steps]) + "\n")
    if name not in ("a support up to more", "ranges at less"):  # which need other steps
        check(run / file)
    assert refused(run)


STATED: dict[str, Callable[[Data], object]] = {
    "more": lambda leg: leg["support"]["proof"].update(eps_lo=up(leg["support"]["proof"]["eps_lo"])),
    "less": lambda leg: leg["support"]["proof"].update(eps_lo=leg["support"]["proof"]["eps_lo"] / 2),
    "of fewer": lambda leg: leg["support"]["information"]["ids"].pop(),
    "of others": lambda leg: leg["support"]["information"].update(ids=["p1/1"]),
    "of another file": lambda leg: leg["support"]["proof"].update(certificate=BRACKET),
    "of none": lambda leg: leg["support"].update(proof=None),
    "nothing": lambda leg: leg["support"].update(proof={}),
}


@pytest.mark.parametrize("name", STATED)
def test_the_support_states_what_its_certificate_proves(name: str, stating: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(stating, tmp_path / "run"))
    assert not refused(run)
    data = json.loads((run / "result.json").read_text())
    STATED[name](data["legs"][0])
    (run / "result.json").write_text(json.dumps(data))
    assert refused(run)


def test_a_support_in_a_smaller_box_is_refused(stating: Path, tmp_path: Path) -> None:
    """Its lower bound says nothing of the rest of the leg's box."""
    run = Path(shutil.copytree(stating, tmp_path / "run"))
    head, *others = (run / SUPPORT).read_text().splitlines()
    value = json.loads(head)
    value["hi"][0] = (float.fromhex(value["hi"][0]) - 2.0**-20).hex()
    (run / SUPPORT).write_text("\n".join([json.dumps(value), *others]) + "\n")
    assert refused(run)
