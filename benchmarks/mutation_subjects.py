"""What `benchmarks.mutations` damages: files as cpcal writes them, and what is read out of them.

To add a subject, write a function that writes its good files into an empty folder and one that reads what they claim,
and add a line to SUBJECTS.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from cpcal.calibration import calibrate_study, recorded
from cpcal.calibration.record import load_record, save_record
from cpcal.cli import app
from cpcal.cli.status import Status
from cpcal.common.values import same
from cpcal.files import campaign_sha256, load_campaign, load_study, save_campaign, save_study
from cpcal.files.run_folder import REPORT_NAME
from cpcal.results import Result, load_result
from cpcal.robot import Campaign
from cpcal.simulate import simulate, simulate_study
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import load_camera, load_target, save_camera, save_target
from cpcal.vision.target import DELTALAB_TARGET


class Refusal(Exception):
    """A command that left with status 1 or 2, and its message."""


@dataclass(frozen=True)
class Subject:
    """`write` makes good files in an empty folder; `read` says what files claim, or refuses; of what is claimed
    otherwise, `harmless` says why that is harmless, or None."""

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    harmless: Callable[[Any, Any], str | None]
    mutated: str = "**/*"  # which of the files


def _never(good: Any, found: Any) -> None:
    return None


def _input(save: Callable[[Any, Path], object], load: Callable[[Path], Any]) -> Callable[[Any, Any], str | None]:
    """Another input is harmless when it means what it says: saved and loaded it is the same."""

    def why(good: Any, found: Any) -> str | None:
        with tempfile.TemporaryDirectory() as folder:
            save(found, Path(folder) / "again")
            if load(Path(folder) / "again") != found:
                return None
        if isinstance(found, Campaign) and campaign_sha256(found) == campaign_sha256(good):
            return None
        differs = [f.name for f in fields(found) if not same(getattr(found, f.name), getattr(good, f.name))]
        return f"another input, which says so: {', '.join(differs)}"

    return why


def _campaign(folder: Path) -> None:
    save_campaign(simulate(seed=1, extremal=False, random_poses=4, runs=2), folder)


def _study(folder: Path) -> None:
    save_study(simulate_study(seed=1, runs=1, random_poses=1, validation_runs=1, backlash=0.1, sag=0.5), folder)


def _record(folder: Path) -> None:
    study = simulate_study(seed=1, runs=3, random_poses=4, validation_runs=2)
    save_record(recorded(study, calibrate_study(study, factor=3.0), factor=3.0), folder)


def _run(folder: Path) -> None:
    """A campaign and a certified run of its first leg: small, so that it is checked quickly."""
    save_campaign(simulate(seed=1, extremal=False, random_poses=9, joint_error=1.0, factor=0.0), folder / "campaign")
    options = ["--legs", "1", "--delta", "0.5", "--gap", "1e-2", "-o", str(folder / "run")]
    done = CliRunner().invoke(app, ["certify", str(folder / "campaign"), *options])
    assert done.exit_code == 0, done.output


def _verified(folder: Path) -> list[str]:
    """The claims that `cpcal verify` accepts, without how long it took, in time or in steps (one said twice is two)."""
    done = CliRunner().invoke(app, ["verify", str(folder / "run")])
    said = done.stdout + done.stderr
    if done.exit_code in (Status.UNKNOWN, Status.UNUSABLE) and said.strip() and done.exception is not None:
        raise Refusal(said.splitlines()[0])
    assert done.exit_code == 0, said or repr(done.exception)
    lines = (re.sub(r", \d+ steps\b", "", line) for line in done.stdout.splitlines())
    return sorted(line for line in lines if ": PROVED" in line or "CERTIFIED" in line)


def _claimed(folder: Path) -> tuple[list[str], Result, str]:
    """What `cpcal verify` accepts, the result that it accepted, and the page, which it does not read."""
    proved, run = _verified(folder), folder / "run"
    result = load_result(run)
    page = run / REPORT_NAME
    return proved, result, page.read_text(encoding="utf-8", errors="replace") if page.exists() else ""


_QUESTION = ("tolerance", "gap", "time_limit", "contractors", "arithmetic", "support", "method", "center", "model")
_INFORMATION = (
    *("floor", "support", "nodes", "programs", "seconds", "projections", "verified", "trials", "contractors_used"),
    *("found_lo", "found_enclosure", "pending"),
)


def _informed(good: tuple[list[str], Result, str], found: tuple[list[str], Result, str]) -> str | None:
    """Why another result.json that is accepted is harmless: it differs in what the page and `verify` call information,
    or says that the run was interrupted."""
    (proved, was, page), (proved_now, now, page_now) = good, found
    differs = [] if page == page_now else ["the page, which verify does not read and report writes again"]
    differs += [f"asked: {name}" for name in _QUESTION if getattr(was.options, name) != getattr(now.options, name)]
    differs += [] if was.version == now.version else ["version"]
    differs += [] if was.interrupted == now.interrupted else ["interrupted, which claims less"]
    legs = []
    for old, new in zip(was.legs, now.legs, strict=False):
        info = {name: getattr(old, name) for name in _INFORMATION}
        differs += [f"information: {name}" for name in _INFORMATION if not same(getattr(new, name), info[name])]
        legs.append(replace(new, **info))
    options = replace(now.options, **{name: getattr(was.options, name) for name in _QUESTION})
    as_before = replace(now, options=options, version=was.version, interrupted=was.interrupted, legs=tuple(legs))
    return ", ".join(differs) if differs and proved == proved_now and as_before == was else None


SUBJECTS = {
    s.name: s
    for s in (
        Subject("campaign", _campaign, load_campaign, _input(save_campaign, load_campaign)),
        Subject("study", _study, load_study, _input(save_study, load_study)),
        Subject(
            "target",
            lambda folder: save_target(DELTALAB_TARGET, folder / "target.toml"),
            lambda folder: load_target(folder / "target.toml"),
            _input(save_target, load_target),
        ),
        Subject(
            "camera",
            lambda folder: save_camera(DELTALAB_CAMERA, folder / "camera.toml"),
            lambda folder: load_camera(folder / "camera.toml"),
            _input(save_camera, load_camera),
        ),
        Subject("record", _record, load_record, _input(save_record, load_record)),
        Subject("certificate", _run, _verified, _never, "run/*.cert.jsonl"),
        Subject("result.json", _run, _claimed, _informed, "run/result.json"),
        Subject("run folder", _run, _claimed, _informed, "run/[!.]*"),
    )
}
