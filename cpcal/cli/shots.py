"""`cpcal simulate --study --render`: what an engineer would bring home: images, leg readings, target and camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cpcal.cli.folders import unwritable
from cpcal.cli.progress import bar
from cpcal.files.settings import STUDY_NAME, study_bytes
from cpcal.robot import Robot, Study
from cpcal.simulate import simulate_study
from cpcal.vision.batch.study_images import RenderedImages, camera_above
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.detection import readings_bytes, readings_of
from cpcal.vision.files.plate_and_camera import save_camera, save_target
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene
from cpcal.vision.target import DELTALAB_TARGET

SCENE = Scene(gradient=(0.25, 0.15))
IMAGES = "images"
TARGET_NAME, CAMERA_NAME = "target.toml", "camera.toml"
TABLES = ("calibration", "validation")


def shot_study(nominal: Robot, options: dict[str, Any]) -> tuple[Study, dict[str, RenderedImages]]:
    """A study with exact poses, and for both of its tables the images of them. Raises MissingExtraError."""
    opencv()  # or nothing is begun
    seed = options["seed"]
    exact = {"images": 1, **options, "pose_noise": 0.0, "camera": camera_above(seed=seed)}
    study = simulate_study(nominal, **exact)
    tables = zip(TABLES, (study.calibration, study.validation), strict=True)
    return study, {
        name: RenderedImages.of(table, DELTALAB_TARGET, DELTALAB_CAMERA, SCENE, seed=seed) for name, table in tables
    }


def write_shots(study: Study, images: dict[str, RenderedImages], folder: Path) -> None:
    """The study without its tables of poses: `cpcal detect` makes them. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in zip(TABLES, (study.calibration, study.validation), strict=True):
            with bar(f"{name}: rendering") as progress:
                images[name].write(folder / IMAGES / name, progress=progress)
            (folder / f"{name}-readings.csv").write_bytes(readings_bytes(readings_of(table)))
        save_target(DELTALAB_TARGET, folder / TARGET_NAME)
        save_camera(DELTALAB_CAMERA, folder / CAMERA_NAME)
        (folder / STUDY_NAME).write_bytes(study_bytes(study))
    except OSError as error:
        raise unwritable(folder, error) from None
