"""target.toml and camera.toml (docs/images.md), read with every problem and its line, written as canonical bytes; and
cameras as OpenCV and ROS write them in YAML."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cpcal.common.documents import KeyPath, TomlReader, array, document, one_of, positive, text, truth, whole
from cpcal.common.errors import InputError, Problems, shown, unusable
from cpcal.common.files import StrPath, small_file, write_file
from cpcal.common.values import Floats, Json, Names, Texts, Value, fill, freeze, frozen_mapping
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, LENSES, PIXELS_MAX, Camera, implausible
from cpcal.vision.opencv import MissingExtraError
from cpcal.vision.target import Target, target_from

T = TypeVar("T")


def _loaded(path: StrPath, format_: str, sections: Names, read: Callable[[TomlReader], T | None]) -> T:
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
    provenance: Texts = field(default_factory=dict)

    def __post_init__(self) -> None:
        fill(self, provenance=frozen_mapping(self.provenance))
        problems = Problems()
        for key, what, remedy in implausible(self.camera):
            problems.wrong(f"camera {key}", what, remedy)
        if self.covariance is not None:
            freeze(self, "covariance")
            if what := _covariance_problem(self.covariance):
                remedy = f"give the covariance of {', '.join(CAMERA_NUMBERS)}"
                problems.wrong("camera covariance", what, remedy)
            if self.camera.model != BROWN:
                what = f"covariance goes with a lens of the model {self.camera.model}"
                problems.wrong("camera covariance", what, _ONLY_BROWN)
        if self.rms is not None and not 0.0 <= self.rms < np.inf:
            problems.wrong("camera rms", f"is {self.rms}", "give pixels, from 0")
        problems.raise_any()


def _covariance_problem(matrix: Floats) -> str:
    """What is wrong with a covariance of the camera's nine numbers; "" where nothing is."""
    count = len(CAMERA_NUMBERS)
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        return f"covariance is not {count} rows of {count} finite numbers"
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale[scale == 0.0] = 1.0
    correlation = matrix / scale[:, None] / scale
    if not np.array_equal(matrix, matrix.T):
        return "covariance is not symmetric"
    definite = np.linalg.eigvalsh(correlation)[0] >= -_NEGATIVE
    return "" if definite else "covariance is of no random numbers: it is not positive semidefinite"


