"""The demo's study by way of images: rendered, detected, and from there on as any other study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from cpcal.cli.detect import show_detections
from cpcal.cli.folders import made
from cpcal.cli.progress import bar
from cpcal.cli.simulate import IMAGES, TABLES, shot_study, write_shots
from cpcal.cli.talk import Talk
from cpcal.common.files import write_file
from cpcal.robot import DELTALAB, Study
from cpcal.vision.batch.detect import Detections, ImageFolder, ImageSource, detect
from cpcal.vision.batch.study_images import RenderedImages, study_table
from cpcal.vision.files.detection import detections_bytes, readings_of

SUBSET = {"runs": 2, "validation_runs": 1, "images": 2}
WHOLE = {"runs": 11, "validation_runs": 10, "images": 11}  # the paper's 14,784 images


@dataclass(frozen=True)
class ImageStudy:
    """A study whose poses come from images. `exact` has the poses that were rendered, row by row of all images."""

    study: Study
    exact: Study
    shots: Mapping[str, RenderedImages]
    found: Mapping[str, Detections]
    rendering: float | None  # seconds, all workers beside each other; None: rendered when measured


def image_study(
    folder: Path, seed: int, imperfect: Mapping[str, float], talk: Talk, *, size: Mapping[str, int], keep: bool
) -> ImageStudy:
    """Render and detect. Images are files below `folder` if they are to be kept; else each is rendered when measured,
    since all of the paper's would take six gigabytes."""
    options: dict[str, Any] = {"seed": seed, **imperfect, **size}
    exact, shots = shot_study(DELTALAB, options)
    count = sum(len(images.names) for images in shots.values())
    talk.say(f"Images: {count:,}, rendered{f' in {folder / IMAGES}' if keep else ''}")
    made(folder)
    start = perf_counter()
    if keep:
        write_shots(exact, shots, folder)
    rendering = perf_counter() - start if keep else None
    found, tables = {}, []
    for name, true in zip(TABLES, (exact.calibration, exact.validation), strict=True):
        source: ImageSource = ImageFolder(folder / IMAGES / name) if keep else shots[name]
        output = folder / f"poses-{name}.csv"
        journal = output.with_name(f"{output.name}.journal")
        with bar(f"{name} images", quiet=talk.quiet) as progress:
            found[name] = detect(source, shots[name].target, shots[name].camera, journal=journal, progress=progress)
        write_file(output, detections_bytes(found[name].rows))
        show_detections(found[name], output, talk)
        tables.append(study_table(found[name].rows, readings_of(true)))
    study = Study(exact.robot, tables[0], tables[1], exact.truth, {**exact.provenance, "poses": "from rendered images"})
    return ImageStudy(study, exact, shots, found, rendering)
