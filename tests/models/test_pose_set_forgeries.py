"""Pose sets that are certified from pixels on: nothing that does not follow from what is assumed is accepted."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.pose_sets import shown
from benchmarks.vision_scenes import facing_poses
from cpcal.checker.sight import check_pose_set, check_pose_sets, digest_of
from cpcal.models.sight import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET, Target
from tests.changed import put

WIDTHS = np.array([0.3, 0.3, 0.2, 0.2, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4])
FEW = Target("few dots", DELTALAB_TARGET.dots[::8], 6.0)
NAME = "e00-1"


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pose set of everything uncertain, with its certificates."""
    folder = tmp_path_factory.mktemp("sets")
    rng = np.random.default_rng(7)
    targets = TargetSet(FEW, 0.01, scale=2e-4)
    cameras = CameraSet.ellipsoid(DELTALAB_CAMERA, np.diag(WIDTHS**2), 1.0)
    pose = facing_poses(rng, 1).rows(0)
    numbers, centers = shown(rng, pose, cameras, targets)
    boxes = PixelBoxes.around(numbers, centers + rng.uniform(-0.0499, 0.0499, centers.shape), 0.05, of_images=True)
    found = enclose_pose(
        boxes, targets, cameras, certificate=folder / NAME, sources={"camera.toml": b"the bytes of it"}
    )
    for larger in (1.0 - 1.9e-4, 1.0, 1.0 + 1.9e-4):  # such a plate, so much farther away, looks the same
        assert Pose(larger * pose.position, pose.quaternion) in found
    return folder


