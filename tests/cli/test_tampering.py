"""`cpcal verify` refuses every run that was touched: nothing that a run states is believed without its certificate."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from tests.checker.forged.test_checker_run import uncertified

SMALL = {"joint_error": 10.0, "factor": 0.0, "extremal": False, "random_poses": 12}
Tamper = Callable[[Path], None]


def verify(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["verify", *map(str, arguments)])


def certified(folder: Path, seed: int, *options: str) -> Path:
    """A run of two legs, with its campaign beside it."""
    cpcal.save_campaign(cpcal.simulate(seed=seed, **SMALL), folder / "campaign")
    arguments = ["certify", str(folder / "campaign"), "-o", str(folder / "run"), "--legs", "1,2", "--delta", "2"]
    done = CliRunner().invoke(app, [*arguments, *options])
    assert done.exit_code in (0, 1), done.output
    return folder / "run"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A run, one of another campaign, and one that asked about an eps."""
    folders = [tmp_path_factory.mktemp(name) for name in ("one", "other", "asked")]
    return certified(folders[0], 1), certified(folders[1], 2), certified(folders[2], 1, "--eps", "0.1")


@pytest.fixture
def run(runs: tuple[Path, Path, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(runs[0], tmp_path / "moved" / "run"))


def stated(change: Callable[[dict[str, Any]], object]) -> Tamper:
    """result.json with something else in it."""

    def tamper(run: Path) -> None:
        path = run / "result.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        change(data)
        path.write_text(json.dumps(data, indent=1), encoding="utf-8")

    return tamper


def leg(**changes: Any) -> Tamper:
    """The first leg of result.json with other fields; a function makes the new value of the old one."""

    def change(data: dict[str, Any]) -> None:
        first = data["legs"][0]
        for name, value in changes.items():
            part, key = (first["bracket"], name.removeprefix("eps_")) if name in _OF_BRACKET else (first, name)
            part[key] = value(part[key]) if callable(value) else value

    return stated(change)


_OF_BRACKET = {"eps_lo", "eps_hi", "point", "center", "enclosure", "status", "certificate"}


def told(**changes: Any) -> Tamper:
    """The same of the information on the first leg."""

    def change(data: dict[str, Any]) -> None:
        first = data["legs"][0]
        for name, value in changes.items():
            part, key = first["information"], name
            if name in _OF_BRACKET:
                part, key = first["bracket"]["information"], name.removeprefix("eps_")
            elif name == "support":
                part, key = first["support"]["information"], "ids"
            elif name == "floor":
                part = first["information"]["work"]
            part[key] = value(part[key]) if callable(value) else value

    return stated(change)


def text(name: str, change: Callable[[str], str]) -> Tamper:
    def tamper(run: Path) -> None:
        old = (run / name).read_text(encoding="utf-8")
        new = change(old)
        assert new != old
        (run / name).write_text(new, encoding="utf-8")

    return tamper


def line(name: str, number: int, change: Callable[[Any], object]) -> Tamper:
    """A line of a certificate, changed in place."""

    def edit(old: str) -> str:
        lines = old.splitlines()
        value = json.loads(lines[number])
        change(value)
        lines[number] = json.dumps(value, separators=(",", ":"))
        return "\n".join(lines) + "\n"

    return text(name, edit)


def swapped(run: Path) -> None:
    first, second = (run / f"leg{k}.cert.jsonl" for k in (1, 2))
    first.rename(run / "aside")
    second.rename(first)
    (run / "aside").rename(second)


def linked(run: Path) -> None:
    (run / FIRST).unlink()
    (run / FIRST).symlink_to("none")


def emptied(run: Path) -> None:
    for path in run.glob("*.cert.jsonl"):
        path.unlink()


def up(value: float) -> float:
    return math.nextafter(value, math.inf)


def down(value: float) -> float:
    return math.nextafter(value, -math.inf)


def moved(values: list[float]) -> list[float]:
    return [up(values[0]), *values[1:]]


def inner(box: dict[str, Any]) -> dict[str, Any]:
    return box | {"lo": moved(box["lo"])}


def outer(box: dict[str, Any]) -> dict[str, Any]:
    return box | {"hi": [*box["hi"][:-1], down(box["hi"][-1])]}


FIRST = "leg1.cert.jsonl"


def _numbers_alone(run: Path) -> None:
    leg(certificate=None)(run)
    (run / FIRST).unlink()


TAMPERED: dict[str, Tamper] = {
    "eps_lo is a little more": leg(eps_lo=up),
    "eps_lo is a little less": leg(eps_lo=down),
    "eps_lo is 0": leg(eps_lo=0.0),
    "eps_lo is inf": leg(eps_lo="inf"),
    "eps_hi is a little less": leg(eps_hi=down),
    "eps_hi is a little more": leg(eps_hi=up),
    "eps_hi is 0": leg(eps_hi=0.0, eps_lo=0.0),
    "eps_hi is inf": leg(eps_hi="inf"),
    "the point is another": leg(point=moved),
    "there is no point": leg(point=None),
    "the center is another": leg(center=lambda x: [x[0] + 1e-9, *x[1:]]),
    "the center is far away": leg(center=lambda x: [v + 1.0 for v in x]),
    "the enclosure is smaller": leg(enclosure=inner),
    "the enclosure is smaller above": leg(enclosure=outer),
    "the enclosure is empty": leg(enclosure=lambda box: box | {"lo": None, "hi": None}),
    "the enclosure's parameters trade places": leg(enclosure=lambda box: box | {"names": box["names"][::-1]}),
    "the verdict is refuted": leg(status="refuted"),
    "the support has an unknown measurement": told(support=lambda ids: [*ids, "none/1"]),
    "the support names one twice": told(support=lambda ids: [*ids, ids[0]]),
    "the certificate is called otherwise": leg(certificate="leg3.cert.jsonl"),
    "the certificate is that of the other leg": leg(certificate="leg2.cert.jsonl"),
    "the certificate is outside": leg(certificate="../run/leg1.cert.jsonl"),
    "the certificate is called nothing": leg(certificate=None),
    "numbers without a certificate": _numbers_alone,
    "not certified, with a certificate beside it": stated(lambda data: uncertified(data["legs"][0])),
    "certified, but with a reason not to be": told(not_certified="the search was interrupted"),
    "the leg is the third": leg(leg=3),
    "the leg is the second": leg(leg=2),
    "a leg is left out": stated(lambda data: data["legs"].pop()),
    "a leg is there twice": stated(lambda data: data["legs"].append(data["legs"][0])),
    "no legs at all": stated(lambda data: data["legs"].clear()),
    "the box was larger": stated(lambda data: data["options"].update(delta=4.0)),
    "the box was a little larger": stated(lambda data: data["options"].update(delta=2.001)),
    "the center is called nominal": stated(lambda data: data["options"]["information"].update(center="nominal")),
    "an eps was asked for": stated(lambda data: data["options"].update(eps=0.1)),
    "all legs were asked for": stated(lambda data: data["options"].update(legs=None)),
    "the method was the paper's": stated(
        lambda data: data["options"]["information"].update(method="timeout", time_limit=60.0)
    ),
    "the gap is narrower than the bracket": stated(lambda data: data["options"]["information"].update(gap=0.0)),
    "another campaign's digest": stated(lambda data: data["campaign"].update(sha256="0" * 64)),
    "another robot": stated(lambda data: data["campaign"].update(robot="R2")),
    "more measurements": stated(lambda data: data["campaign"].update(measurements=13)),
    "another model": stated(lambda data: data["model"].update(name="gain")),
    "a parameter more": stated(
        lambda data: data["model"]["parameters"].append({"name": "s", "unit": "", "half_width": 1.0})
    ),
    "a text of the model": stated(lambda data: data["model"].update(summary="proved to be right")),
    "a model of other letters": stated(lambda data: data["model"].update(name="pl\u0430in")),
    "a parameter is called undetermined": told(determination=lambda old: old | {"rank": 6, "undetermined": ["l"]}),
    "nothing is said of what is determined": told(determination=None),
    "a sentence of one's own": leg(sentence="Both bounds are proved by somebody else."),
    "a reason of one's own": told(not_certified="because it is proved otherwise"),
    "the second-order effect is called large": lambda run: (
        stated(lambda data: data["options"]["information"].update(gap=0.0))(run) or told(floor=1e9)(run)
    ),
    "a certificate is gone": lambda run: (run / FIRST).unlink(),
    "all certificates are gone": emptied,
    "a certificate is empty": lambda run: (run / FIRST).write_text("") and None,
    "a certificate is cut short": text(FIRST, lambda old: old[: len(old) // 2]),
    "a certificate lacks its last step": text(FIRST, lambda old: "\n".join(old.splitlines()[:-1]) + "\n"),
    "a certificate is called otherwise on disk": lambda run: (run / FIRST).rename(run / "leg9.cert.jsonl") and None,
    "a certificate more": lambda run: shutil.copy(run / FIRST, run / "leg9.cert.jsonl") and None,
    "a certificate is a link to nowhere": linked,
    "certificates trade places": swapped,
    "a certificate claims more": line(FIRST, 1, lambda claims: claims["epsilon"].update(lo=claims["cap"])),
    "a certificate claims nothing": line(FIRST, 1, lambda claims: claims.update(epsilon=None, enclosure=None)),
    "a certificate's box is smaller": line(FIRST, 0, lambda head: head["hi"].__setitem__(0, head["lo"][0])),
    "a certificate of another campaign by its header": line(FIRST, 0, lambda head: head.update(campaign="0" * 64)),
    "campaign.json: another layout": text("campaign.json", lambda old: old.replace('"robot":', '"robot" :')),
    "campaign.json: another name": text("campaign.json", lambda old: old.replace("DeltaLab", "DeltaLub")),
    "campaign.json: cut short": text("campaign.json", lambda old: old[:-20]),
}  # fmt: skip


@pytest.mark.parametrize("name", TAMPERED)
def test_a_run_that_was_touched_is_refused(run: Path, name: str) -> None:
    TAMPERED[name](run)
    done = verify(run)
    assert done.exit_code == 1, done.output
    assert "Traceback" not in done.output
    assert "REFUSED" in done.output
    (run / "report.html").unlink()
    page = CliRunner().invoke(app, ["report", str(run)])
    assert page.exit_code == 1, page.output
    assert "REFUSED" in page.output
    assert not (run / "report.html").exists()


@pytest.mark.parametrize("files", [[FIRST], [FIRST, "leg2.cert.jsonl"], ["campaign.json"], ["result.json"]])
@pytest.mark.parametrize("source", [1, 2])
def test_files_of_another_run_are_refused(
    run: Path, runs: tuple[Path, Path, Path], files: list[str], source: int
) -> None:
    for name in files:
        shutil.copy(runs[source] / name, run / name)
    if (files, source) == (["campaign.json"], 2):  # the same campaign
        assert verify(run).exit_code == 0
        return
    assert verify(run).exit_code == 1


def test_a_run_needs_nothing_else(run: Path, runs: tuple[Path, Path, Path]) -> None:
    done = verify(run)
    assert done.exit_code == 0, done.output
    assert "REFUSED" not in done.output
    assert verify(run, "--campaign", runs[0].parent / "campaign").exit_code == 0
    assert CliRunner().invoke(app, ["report", str(run)]).exit_code == 0
    assert verify(run).exit_code == 0  # as the page is none of what was proved
    assert verify(runs[2]).exit_code == 0


def test_the_original_files_can_be_compared(run: Path, runs: tuple[Path, Path, Path]) -> None:
    done = verify(run, "--campaign", runs[1].parent / "campaign")
    assert done.exit_code == 1
    assert "another one" in done.output
    refused = CliRunner().invoke(app, ["report", str(run), "--campaign", str(runs[1].parent / "campaign")])
    assert refused.exit_code == 2


@pytest.mark.parametrize("missing", ["campaign.json", "result.json"])
def test_what_is_missing_is_unusable_not_refused(run: Path, missing: str) -> None:
    (run / missing).unlink()
    assert verify(run).exit_code == {"campaign.json": 2, "result.json": 0}[missing]  # the certificates by themselves
    assert verify(run, "--campaign", run / "absent").exit_code == 2


def test_a_leg_that_is_not_certified_is_named(run: Path) -> None:
    stated(lambda data: uncertified(data["legs"][0]))(run)
    told(not_certified="the search was interrupted")(run)
    (run / FIRST).unlink()
    done = verify(run)
    assert done.exit_code == 0
    assert "leg 1: NOT CERTIFIED, the search was interrupted" in done.output
    assert CliRunner().invoke(app, ["report", str(run)]).exit_code == 0
    assert "ot certified" in (run / "report.html").read_text(encoding="utf-8")
