"""Pose sets that are certified from pixels on: nothing that does not follow from what is assumed is accepted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.pose_sets import drawn_pose, shown
from cpcal.checker.sight import check_pose_set, check_pose_sets, digest_of
from cpcal.models.sight import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET, Target

WIDTHS = np.array([0.3, 0.3, 0.2, 0.2, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4])
FEW = Target("few dots", DELTALAB_TARGET.dots[::8], 6.0, ())
NAME = "e00-1"


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pose set of everything uncertain, with its certificates."""
    folder = tmp_path_factory.mktemp("sets")
    rng = np.random.default_rng(7)
    targets = TargetSet.within(FEW, 0.01, scale=2e-4)
    cameras = CameraSet.ellipsoid(DELTALAB_CAMERA, np.diag(WIDTHS**2), 1.0)
    pose = drawn_pose(rng)
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
    cameras, targets = CameraSet(DELTALAB_CAMERA), TargetSet.of(FEW)
    pose = drawn_pose(rng)
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


Edit = Callable[[dict[str, Any]], None]


def _digit(number: str) -> str:
    """A number that is hardly another one."""
    return (float.fromhex(number) * (1.0 + 1e-3) + 1e-6).hex()


def _pixel(claim: dict[str, Any]) -> None:
    for side in ("lo", "hi"):  # of all dots, by a tenth of a pixel
        for x in claim["inputs"]["pixels"][side]:
            x[0] = (float.fromhex(x[0]) + 0.1).hex()


def _camera(claim: dict[str, Any]) -> None:
    numbers = claim["inputs"]["camera"]["numbers"]
    numbers[0] = _digit(numbers[0])


def _wider_camera(claim: dict[str, Any]) -> None:
    rows = claim["inputs"]["camera"]["spread"]
    claim["inputs"]["camera"]["spread"] = [[(1.1 * float.fromhex(v)).hex() for v in row] for row in rows]


def _cube(claim: dict[str, Any]) -> None:
    claim["inputs"]["camera"]["ball"] = False


def _target(claim: dict[str, Any]) -> None:
    dots = claim["inputs"]["target"]["dots"]
    claim["inputs"]["target"]["dots"] = [[_digit(v) for v in dot] for dot in dots]


def _plate(claim: dict[str, Any]) -> None:
    widths = claim["inputs"]["target"]["half_widths"]
    claim["inputs"]["target"]["half_widths"] = [[(1.1 * float.fromhex(v)).hex() for v in one] for one in widths]


def _radius(claim: dict[str, Any]) -> None:
    claim["inputs"]["target"]["radius"] = (9.0).hex()


def _frame(claim: dict[str, Any]) -> None:
    claim["inputs"]["frames"]["camera"][0] = (0.5).hex()


def _scale(claim: dict[str, Any]) -> None:
    claim["inputs"]["target"]["scale"] = (4e-4).hex()


def _narrower(claim: dict[str, Any]) -> None:
    claim["position_radius"] = [(0.99 * float.fromhex(v)).hex() for v in claim["position_radius"]]


def _wider(claim: dict[str, Any]) -> None:
    claim["rotation_radius"] = [(1.01 * float.fromhex(v)).hex() for v in claim["rotation_radius"]]


def _moved(claim: dict[str, Any]) -> None:
    claim["pose"][2] = (float.fromhex(claim["pose"][2]) + 0.01).hex()


def _refuted(claim: dict[str, Any]) -> None:
    claim["refuted"], claim["position_radius"], claim["rotation_radius"] = True, None, None


def _outliers(claim: dict[str, Any]) -> None:
    claim["outliers"] = 1


def _nothing(claim: dict[str, Any]) -> None:
    claim["after"] = []


def _twice(claim: dict[str, Any]) -> None:
    claim["after"] *= 2


def _elsewhere(claim: dict[str, Any]) -> None:
    claim["after"] = ["../other.cert.jsonl"]


