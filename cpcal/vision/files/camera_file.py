"""camera.toml (docs/vision-files.md): read with every problem and its line, written as canonical bytes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.values import Value, frozen_array, frozen_mapping
from cpcal.files.campaign_writer import matrix, provenance_lines, quoted, vector
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, Camera
from cpcal.vision.files.plausible_camera import PIXELS_MAX, implausible
from cpcal.vision.files.sections import TomlReader, opened
from cpcal.vision.lens_models import LENSES
from cpcal.vision.opencv import MissingExtraError

CAMERA_FORMAT = "cpcal-camera/1"
YAML_SUFFIXES = (".yaml", ".yml")

_KEYS = ("width", "height", "focal", "center", "distortion")
_OPTIONAL = ("model",)
_ONLY_BROWN = f"leave it out, or give a camera of the model {BROWN}"
_NEGATIVE = 1e-9  # the least eigenvalue of a correlation matrix that rounding can make


@dataclass(frozen=True, eq=False)
class CameraRecord(Value):
    """What camera.toml says.

    covariance  (9, 9) of fx, fy, cx, cy (pixels), k1, k2, p1, p2, k3, or None
    rms         of the calibration's residuals, pixels per axis, or None

    Raises InputError for a camera that cannot be, a covariance that is none, or a negative RMS.
    """

    camera: Camera
    covariance: Floats | None = None
    rms: float | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", frozen_mapping(self.provenance))
        problems = [Problem(f"camera {key}", what, remedy) for key, what, remedy in implausible(self.camera)]
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen_array(self.covariance))
            problems += [Problem("camera covariance", *wrong) for wrong in covariance_problems(self.covariance)]
            if self.camera.model != BROWN:
                what = f"goes with a lens of the model {self.camera.model}"
                problems.append(Problem("camera covariance", what, _ONLY_BROWN))
        if self.rms is not None and not 0.0 <= self.rms < np.inf:
            problems.append(Problem("camera rms", f"is {self.rms}", "give pixels, from 0"))
        if problems:
            raise InputError(problems)


def covariance_problems(matrix: Floats) -> list[tuple[str, str]]:
    """What is wrong with a covariance of the camera's nine numbers, and the remedies."""
    count = len(CAMERA_NUMBERS)
    remedy = f"give the covariance of {', '.join(CAMERA_NUMBERS)}"
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        return [(f"covariance is not {count} rows of {count} finite numbers", remedy)]
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale[scale == 0.0] = 1.0
    correlation = matrix / scale[:, None] / scale
    if not np.array_equal(matrix, matrix.T):
        return [("covariance is not symmetric", remedy)]
    if not np.linalg.eigvalsh(correlation)[0] >= -_NEGATIVE:
        return [("covariance is of no random numbers: it is not positive semidefinite", remedy)]
    return []


def load_camera(path: str | os.PathLike[str]) -> CameraRecord:
    """The camera in a camera.toml, or in a YAML file of OpenCV or ROS.

    Raises one InputError that lists every problem, and MissingExtraError for YAML without PyYAML.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        return CameraRecord(camera_yaml().camera_from_yaml(Path(path)))
    problems = Problems()
    reader = opened(path, CAMERA_FORMAT, ("camera", "calibration"), problems)
    record = None if reader is None else _record(reader)
    problems.raise_any()
    assert record is not None  # what keeps it from being read is a problem, and was raised
    return record


def camera_yaml() -> ModuleType:
    """The module that reads and writes YAML. Raises MissingExtraError that says how to install what it needs."""
    try:
        from cpcal.vision.files import camera_yaml as module
    except ImportError as error:
        raise MissingExtraError(f"cameras in YAML need PyYAML: pip install 'cpcal[vision]' ({error})") from error
    return module


def save_camera(record: CameraRecord | Camera, path: str | os.PathLike[str]) -> None:
    """Write the camera to the file `path`, complete or not at all. Raises InputError when it cannot be written."""
    write_file(Path(path), camera_bytes(record))


def camera_bytes(record: CameraRecord | Camera) -> bytes:
    """The canonical camera.toml; floats by repr, so that they are read back bit for bit."""
    if isinstance(record, Camera):
        record = CameraRecord(record)
    camera = record.camera
    lines = [f"format = {quoted(CAMERA_FORMAT)}", "", "[camera]"]
    lines += [f"width = {int(camera.width)}", f"height = {int(camera.height)}"]
    lines += [f"{name} = {vector(getattr(camera, name))}" for name in ("focal", "center", "distortion")]
    if camera.model != BROWN:
        lines.append(f"model = {quoted(camera.model)}")
    if record.rms is not None or record.covariance is not None:
        lines += ["", "[calibration]"]
    if record.rms is not None:
        lines.append(f"rms = {float(record.rms)!r}")
    if record.covariance is not None:
        lines.append(f"covariance = {matrix(record.covariance)}")
    return ("\n".join([*lines, *provenance_lines(record.provenance)]) + "\n").encode()


def _record(reader: TomlReader) -> CameraRecord | None:
    provenance = reader.provenance()
    covariance, rms = _calibration(reader)
    table = reader.required("camera", _KEYS, _OPTIONAL)
    if table is None:
        return None
    sides = [reader.whole(("camera", key), table, 1, PIXELS_MAX) for key in ("width", "height")]
    focal = reader.numbers(("camera", "focal"), table, 2, "fx and fy in pixels", signed=False)
    center = reader.numbers(("camera", "center"), table, 2, "cx and cy in pixels", signed=True)
    model = reader.text(("camera", "model"), {"model": BROWN, **table})
    if model not in LENSES:
        reader.wrong(("camera", "model"), f"model is {shown(model)}", f"give one of {', '.join(LENSES)}")
        return None
    names = LENSES[model].names
    distortion = reader.numbers(("camera", "distortion"), table, len(names), ", ".join(names), signed=True)
    if 0.0 in focal:
        reader.wrong(("camera", "focal"), "focal holds 0", "give positive numbers of pixels")
    if reader.problems.listed:
        return None
    camera = Camera(sides[0], sides[1], np.array(focal), np.array(center), np.array(distortion), model)
    for key, what, remedy in implausible(camera):
        reader.wrong(("camera", key), what, remedy)
    if covariance is not None and model != BROWN:
        what = f"covariance goes with a lens of the model {model}"
        reader.wrong(("calibration", "covariance"), what, _ONLY_BROWN)
    return None if reader.problems.listed else CameraRecord(camera, covariance, rms, provenance)


def _calibration(reader: TomlReader) -> tuple[Floats | None, float | None]:
    table = reader.section("calibration")
    if table is None:
        return None, None
    path, before = ("calibration",), len(reader.problems)
    reader.known(path, table, ("rms", "covariance"))
    rms = reader.number((*path, "rms"), "rms", table["rms"], signed=False) if "rms" in table else None
    rows = reader.rows((*path, "covariance"), table, len(CAMERA_NUMBERS), ", ".join(CAMERA_NUMBERS))
    if len(reader.problems) > before or "covariance" not in table:
        return None, rms
    covariance = np.array(rows, dtype=np.float64)
    for what, remedy in covariance_problems(covariance):
        reader.wrong((*path, "covariance"), what, remedy)
    return covariance, rms
