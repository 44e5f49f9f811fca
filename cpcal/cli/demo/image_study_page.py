"""What the demo's page says of the images that its study came from."""

from __future__ import annotations

import math
from pathlib import PurePosixPath

import numpy as np

from cpcal.cli.demo.image_study import ImageStudy
from cpcal.common.values import Floats
from cpcal.report.study_report import ImagesFound, Picture, TextTable, picture
from cpcal.robot import PoseTable, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.vision.batch.study_images import RenderedImages
from cpcal.vision.files.detection import POSITION, QUATERNION, RMS, SIGMA, by_reason, values_of
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.render import overlay

PAPER_PACE = 14_784 / (3 * 3600.0)  # images a second
_PICTURES, _WIDTH = 6, 480
_AXES = ("x", "y", "z", "rx", "ry", "rz")


def images_found(done: ImageStudy) -> ImagesFound:
    """All but the pixel sets."""
    return ImagesFound(_said(done), tuple(_pictures(done)), _counts(done), _errors(done), _time(done))


def _said(done: ImageStudy) -> tuple[str, ...]:
    images = next(iter(done.shots.values()))
    scene, camera, target = images.scene, images.camera, images.target
    count = sum(len(found.rows) for found in done.found.values())
    light = [f"{100 * share:.0f} %" for share in scene.gradient]
    return (
        f"The poses of this study come from {count:,} rendered images of {camera.width} x {camera.height} pixels: a "
        f"camera with a focal length of {camera.focal[0]:.0f} pixels and an ordinary lens's distortion, aimed by eye, "
        f"sees the target “{target.name}” of {len(target.dots)} dots. Blur {scene.blur:g} px, noise {scene.noise:g} "
        f"grey levels of 256, light that grows by {light[0]} from left to right and by {light[1]} downwards.",
        "Dots are found to a hundredth of a pixel or better, told apart by the cross-ratios along the two diagonals, "
        "and the pose is fitted to where the model of an imaged dot says its centre should be.",
    )


def _counts(done: ImageStudy) -> TextTable:
    lines: list[tuple[str, ...]] = []
    for name, found in done.found.items():
        values = values_of(found.rows)
        dots = np.median([row.dots for row in found.rows if row.found])
        rms = np.median(values[:, RMS])
        lines.append((name, f"{len(found.rows):,}", f"{len(values):,}", f"{dots:.0f}", f"{rms:.4f}"))
        lines += [
            (f"no pose: {reason}", f"{len(files):,}", "", "", "") for reason, files in by_reason(found.rows).items()
        ]
    return TextTable(("images of", "images", "poses", "dots, median", "residual, median RMS [px]"), tuple(lines))


def _errors(done: ImageStudy) -> TextTable:
    """Of all images, in the camera frame."""
    errors, sigmas = [], []
    for (name, found), table in zip(done.found.items(), (done.exact.calibration, done.exact.validation), strict=True):
        true = dict(zip(done.shots[name].names, range(len(table)), strict=True))
        values = values_of(found.rows)
        errors.append(_pose_errors(values, table, [true[row.file] for row in found.rows if row.found]))
        sigmas.append(values[:, SIGMA])
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    scaled = np.where(np.arange(6) < 3, 1e3, 1e3 * 180.0 / math.pi)
    shown = {
        "error, RMS": np.sqrt(np.mean(error**2, axis=0)) * scaled,
        "error, largest": np.abs(error).max(axis=0) * scaled,
        "stated standard deviation, RMS": np.sqrt(np.mean(sigma**2, axis=0)) * scaled,
    }
    ratio = np.sqrt(np.mean((error / sigma) ** 2, axis=0))
    rows = [(name, *(f"{v:.2f}" for v in row)) for name, row in shown.items()]
    rows.append(("error / its stated deviation, RMS", *(f"{v:.2f}" for v in ratio)))
    head = ("", *(f"{axis} [{'µm' if k < 3 else '10⁻³ °'}]" for k, axis in enumerate(_AXES)))
    return TextTable(head, tuple(rows))


def _pose_errors(values: Floats, table: PoseTable, rows: list[int]) -> Floats:
    """(m, 6): mm, and rad of the rotation vector in the camera frame."""
    turn = quaternion_product(values[:, QUATERNION], quaternion_conjugate(table.quaternion[rows]))
    return np.concatenate([values[:, POSITION] - table.position[rows], rotation_vector(turn)], axis=1)


def _time(done: ImageStudy) -> TextTable:
    count = sum(found.measured for found in done.found.values())
    work: dict[str, float] = {}
    for found in done.found.values():
        for stage, seconds in found.seconds.items():
            work[stage] = work.get(stage, 0.0) + seconds
    rows = []
    if done.rendering is not None:
        rows.append(("rendering and writing, side by side", f"{done.rendering:.1f}", ""))
    for stage, seconds in work.items():
        rows.append((stage, f"{seconds:.1f}", f"{1e3 * seconds / max(count, 1):.1f}"))
    total = sum(seconds for stage, seconds in work.items() if stage != RenderedImages.stage)
    pace = f"{count / total:.0f}" if total > 0.0 else "—"
    but = " but rendering" if RenderedImages.stage in work else ""
    rows.append((f"all{but}: {pace} images a second of work; the paper: {PAPER_PACE:.1f}", f"{total:.1f}", ""))
    return TextTable(("stage", "work [s]", "an image [ms]"), tuple(rows))


def _pictures(done: ImageStudy) -> list[Picture]:
    """Some images of the calibration, evenly spread."""
    images = done.shots["calibration"]
    rows = [row.file for row in done.found["calibration"].rows if row.found]
    out = []
    for name in [rows[k] for k in np.linspace(0, len(rows) - 1, min(_PICTURES, len(rows))).astype(int)]:
        image = images.read(name)
        try:
            found = measure_pose(image, images.target, images.camera)
        except NotMeasured:  # rendered anew it is the same image, so that this does not happen
            continue
        pose, run, shot = PurePosixPath(name).with_suffix("").parts
        caption = f"configuration {pose}, run {run}, image {shot}: {len(found.numbers)} dots"
        height = round(_WIDTH * image.shape[0] / image.shape[1])
        out.append(picture(caption, overlay(image, found, images.target, images.camera, _WIDTH), (_WIDTH, height)))
    return out
