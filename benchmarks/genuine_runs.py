"""Small genuine runs of every kind that `cpcal verify` reads, as the commands write them.

Each writes its folders into an empty one; the folder to verify is `run`.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from benchmarks.pose_sets import drawn_pose, shown
from cpcal.cli import app
from cpcal.files import save_campaign
from cpcal.files.run_folder import ACCURACY, answers_into
from cpcal.models.hand_eye import save_hand_eye, simulate_hand_eye
from cpcal.models.sight import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.questions import calibrate_study, certify
from cpcal.questions.accuracy import NamedPoses, certify_accuracy, save_accuracy
from cpcal.questions.points import certify_fits
from cpcal.robot import Pose
from cpcal.simulate import simulate, simulate_study
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET, Target

PROBLEM = "variables x in [-1, 1]; y in [0, 2]; minimize x^2 + y; constraints x + y >= 0.5; end"
NARROW = ("--legs", "1", "--delta", "0.5", "--gap", "1e-2")


def command(*words: object) -> None:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code in (0, 1), done.output


def _campaign(folder: Path, **changes: object) -> Path:
    options = {"seed": 1, "extremal": False, "random_poses": 9, "joint_error": 1.0, "factor": 0.0} | changes
    save_campaign(simulate(**options), folder / "campaign")  # type: ignore[arg-type]
    return folder / "campaign"


def leg(folder: Path) -> None:
    command("certify", _campaign(folder), *NARROW, "-o", folder / "run")


def uncertain_leg(folder: Path) -> None:
    campaign = _campaign(folder, factor=3.0, joint_error=0.0, random_poses=8)
    command("certify", campaign, *NARROW, "--eps", "0.05", "-o", folder / "run")


def undecided_leg(folder: Path) -> None:
    """Which would pass with smaller half-widths."""
    campaign = _campaign(folder, factor=1.0)
    command("certify", campaign, *NARROW, "--tolerance", "0.1797", "-o", folder / "run")


def robust(folder: Path) -> None:
    command("certify", _campaign(folder), "--legs", "1", "--delta", "0.5", "--outliers", "1", "-o", folder / "run")


def compare(folder: Path) -> None:
    command("certify", _campaign(folder), *NARROW, "--model", "plain,lateral", "-o", folder / "run")


def fits(folder: Path) -> None:
    study = simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0)
    found = calibrate_study(study)
    certify_fits(found.campaign, found.record, folder / "run", legs=[2, 5])


def accuracy(folder: Path) -> None:
    campaign = simulate(seed=3, extremal=False, random_poses=12, noise=0.0, factor=0.0, joint_error=0.02)
    result = certify(campaign, delta=8.0, support="none", center="nominal")
    poses = NamedPoses(("home",), Pose(np.array([[0.0, 0.0, 360.0]]), np.array([[1.0, 0.0, 0.0, 0.0]])))
    with answers_into(folder / "run", ACCURACY, campaign) as draft:
        save_accuracy(certify_accuracy(campaign, result, poses=poses, assume=0.02, certificates=draft), draft)


def pose_sets(folder: Path) -> None:
    """Of seven dots, whose places are uncertain."""
    rng = np.random.default_rng(7)
    few = Target("few dots", DELTALAB_TARGET.dots[::12], 6.0)
    targets, cameras = TargetSet(few, 0.01), CameraSet(DELTALAB_CAMERA)
    numbers, centers = shown(rng, drawn_pose(rng), cameras, targets)
    boxes = PixelBoxes.around(numbers, centers, 0.05, of_images=True)
    (folder / "run").mkdir()
    enclose_pose(boxes, targets, cameras, certificate=folder / "run" / "one", sources={"camera.toml": b"its bytes"})


def hand_eye(folder: Path, **changes: Any) -> None:
    """Of six images; with errors of the robot its poses are uncertain."""
    study = simulate_hand_eye(images=6, corners=(3, 3), pitch=80.0, seed=5, **changes).study
    if changes:
        width = [changes["position_error"]] * 3 + [changes["rotation_error"]] * 3
        study = replace(study, pose_half_width=np.tile(width, (6, 1)))
    save_hand_eye(study, folder / "study")
    command("handeye", "certify", folder / "study", "--within", "1.5,50", "-o", folder / "run")


def uncertain_hand_eye(folder: Path) -> None:
    hand_eye(folder, position_error=0.1, rotation_error=0.001)


def wrong_images(folder: Path) -> None:
    """The fifth of twelve images has a pose that is off by a centimetre."""
    study = simulate_hand_eye(images=12, corners=(3, 3), pitch=60.0, seed=11).study
    position = np.array(study.poses.position)
    position[4] += [8.0, -5.0, 4.0]
    save_hand_eye(replace(study, poses=Pose(position, study.poses.quaternion)), folder / "study")
    command("handeye", "certify", folder / "study", "--wrong", "1", "--within", "0.8,20", "-o", folder / "run")


def solve(folder: Path) -> None:
    (folder / "run").mkdir()
    (folder / "it.mbx").write_text(PROBLEM)
    command("solve", folder / "it.mbx", "--certificate", folder / "run" / "it.cert.jsonl", "-o", folder / "it.json")


RUNS: dict[str, Callable[[Path], None]] = {
    "leg": leg, "uncertain leg": uncertain_leg, "undecided leg": undecided_leg, "robust": robust,
    "compare": compare, "fits": fits, "accuracy": accuracy, "pose sets": pose_sets, "solve": solve,
    "hand-eye": hand_eye, "uncertain hand-eye": uncertain_hand_eye, "wrong images": wrong_images,
}  # fmt: skip
