"""`cpcal verify` refuses every run that was touched: nothing that a run states is believed without its certificate."""

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cpcal
from tests.checker.forged.test_checker_run import uncertified
from tests.cli.command import done
from tests.cli.conftest import SMALL, certified
from tests.remembered import verify_once

Tamper = Callable[[Path], None]


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of another campaign."""
    folder = tmp_path_factory.mktemp("other")
    cpcal.save_campaign(cpcal.simulate(seed=2, **SMALL), folder / "campaign")
    return certified(folder / "campaign", folder / "run")


@pytest.fixture
def run(genuine: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(genuine, tmp_path / "moved" / "run"))


def stated(change: Callable[[dict[str, Any]], object]) -> Tamper:
    """result.json with something else in it."""

    def tamper(run: Path) -> None:
        path = run / "result.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        change(data)
        path.write_text(json.dumps(data, indent=1), encoding="utf-8")

    return tamper


def at(path: str, value: object) -> Tamper:
    """Another value at a path of result.json, in which a number is a place; a function makes it of the old one."""

    def change(data: Any) -> None:
        *steps, last = (int(step) if step.isdigit() else step for step in path.split("."))
        for step in steps:
            data = data[step]
        data[last] = value(data[last]) if callable(value) else value

    return stated(change)


def both(*tampers: Tamper) -> Tamper:
    def tamper(run: Path) -> None:
        for one in tampers:
            one(run)

    return tamper


def text(name: str, change: Callable[[str], str]) -> Tamper:
    def tamper(run: Path) -> None:
        old = (run / name).read_text(encoding="utf-8")
        new = change(old)
        assert new != old
        (run / name).write_text(new, encoding="utf-8")

    return tamper


def linked(run: Path) -> None:
    (run / FIRST).unlink()
    (run / FIRST).symlink_to("none")


def emptied(run: Path) -> None:
    for path in run.glob("*.cert.jsonl"):
        path.unlink()


def moved(values: list[float]) -> list[float]:
    return [math.nextafter(values[0], math.inf), *values[1:]]


FIRST = "leg1.cert.jsonl"


INFORMATION = "legs.0.information"


def bracket(key: str, value: object) -> Tamper:
    return at(f"legs.0.bracket.{key}", value)


TAMPERED: dict[str, Tamper] = {
    "the point is another": bracket("point", moved),
    "numbers without a certificate": both(bracket("certificate", None), lambda run: (run / FIRST).unlink()),
    "certified, but with a reason not to be": at(f"{INFORMATION}.not_certified", "the search was interrupted"),
    "the center is called nominal": at("options.information.center", "nominal"),
    "a parameter more": stated(
        lambda data: data["model"]["parameters"].append({"name": "s", "unit": "", "half_width": 1.0})
    ),
    "a parameter is called undetermined": both(
        at(f"{INFORMATION}.determination.rank", 6), at(f"{INFORMATION}.determination.undetermined", ["l"])
    ),
    "nothing is said of what is determined": at(f"{INFORMATION}.determination", None),
    "a reason of one's own": at(f"{INFORMATION}.not_certified", "because it is proved otherwise"),
    "the second-order effect is called large": both(
        at("options.information.gap", 0.0), at(f"{INFORMATION}.work.floor", 1e9)
    ),
    "a certificate is gone": lambda run: (run / FIRST).unlink(),
    "all certificates are gone": emptied,
    "a certificate is a link to nowhere": linked,
    "campaign.json: cut short": text("campaign.json", lambda old: old[:-20]),
}  # fmt: skip


GARBLED: dict[str, tuple[Tamper, str]] = {  # and why it is refused
    f"{path} is {value!r}": (at(path, value), why)
    for path, value, why in (
        ("options.information.center", "left", "not known"),
        ("legs.0.bracket.enclosure.names", list("tuvwxyz"), "has not the parameters"),
        ("legs.0.leg", "\x1b[2J", "leg"),
        ("legs.0.information.not_certified", "proved", "not_certified is none of"),
        ("legs.0.ranges.box.hi", ["inf"] * 7, "not finite"),
    )
}
TOUCHED = {name: (tamper, "") for name, tamper in TAMPERED.items()} | GARBLED


@pytest.mark.parametrize("name", TOUCHED)
def test_a_run_that_was_touched_is_refused(run: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    verify_once(monkeypatch)
    tamper, why = TOUCHED[name]
    tamper(run)
    said = done("verify", run, status=1)
    assert any("REFUSED" in line and why in line for line in said.splitlines())
    assert "Traceback" not in said
    assert "\x1b" not in said


@pytest.mark.parametrize("name", ["the point is another", "a certificate is gone", next(iter(GARBLED))])
def test_what_is_refused_has_no_page_and_no_parameters(run: Path, name: str) -> None:
    TOUCHED[name][0](run)
    (run / "report.html").unlink()
    for verb in ("report", "export"):
        said = done(verb, run, status=1)
        assert "run: " in said
        assert "REFUSED" in said
        assert "a_x" not in said
    assert not (run / "report.html").exists()


@pytest.mark.parametrize("name", [FIRST, "campaign.json", "result.json"])
def test_files_of_another_run_are_refused(run: Path, other: Path, name: str) -> None:
    shutil.copy(other / name, run / name)
    done("verify", run, status=1)


@pytest.mark.parametrize("missing", ["campaign.json", "result.json"])
def test_what_is_missing_is_unusable_not_refused(run: Path, missing: str) -> None:
    (run / missing).unlink()
    done("verify", run, status={"campaign.json": 2, "result.json": 0}[missing])  # the certificates by themselves
    done("verify", run, "--campaign", run / "absent", status=2)


# What a run states and no certificate holds: `verify` names it, and `export` does not write it.


def test_a_leg_that_is_not_certified_is_named(run: Path) -> None:
    stated(lambda data: uncertified(data["legs"][0]))(run)
    at(f"{INFORMATION}.not_certified", "the search was interrupted")(run)
    (run / FIRST).unlink()
    assert "leg 1: NOT CERTIFIED, the search was interrupted" in done("verify", run)
    done("report", run)
    assert "ot certified" in (run / "report.html").read_text(encoding="utf-8")


def test_ranges_that_are_not_certified_are_named_and_not_exported(run: Path) -> None:
    box = {"lo": [0.0] * 7, "hi": [0.0] * 7}
    known = {"certificate": None}
    at("legs.0.ranges", lambda old: known | {"information": {"eps": old["eps"], "box": old["box"] | box}})(run)
    (run / "ranges-leg1.cert.jsonl").unlink()
    assert "leg 1: its ranges are NOT CERTIFIED" in done("verify", run)
    exported = json.loads(done("export", run, "--format", "json"))
    first, second = (leg["parameters"]["a_x"] for leg in exported["legs"])
    assert "range_lo" not in first
    assert "range_lo" in second
    assert "range_eps" not in exported["legs"][0]


def test_numbers_that_are_not_certified_are_not_exported_as_if_they_were(run: Path) -> None:
    stated(lambda data: uncertified(data["legs"][0]))(run)
    at(f"{INFORMATION}.not_certified", "no certificate was asked for")(run)
    for key, value in (("lo", 0.0), ("hi", 0.0), ("point", [0.0] * 7)):
        bracket(f"information.{key}", value)(run)
    at("options.information.tolerance", 1.0)(run)
    (run / FIRST).unlink()
    exported = json.loads(done("export", run, "--format", "json"))
    first, second = exported["legs"]
    assert (exported["verdict"], first["verdict"]) == ("not certified", "not certified")
    assert first["not_certified"] == "no certificate was asked for"
    assert not {"eps_lo", "eps_hi"} & set(first)
    assert {"eps_lo", "eps_hi"} <= set(second)


def test_legs_that_nobody_asked_about_are_named(run: Path) -> None:
    """A leg that fails could be left out of a run, and what is left would look like the robot."""
    sentence = "Not asked about, and not judged: leg 3, 4, 5, 6."
    assert sentence in done("verify", run)
    done("report", run)
    assert sentence in (run / "report.html").read_text(encoding="utf-8")
    assert json.loads(done("export", run, "--format", "json"))["missing_legs"] == [3, 4, 5, 6]