def _wrong(claim: dict[str, Any]) -> None:
    claim["wrong"] = [3]


def _no_such_dot(claim: dict[str, Any]) -> None:
    claim["wrong"] = [len(claim["inputs"]["pixels"]["numbers"])]


PROVES = "the weights prove less|do not exclude|prove a wider box"
EDITS = {
    _pixel: PROVES, _camera: PROVES, _wider_camera: PROVES, _cube: f"{PROVES}|there is no row ball", _target: PROVES,
    _plate: PROVES, _radius: PROVES, _frame: PROVES,
}  # fmt: skip
CLAIMS = {
    _scale: "prove a wider box", _narrower: "prove a wider box", _wider: "states a wider box",
    _moved: "a wider box", _refuted: "a pose is not excluded",
    _outliers: "so many wrong dots could spoil all of its certificates",
    _nothing: "give no box together", _twice: "give no box together", _elsewhere: "names no certificate of its folder",
    _wrong: "not proved that dot 3 is wrong", _no_such_dot: "a dot that is not there",
}  # fmt: skip


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


@pytest.mark.parametrize("edit", [*EDITS, *CLAIMS])
def test_what_does_not_follow_is_refused(certified: Path, tmp_path: Path, edit: Edit) -> None:
    found = refusal(certified, tmp_path, edit)
    assert any(reason in found for reason in (EDITS | CLAIMS)[edit].split("|")), found


def test_certificates_about_other_pixels_are_refused(certified: Path, tmp_path: Path) -> None:
    assert "about other pixels" in refusal(certified, tmp_path, _camera, renewed=False)


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


def _all_right(header: dict[str, Any]) -> None:
    header["outliers"] = 0


def _one_wrong(header: dict[str, Any]) -> None:
    header["wrong"], header["dots"], header["outliers"] = [3], [k for k in header["dots"] if k != 3], 0


def _on_itself(header: dict[str, Any]) -> None:
    header["after"] = [f"{NAME}.4.cert.jsonl"]


def _same_dots(header: dict[str, Any]) -> None:
    header["after"] = [f"{NAME}.1.cert.jsonl"] * 3


def _one_group(header: dict[str, Any]) -> None:
    header["after"] = [f"{NAME}.1.cert.jsonl"]


def _no_turn(header: dict[str, Any]) -> None:
    header["turn"] = ["0x0p+0"] * 4


def _other_turn(header: dict[str, Any]) -> None:
    header["turn"][1] = _digit(header["turn"][1])


HEADERS = {
    _all_right: "another number of wrong dots", _one_wrong: "not proved that dot 3 is wrong", _on_itself: "on itself",
    _same_dots: "give no box together", _one_group: "so many wrong dots could spoil all of its certificates",
    _no_turn: "a quaternion is zero", _other_turn: PROVES,
}  # fmt: skip


@pytest.mark.parametrize("edit", list(HEADERS))
def test_what_a_certificate_rests_on_is_checked(robust: Path, tmp_path: Path, edit: Edit) -> None:
    found = edited(robust, tmp_path, 4, 0, edit)
    assert any(reason in found for reason in HEADERS[edit].split("|")), found


def _one_set(step: dict[str, Any]) -> None:
    step["bounds"][0][3] = step["bounds"][0][3][:1]


def _no_set(step: dict[str, Any]) -> None:
    step["bounds"][0][3] = []


@pytest.mark.parametrize("edit", [_one_set, _no_set])
def test_weights_that_one_wrong_dot_could_spoil_are_refused(robust: Path, tmp_path: Path, edit: Edit) -> None:
    assert "so many wrong dots could spoil all of its weights" in edited(robust, tmp_path, 4, 2, edit)


def test_an_edited_weight_or_a_missing_certificate_is_refused(certified: Path, tmp_path: Path) -> None:
    def half(step: dict[str, Any]) -> None:
        weight = step["bounds"][0][3]["rows"][0]
        weight[1] //= 2

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
