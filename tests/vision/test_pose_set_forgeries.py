"""Pose sets that are certified from pixels on: nothing that does not follow from what is assumed is accepted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from fractions import Fraction as F
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.pose_sets import drawn_pose, shown
from cpcal.checker import Refused
from cpcal.checker.bounds import Bounds, between
from cpcal.checker.files import WORK
from cpcal.checker.pose_claim import _Chain, check_pose_set, check_pose_sets
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.pose_sets import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.vision.pose_sets.pose_certificate import digest_of
from cpcal.vision.target import DELTALAB_TARGET, Target

WIDTHS = np.array([0.3, 0.3, 0.2, 0.2, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4])
FEW = Target("few dots", DELTALAB_TARGET.dots[::12], 6.0, ())


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
        boxes, targets, cameras, certificate=folder / "e00-1", sources={"camera.toml": b"the bytes of it"}
    )
    for larger in (1.0 - 1.9e-4, 1.0, 1.0 + 1.9e-4):  # such a plate, so much farther away, looks the same
        assert Pose(larger * pose.position, pose.quaternion) in found
    plain = enclose_pose(boxes, targets, cameras)
    for written, first in (
        (found.position_radius, plain.position_radius),
        (found.rotation_radius, plain.rotation_radius),
    ):
        assert written is not None
        assert first is not None
        assert (written < 1.2 * first).all()
    return folder


def test_the_checker_proves_it_again_from_the_pixels(certified: Path) -> None:
    (found,) = check_pose_sets(certified)
    assert found.refused is None
    assert found.name == "e00-1"
    assert found.radii is not None
    assert dict(found.files).keys() == {"camera.toml"}


@pytest.mark.parametrize("first", [True, False])
def test_a_certificate_begins_with_all_that_there_is(first: bool) -> None:
    """Each lower end raised, each upper end lowered, alone."""
    cameras = SimpleNamespace(size=9, ball=False)
    sight: Any = SimpleNamespace(cameras=cameras, dots=[], about=lambda *_: None)
    chain, unit = _Chain(Path(), "", sight, [], WORK), between(F(-1), F(1))
    before = None if first else [between(F(-k - 1), F(k + 2)) for k in range(6)]
    root = [between(F(-(2**20)), F(2**20))] * 3 + [unit] * 6 if before is None else [*before, *[unit] * 9]

    def follows(box: list[Bounds]) -> None:
        stated: Any = SimpleNamespace(root=box, rows=[], objective=False)
        chain._follows(stated, 0, (), before)

    follows(root)
    for k, side in enumerate(root):
        follows([*root[:k], Bounds(side.lo - 1, side.hi + 1), *root[k + 1 :]])
        for less in (Bounds(side.lo + 1, side.hi), Bounds(side.lo, side.hi - 1)):
            with pytest.raises(Refused, match="begins with less than there is"):
                follows([*root[:k], less, *root[k + 1 :]])


def test_a_claim_that_names_a_certificate_twice_is_refused(certified: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(certified, tmp_path / "copy")
    path = copy / "e00-1.pose.json"
    claim = json.loads(path.read_text())
    claim["chains"] *= 2
    path.write_text(json.dumps(claim))
    found = check_pose_set(path)
    assert found.refused == f"names the certificate '{claim['chains'][0][0]['certificate']}' twice"


Edit = Callable[[dict[str, Any]], None]


def _digit(number: str) -> str:
    """A number that is hardly another one."""
    return (float.fromhex(number) * (1.0 + 1e-3) + 1e-6).hex()


def _pixel(claim: dict[str, Any]) -> None:
    for side in ("lo", "hi"):  # of the dots that carry the proof, by a tenth of a pixel
        for dot in {row[0] for stage in claim["chains"][0] for row in stage["rows"]}:
            x = claim["inputs"]["pixels"][side][dot]
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


def _scale(claim: dict[str, Any]) -> None:
    claim["inputs"]["target"]["scale"] = (4e-4).hex()


def _radius(claim: dict[str, Any]) -> None:
    claim["inputs"]["target"]["radius"] = (7.0).hex()


def _frame(claim: dict[str, Any]) -> None:
    claim["inputs"]["frames"]["camera"][0] = (0.5).hex()


def _narrower(claim: dict[str, Any]) -> None:
    claim["position_radius"] = [(0.99 * float.fromhex(v)).hex() for v in claim["position_radius"]]


def _moved(claim: dict[str, Any]) -> None:
    claim["pose"][2] = (float.fromhex(claim["pose"][2]) + 0.01).hex()


def _refuted(claim: dict[str, Any]) -> None:
    claim["refuted"], claim["position_radius"], claim["rotation_radius"] = True, None, None


def _outliers(claim: dict[str, Any]) -> None:
    claim["outliers"] = 1


def _no_chain(claim: dict[str, Any]) -> None:
    claim["chains"] = []


def _no_start(claim: dict[str, Any]) -> None:
    claim["chains"][0] = claim["chains"][0][1:]


def _side(claim: dict[str, Any]) -> None:
    row = claim["chains"][0][1]["rows"][0]
    row[1] = (row[1] + 1) % 4


EDITS = (_pixel, _camera, _wider_camera, _cube, _target, _plate, _radius, _frame)
CLAIMS = (_scale, _narrower, _moved, _refuted, _outliers, _no_chain, _no_start, _side)


@pytest.mark.parametrize(("edit", "forged"), [(_camera, False), *((edit, True) for edit in (*EDITS, *CLAIMS))])
def test_what_does_not_follow_is_refused(certified: Path, tmp_path: Path, edit: Edit, forged: bool) -> None:
    """Edited, or edited by somebody who renews the digest in all certificates."""
    claim = json.loads((certified / "e00-1.pose.json").read_text())
    before = digest_of(claim["inputs"])
    edit(claim)
    for path in certified.glob("*.cert.jsonl"):
        text = path.read_text()
        assert before in text
        (tmp_path / path.name).write_text(text.replace(before, digest_of(claim["inputs"])) if forged else text)
    path = tmp_path / "e00-1.pose.json"
    path.write_text(json.dumps(claim))
    found = check_pose_set(path)
    assert found.refused is not None
    assert found.radii is None
    if edit in EDITS:
        reasons = ("does not follow", "begins with less than there is") if forged else ("other pixels",)
        assert any(reason in found.refused for reason in reasons)


def test_an_edited_row_of_a_certificate_is_refused(certified: Path, tmp_path: Path) -> None:
    for path in certified.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    path = tmp_path / "e00-1.2.cert.jsonl"
    lines = path.read_text().splitlines()
    row = json.loads(lines[1])
    at = next(k for k, (monomial, _) in enumerate(row["body"]) if not monomial)
    row["body"][at][1] = (float.fromhex(row["body"][at][1]) + 0.01).hex()  # a hundredth of a pixel
    lines[1] = json.dumps(row)
    path.write_text("\n".join(lines) + "\n")
    found = check_pose_set(tmp_path / "e00-1.pose.json")
    assert found.refused is not None
    path.unlink()
    assert "e00-1.2" in str(check_pose_sets(tmp_path)[0].refused)


def _rows_by_the_thousand(claim: dict[str, Any]) -> None:
    rows = claim["chains"][0][1]["rows"]
    claim["chains"][0][1]["rows"] = [rows[0]] * 10_000


def _chains_by_the_hundred(claim: dict[str, Any]) -> None:
    claim["chains"] *= 100


def _a_chain_of_a_hundred(claim: dict[str, Any]) -> None:
    claim["chains"][0] *= 100


@pytest.mark.parametrize("edit", [_rows_by_the_thousand, _chains_by_the_hundred, _a_chain_of_a_hundred])
def test_claims_without_end_are_refused_before_the_work_is_done(certified: Path, tmp_path: Path, edit: Edit) -> None:
    claim = json.loads((certified / "e00-1.pose.json").read_text())
    edit(claim)
    for path in certified.glob("*.cert.jsonl"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    path = tmp_path / "e00-1.pose.json"
    path.write_text(json.dumps(claim))
    refused = str(check_pose_set(path).refused)
    assert "more work than" in refused or "more than 64 chains" in refused
