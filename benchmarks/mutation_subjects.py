"""What `benchmarks.mutations` damages: files as cpcal writes them, and what is read out of them.

To add a subject, write a function that writes its good files into an empty folder and one that reads what they claim,
and add a line to SUBJECTS.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from cpcal.calibration import calibrate_study, recorded
from cpcal.calibration.record_file import load_record, save_record
from cpcal.cli import app
from cpcal.cli.status import Status
from cpcal.common.values import same
from cpcal.files import campaign_sha256, load_campaign, load_study, save_campaign, save_study
from cpcal.robot import Campaign
from cpcal.simulate import simulate, simulate_study
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.camera_file import load_camera, save_camera
from cpcal.vision.files.target_file import load_target, save_target
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
    """A campaign and a certified run of its first leg."""
    save_campaign(simulate(seed=1, extremal=False, random_poses=9, joint_error=1.0, factor=0.0), folder / "campaign")
    options = ["--legs", "1", "--delta", "5", "--gap", "1e-2", "-o", str(folder / "run")]
    done = CliRunner().invoke(app, ["certify", str(folder / "campaign"), *options])
    assert done.exit_code == 0, done.output


def _verified(folder: Path) -> list[str]:
    """The claims that `cpcal verify` accepts, without how long it took."""
    done = CliRunner().invoke(app, ["verify", str(folder / "run"), "--numbers", "flint"])
    said = done.stdout + done.stderr
    if done.exit_code in (Status.UNKNOWN, Status.UNUSABLE) and said.strip() and done.exception is not None:
        raise Refusal(said.splitlines()[0])
    assert done.exit_code == 0, said or repr(done.exception)
    return sorted(re.sub(r", \d+ steps, [\d.]+ s", "", line) for line in done.stdout.splitlines())


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
    )
}