def load_camera(path: StrPath) -> CameraRecord:
    """The camera in a camera.toml, or in a YAML file of OpenCV or ROS.

    Raises one InputError that lists every problem, and MissingExtraError for YAML without PyYAML.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        return CameraRecord(camera_from_yaml(Path(path)))
    return _loaded(path, CAMERA_FORMAT, ("camera", "calibration"), _record)


def save_camera(record: CameraRecord | Camera, path: StrPath) -> None:
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
    if found is None or reader.problems.listed:
        return None

    def place(key: str) -> KeyPath:
        return ("calibration", key) if key in asked else ("camera", "focal" if key == "camera" else key)

    made = partial(CameraRecord, covariance=known.get("covariance"), rms=known.get("rms"), provenance=provenance)
    return reader.made(lambda: made(Camera(**found)), place)


# ------------------------------------------------------------------------------------------------------------------
# The target.

TARGET_FORMAT = "cpcal-target/2"


def load_target(path: StrPath) -> Target:
    """The target in the file `path`, or the board of a short text (`cpcal.vision.target.TEXTS`). Raises one InputError
    that lists every problem."""
    if ":" in str(path) and Path(path).suffix != ".toml":
        return target_from(str(path))
    return _loaded(path, TARGET_FORMAT, ("target",), _target)


def save_target(target: Target, path: StrPath) -> None:
    """Write the target to the file `path`, complete or not at all. Raises InputError when it cannot be written."""
    write_file(Path(path), target_bytes(target))


def target_bytes(target: Target) -> bytes:
    """The canonical target.toml; floats by repr, so that they are read back bit for bit."""
    stated = {key: getattr(target, key) or None for key in ("scale_sigma", "dot_sigma", "board")}  # 0: nothing is said
    keys = {key: getattr(target, key) for key in ("name", "bright", "radius", "dots")}
    return document(TARGET_FORMAT, {"target": keys | stated}, {})


def _target(reader: TomlReader) -> Target | None:
    reader.provenance()
    keys = {"name": text, "radius": positive("mm"), "dots": array((None, 2), "x and y in mm")}
    shares = dict.fromkeys(("scale_sigma", "dot_sigma"), array((), signed=False))
    more = {"bright": truth, "board": text, "scale": positive("true millimetres by stated ones"), **shares}
    found = reader.section("target", keys, more)
    if found is None or reader.problems.listed:
        return None
    scale = found.pop("scale", 1.0)
    found |= {"dots": scale * found["dots"], "radius": scale * found["radius"], "bright": found.get("bright")}
    try:
        return Target(**found)
    except InputError as error:
        for problem in error.problems:
            key = problem.where.rpartition(" ")[2]  # radius, dots, ...
            what = problem.what if problem.what.startswith("(") else f"{key} {problem.what}"
            reader.wrong(("target", "board" if key == "target" else key), what, problem.remedy)
        return None


# ------------------------------------------------------------------------------------------------------------------
# Cameras as OpenCV and ROS write them in YAML.
#
# OpenCV (`cv::FileStorage`): image_width, image_height, camera_matrix and distortion_coefficients as opencv-matrix; a
# fisheye says so by fisheye_model: 1, as its own calibration sample does. ROS (camera_info): the same with rows, cols
# and data, and distortion_model: plumb_bob, rational_polynomial, equidistant or fisheye.

_ROS_MODELS = {"plumb_bob": "brown", "rational_polynomial": "rational", "equidistant": "fisheye", "fisheye": "fisheye"}
_REMEDY = "give a file that OpenCV or ROS wrote"
_HEAD = re.compile(r"\A%YAML:?1\.\d\s*(---)?")  # OpenCV's first line is no YAML
_SKEW = 1e-9  # of the focal length


def yaml_document(path: Path, remedy: str) -> Any:
    """The lists and tables of a YAML file, with whatever stands in them as text.

    Raises InputError, and MissingExtraError without PyYAML.
    """
    content = small_file(path, remedy)
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError(f"cameras in YAML need PyYAML: pip install 'cpcal[vision]' ({error})") from error
    try:
        text = _HEAD.sub("---", content.decode("utf-8-sig"))
        found = yaml.load(text, Loader=yaml.BaseLoader)
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.BaseLoader)):
            raise ValueError("aliases are not understood")  # they make a small file a huge one
        return found
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        what = f"is no YAML: {getattr(error, 'problem', None) or error}"[:200]
        raise unusable(path, what, remedy, None if mark is None else mark.line + 1) from None


def camera_from_yaml(path: Path) -> Camera:
    """The camera in a file that OpenCV or ROS wrote. Raises one InputError with every problem."""
    problems, document = Problems(), yaml_document(path, _REMEDY)
    if not isinstance(document, dict):
        raise unusable(path, "is no table of keys and values", _REMEDY)
    wrong = partial(problems.wrong, path)
    sides = [document.get(f"image_{side}") for side in ("width", "height")]
    if not all(isinstance(side, str) and side.isdecimal() and 0 < float(side) <= PIXELS_MAX for side in sides):
        what = f"image_width and image_height are not two whole numbers from 1 to {PIXELS_MAX:,}"
        wrong(what, "give the size of the images in pixels")
    matrix = _numbers(document, "camera_matrix", wrong)
    distortion = _numbers(document, "distortion_coefficients", wrong)
    model = _model(document, distortion, wrong)
    problems.raise_any()
    if matrix.size != 9:
        raise unusable(path, f"camera_matrix has {matrix.size} numbers", "give 3 x 3")
    fx, skew, cx, zero, fy, cy, *last = matrix.tolist()
    width, height = (int(side) for side in sides if side is not None)
    if not abs(skew) <= _SKEW * abs(fx) or zero or last != [0.0, 0.0, 1.0]:
        raise unusable(path, "camera_matrix is not [fx 0 cx; 0 fy cy; 0 0 1]", "calibrate without skew")
    try:
        camera = Camera(width, height, np.array([fx, fy]), np.array([cx, cy]), distortion, model)
    except InputError as error:
        raise InputError(
            [replace(one, where=str(path), what=f"{one.where} {one.what}") for one in error.problems]
        ) from None
    for key, what, remedy in implausible(camera):
        wrong(f"{key}: {what}", remedy)
    problems.raise_any()
    return camera


def _numbers(document: Json, key: str, wrong: Any) -> Floats:
    """The entries of a matrix, in rows; none where it is wrong."""
    value = document.get(key)
    data: Any = value.get("data") if isinstance(value, dict) else value
    try:
        return np.array([float(v) for v in data])
    except (TypeError, ValueError):
        wrong(f"{key} is {shown(value)}" if key in document else f"{key} is missing", "give a matrix with its data")
        return np.zeros(0)


def _model(document: Json, distortion: Floats, wrong: Any) -> str:
    """The lens: as it is named, or by the count of its numbers. OpenCV's four numbers are k1, k2, p1, p2."""
    named = document.get("distortion_model")
    if named is not None and not (isinstance(named, str) and named in _ROS_MODELS):
        wrong(f"distortion_model is {shown(named)}", f"known are {', '.join(_ROS_MODELS)}")
        return BROWN
    fisheye = document.get("fisheye_model") == "1"
    model = _ROS_MODELS[named] if named else "fisheye" if fisheye else "rational" if len(distortion) == 8 else BROWN
    if model == BROWN and len(distortion) == 4:
        distortion.resize(5, refcheck=False)
    if len(distortion) not in (0, len(LENSES[model])):  # that there are none was said
        names = ", ".join(LENSES[model])
        wrong(f"distortion_coefficients has {len(distortion)} numbers", f"a lens of the model {model} has {names}")
    return model
