"""target.toml and camera.toml (docs/images.md): read with every problem and its line, written as canonical bytes."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import numpy as np

from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.files import write_file
from cpcal.common.values import Floats, Value, fill, frozen_array, frozen_mapping
from cpcal.files.settings import (
    KeyPath,
    TomlReader,
    array,
    document,
    one_of,
    positive,
    text,
    truth,
    whole,
)
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, LENSES, PIXELS_MAX, Camera, implausible
from cpcal.vision.opencv import MissingExtraError
from cpcal.vision.target import Target, wrong_deviations

T = TypeVar("T")


def _loaded(
    path: str | os.PathLike[str], format_: str, sections: tuple[str, ...], read: Callable[[TomlReader], T | None]
) -> T:
    """What `read` makes of the TOML file `path`. Raises one InputError that lists every problem of the file."""
    problems, file = Problems(), Path(path)
    reader = TomlReader.opened(file, format_, sections, problems, "write one as docs/images.md shows")
    found = None if reader is None else read(reader)
    problems.raise_any()
    assert found is not None  # what keeps it from being read is a problem, and was raised
    return found


# ------------------------------------------------------------------------------------------------------------------
# The camera.

CAMERA_FORMAT = "cpcal-camera/1"
YAML_SUFFIXES = (".yaml", ".yml")

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
        fill(self, provenance=frozen_mapping(self.provenance))
        problems = [Problem(f"camera {key}", what, remedy) for key, what, remedy in implausible(self.camera)]
        if self.covariance is not None:
            fill(self, covariance=frozen_array(self.covariance))
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
    return _loaded(path, CAMERA_FORMAT, ("camera", "calibration"), _record)


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
    keys = ("width", "height", "focal", "center", "distortion", *(["model"] if camera.model != BROWN else []))
    sections = {
        "camera": {key: getattr(camera, key) for key in keys},
        "calibration": {"rms": record.rms, "covariance": record.covariance},
    }
    return document(CAMERA_FORMAT, sections, record.provenance)


def _record(reader: TomlReader) -> CameraRecord | None:
    provenance = reader.provenance()
    count, numbers = len(CAMERA_NUMBERS), ", ".join(CAMERA_NUMBERS)
    asked = {"rms": array((), signed=False), "covariance": array((None, count), numbers)}
    known = reader.section("calibration", {}, asked, needed=False) or {}
    stated = reader.document.get("camera")
    lens = stated.get("model", BROWN) if isinstance(stated, dict) else BROWN
    names = LENSES.get(lens, ()) if isinstance(lens, str) else ()
    sides = whole(1, PIXELS_MAX)
    keys = {
        "width": sides,
        "height": sides,
        "focal": array((2,), "fx and fy in pixels", signed=False),
        "center": array((2,), "cx and cy in pixels"),
        "distortion": array((len(names) or None,), ", ".join(names)),
    }
    found = reader.section("camera", keys, {"model": one_of(LENSES)})
    if found is None:
        return None
    covariance = known.get("covariance")
    if covariance is not None:
        for what, remedy in covariance_problems(covariance):
            reader.wrong(("calibration", "covariance"), what, remedy)
        if lens != BROWN:
            what = f"covariance goes with a lens of the model {lens}"
            reader.wrong(("calibration", "covariance"), what, _ONLY_BROWN)
    if 0.0 in found["focal"]:
        reader.wrong(("camera", "focal"), "focal holds 0", "give positive numbers of pixels")
    if reader.problems.listed:
        return None
    camera = Camera(**found)
    for key, what, remedy in implausible(camera):
        reader.wrong(("camera", key), what, remedy)
    return None if reader.problems.listed else CameraRecord(camera, covariance, known.get("rms"), provenance)


# ------------------------------------------------------------------------------------------------------------------
# The target.

TARGET_FORMAT = "cpcal-target/1"

_MEASURED = ("scale", "scale_sigma", "dot_sigma")  # of the plate as it was printed


def load_target(path: str | os.PathLike[str]) -> Target:
    """The target in the file `path`. Raises one InputError that lists every problem of the file."""
    return _loaded(path, TARGET_FORMAT, ("target",), _target)


def save_target(target: Target, path: str | os.PathLike[str], provenance: dict[str, str] | None = None) -> None:
    """Write the target to the file `path`, complete or not at all. Raises InputError when it cannot be written."""
    write_file(Path(path), target_bytes(target, provenance))


def target_bytes(target: Target, provenance: dict[str, str] | None = None) -> bytes:
    """The canonical target.toml; floats by repr, so that they are read back bit for bit."""
    keys = ("name", "bright", "radius", "scale_sigma", "dot_sigma", "lines", "dots")
    stated = {key: getattr(target, key) or None for key in keys[3:5]}  # 0: nothing is stated
    return document(TARGET_FORMAT, {"target": {key: getattr(target, key) for key in keys} | stated}, provenance or {})


def _target(reader: TomlReader) -> Target | None:
    reader.provenance()
    keys = {
        "name": text,
        "bright": truth,
        "radius": positive("mm"),
        "lines": _lines,
        "dots": array((None, 2), "x and y in mm"),
    }
    measured = [positive("true millimetres by stated ones"), *[array((), signed=False)] * 2]
    found = reader.section("target", keys, dict(zip(_MEASURED, measured, strict=True)))
    if found is None:
        return None
    scale, lines, count = found.pop("scale", 1.0), found["lines"], len(found["dots"])
    found |= {"dots": scale * found["dots"], "radius": scale * found["radius"]}
    for i, row in enumerate(lines):
        for number in row:
            if not 0 <= number < count:
                what = f"row {i} of lines names the dot {number}, which is not there"
                reader.wrong(("target", "lines"), what, f"dots are numbered from 0 to {count - 1}")
    if reader.problems.listed:
        return None
    radius = found["radius"]
    of_scale, of_dots = (found.get(key, 0.0) for key in _MEASURED[1:])
    wrong = Target.problems_of(found["dots"], radius, lines) or wrong_deviations(of_scale, of_dots, radius)
    for problem in wrong:
        key = problem.where.rpartition(" ")[2]  # radius, dots or lines
        what = problem.what if problem.what.startswith(("(", "the")) else f"{key} {problem.what}"
        reader.wrong(("target", key), what, problem.remedy)
    return None if reader.problems.listed else Target(**found)


def _lines(reader: TomlReader, path: KeyPath, value: object) -> tuple[tuple[int, ...], ...]:
    """Rows of whole numbers."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        reader.wrong(path, "lines is not a list of rows", "write lines = [[0, 1, 2, 3], ...], numbers of dots from 0")
        return ()
    for i, row in enumerate(value):
        for number in row:
            if isinstance(number, bool) or not isinstance(number, int):
                reader.wrong(path, f"row {i} of lines holds {shown(number)}", "give whole numbers, dots from 0")
    return tuple(tuple(row) for row in value)