@pytest.fixture(scope="module")
def robust(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One where one dot may be wrong, and none is found to be."""
    folder = tmp_path_factory.mktemp("robust")
    rng = np.random.default_rng(8)
    cameras, targets = CameraSet(DELTALAB_CAMERA), TargetSet(FEW)
    pose = facing_poses(rng, 1).rows(0)
    numbers, centers = shown(rng, pose, cameras, targets)
    boxes = PixelBoxes.around(numbers, centers + rng.uniform(-0.04, 0.04, centers.shape), 0.05, of_images=True)
    found = enclose_pose(boxes, targets, cameras, outliers=1, certificate=folder / NAME)
    assert pose in found
    assert found.refuted == ()
    return folder


def test_the_checker_proves_it_again_from_the_pixels(certified: Path, robust: Path) -> None:
    for folder, files in ((certified, {"camera.toml"}), (robust, set())):
        (found,) = check_pose_sets(folder)
        assert found.refused is None
        assert found.name == NAME
        assert found.radii is not None
        assert dict(found.files).keys() == files
        assert {path.name for path in folder.glob("*.cert.jsonl")} == set(found.certificates)


Edit = Callable[[Any], None]
INPUTS, CAMERA, TARGET = "inputs", ("inputs", "camera"), ("inputs", "target")


def scaled(*path: Any, by: float = 1.1, plus: float = 0.0) -> Edit:
    """A change of all numbers at a place."""

    def change(value: Any) -> Any:
        return (by * float.fromhex(value) + plus).hex() if isinstance(value, str) else [change(v) for v in value]

    return put(*path, to=change)


def all_dots_moved(claim: Any) -> None:
    for side in ("lo", "hi"):
        for x in claim["inputs"]["pixels"][side]:
            scaled(0, by=1.0, plus=0.1)(x)


def refuted(claim: Any) -> None:
    claim.update(refuted=True, position_radius=None, rotation_radius=None)


HARDLY = {"by": 1.0 + 1e-3, "plus": 1e-6}  # another number
PROVES = "the weights prove less|do not exclude|prove a wider box"
SPOILED = "so many wrong dots could spoil all of its certificates"
EDITS: dict[str, tuple[Edit, str]] = {
    "pixels a tenth beside": (all_dots_moved, PROVES),
    "another camera": (scaled(*CAMERA, "numbers", 0, **HARDLY), PROVES),
    "other directions": (scaled(INPUTS, "pixels", "rays", by=1.01), PROVES),
    "directions beside the field": (scaled(INPUTS, "pixels", "rays", by=9.0), "beside the camera's field"),
    "another scale": (put(INPUTS, "target", "scale", to=(4e-4).hex()), "prove a wider box"),
    "a narrower box": (scaled("position_radius", by=0.99), "prove a wider box"),
    "a wider box": (scaled("rotation_radius", by=1.01), "states a wider box"),
    "refuted": (refuted, "a pose is not excluded"),
    "outliers": (put("outliers", to=1), SPOILED),
    "after nothing": (put("after", to=[]), "give no box together"),
    "after one twice": (put("after", to=lambda files: files * 2), "give no box together"),
    "a wrong dot": (put("wrong", to=[3]), "not proved that dot 3 is wrong"),
}


def refusal(folder: Path, copy: Path, edit: Edit, *, renewed: bool = True) -> str:
    """What is said of a claim that was edited, by somebody who renews the digest in all certificates or not."""
    claim = json.loads((folder / f"{NAME}.pose.json").read_text())
    before = digest_of(claim["inputs"])
    edit(claim)
    for path in folder.glob("*.cert.jsonl"):
        text = path.read_text()
        assert before in text
        (copy / path.name).write_text(text.replace(before, digest_of(claim["inputs"])) if renewed else text)
    path = copy / f"{NAME}.pose.json"
    path.write_text(json.dumps(claim))
    found = check_pose_set(path)
    assert found.radii is None
    return str(found.refused)


@pytest.mark.parametrize("name", EDITS)
def test_what_does_not_follow_is_refused(certified: Path, tmp_path: Path, name: str) -> None:
    edit, reasons = EDITS[name]
    found = refusal(certified, tmp_path, edit)
    assert any(reason in found for reason in reasons.split("|")), found


def test_certificates_about_other_pixels_are_refused(certified: Path, tmp_path: Path) -> None:
    assert "about other pixels" in refusal(certified, tmp_path, EDITS["another camera"][0], renewed=False)


def edited(folder: Path, copy: Path, number: int, line: int, edit: Edit) -> str:
    """What is said where a line of a certificate was edited."""
    shutil.copytree(folder, copy, dirs_exist_ok=True)
    path = copy / f"{NAME}.{number}.cert.jsonl"
    lines = path.read_text().splitlines()
    value = json.loads(lines[line])
    edit(value)
    lines[line] = json.dumps(value)
    path.write_text("\n".join(lines) + "\n")
    return str(check_pose_set(copy / f"{NAME}.pose.json").refused)


HEADERS: dict[str, tuple[Edit, str]] = {
    "all right": (put("outliers", to=0), "another number of wrong dots"),
    "one wrong": (
        lambda header: header.update(wrong=[3], dots=[k for k in header["dots"] if k != 3], outliers=0),
        "not proved that dot 3 is wrong",
    ),
    "after itself": (put("after", to=[f"{NAME}.4.cert.jsonl"]), "on itself"),
    "after the same dots": (put("after", to=[f"{NAME}.1.cert.jsonl"] * 3), "give no box together"),
    "after one group": (put("after", to=[f"{NAME}.1.cert.jsonl"]), SPOILED),
    "no turn": (put("turn", to=["0x0p+0"] * 4), "a quaternion is zero"),
    "another turn": (scaled("turn", 1, **HARDLY), PROVES),
}


@pytest.mark.parametrize("name", HEADERS)
def test_what_a_certificate_rests_on_is_checked(robust: Path, tmp_path: Path, name: str) -> None:
    edit, reasons = HEADERS[name]
    found = edited(robust, tmp_path, 4, 0, edit)
    assert any(reason in found for reason in reasons.split("|")), found


@pytest.mark.parametrize("count", [1, 0])
def test_weights_that_one_wrong_dot_could_spoil_are_refused(robust: Path, tmp_path: Path, count: int) -> None:
    few = put("bounds", 0, 3, to=lambda sets: sets[:count])
    assert "so many wrong dots could spoil all of its weights" in edited(robust, tmp_path, 4, 2, few)


def test_an_edited_weight_or_a_missing_certificate_is_refused(certified: Path, tmp_path: Path) -> None:
    half = put("bounds", 0, 3, "rows", to=lambda rows: [[row, weight // 2] for row, weight in rows])
    assert PROVES.split("|")[0] in edited(certified, tmp_path, 3, 2, half)
    (tmp_path / f"{NAME}.2.cert.jsonl").unlink()
    assert f"{NAME}.2" in str(check_pose_sets(tmp_path)[0].refused)


def test_claims_without_end_are_refused_before_the_work_is_done(certified: Path, tmp_path: Path) -> None:
    shutil.copytree(certified, tmp_path, dirs_exist_ok=True)
    claim = json.loads((tmp_path / f"{NAME}.pose.json").read_text())
    first = (tmp_path / f"{NAME}.1.cert.jsonl").read_text()
    claim["after"] = [f"{NAME}.{k}.cert.jsonl" for k in range(100)]
    for file in claim["after"]:
        (tmp_path / file).write_text(first)
    (tmp_path / f"{NAME}.pose.json").write_text(json.dumps(claim))
    found = check_pose_set(tmp_path / f"{NAME}.pose.json", work=10_000_000)
    assert "more than 64 certificates" in str(found.refused) or "more work than" in str(found.refused)
