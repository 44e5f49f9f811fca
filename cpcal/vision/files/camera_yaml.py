"""Cameras as OpenCV and ROS write them in YAML, read and written.

OpenCV (`cv::FileStorage`): image_width, image_height, camera_matrix and distortion_coefficients as opencv-matrix; a
fisheye says so by fisheye_model: 1, as its own calibration sample does. ROS (camera_info): the same with rows, cols and
data, and distortion_model: plumb_bob, rational_polynomial, equidistant or fisheye.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.files import small_file
from cpcal.common.values import Floats
from cpcal.vision.camera import BROWN, LENSES, PIXELS_MAX, Camera, implausible

STYLES = ("opencv", "ros")

_ROS_MODELS = {
    "plumb_bob": "brown",
    "rational_polynomial": "rational",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
_REMEDY = "give a file that OpenCV or ROS wrote"
_KINDS = ("null", "bool", "int", "float", "str", "timestamp", "value", "seq", "map", "opencv-matrix")
_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in _KINDS}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)  # also 1e-05, which YAML 1.1 takes for a text
_DIGITS_MAX = 300  # of a whole number: one that is a float, too
_WORDS: dict[str, Any] = {
    ".nan": math.nan,
    ".inf": math.inf,
    "-.inf": -math.inf,
    "true": True,
    "false": False,
    "null": None,
    "~": None,
    "": None,
}
_HEAD = re.compile(r"\A%YAML:?1\.\d\s*(---)?")  # OpenCV's first line is no YAML
_SKEW = 1e-9  # of the focal length


def camera_from_yaml(path: Path) -> Camera:
    """The camera in a file that OpenCV or ROS wrote. Raises one InputError with every problem."""
    problems = Problems()
    content = small_file(path, problems, "give a camera.toml, or a YAML file of OpenCV or ROS")
    problems.raise_any()
    assert content is not None
    document = yaml_document(content, path)
    if not isinstance(document, dict):
        raise InputError([Problem(str(path), "is no table of keys and values", _REMEDY)])
    camera = _camera(document, str(path), problems)
    problems.raise_any()
    assert camera is not None  # what keeps it from being read is a problem, and was raised
    return camera


def yaml_document(content: bytes, path: Path) -> Any:
    """The lists, tables, texts and numbers of a YAML file, OpenCV's matrices as tables. Raises InputError."""
    line = None
    try:
        return _plain(yaml.compose(_HEAD.sub("---", content.decode("utf-8-sig")), Loader=yaml.SafeLoader), set())
    except RecursionError:
        what = "it is nested too deeply"
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        what = str(getattr(error, "problem", None) or error)
    raise InputError([Problem(str(path), f"is no YAML: {what}"[:200], _REMEDY, line)])


def _plain(node: yaml.Node | None, seen: set[int]) -> Any:
    """The value of a node. PyYAML's own constructors raise all kinds of errors, and make objects nobody asked for."""
    if node is None:
        return None
    if id(node) in seen:  # an alias could make a small file a huge one
        raise yaml.MarkedYAMLError(problem="aliases are not understood", problem_mark=node.start_mark)
    seen.add(id(node))
    if node.tag not in _TAGS:
        what = f"the tag {shown(node.tag)} is not understood"
        raise yaml.MarkedYAMLError(problem=what, problem_mark=node.start_mark)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(part, seen) for part in node.value]
    if isinstance(node, yaml.MappingNode):
        table = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key is no text", problem_mark=key.start_mark)
            if key.value in table:
                what = f"the key {shown(key.value)} is there twice"
                raise yaml.MarkedYAMLError(problem=what, problem_mark=key.start_mark)
            table[key.value] = _plain(value, seen)
        return table
    assert isinstance(node, yaml.ScalarNode)  # there is no other kind
    if node.style is None and _NUMBER.fullmatch(node.value):
        whole = node.value.lstrip("+-").isdecimal() and len(node.value) <= _DIGITS_MAX
        return int(node.value) if whole else float(node.value)
    return _WORDS.get(node.value.lower(), node.value) if node.style is None else node.value


def _camera(document: dict[str, Any], where: str, problems: Problems) -> Camera | None:
    def wrong(what: str, remedy: str) -> None:
        problems.add(Problem(where, what, remedy))

    sides = [document.get(f"image_{side}") for side in ("width", "height")]
    if not all(type(side) is int and 0 < side <= PIXELS_MAX for side in sides):
        what = f"image_width and image_height are not two whole numbers from 1 to {PIXELS_MAX:,}"
        wrong(what, "give the size of the images in pixels")
    matrix = _numbers(document, "camera_matrix", wrong)
    distortion = _numbers(document, "distortion_coefficients", wrong)
    model = _model(document, distortion, wrong)
    if problems.listed or matrix is None or distortion is None or model is None:
        return None
    if matrix.size != 9:
        wrong(f"camera_matrix has {matrix.size} numbers", "give 3 x 3")
        return None
    fx, skew, cx, zero, fy, cy, *last = matrix.tolist()
    width, height = (int(side) for side in sides if side is not None)
    if not abs(skew) <= _SKEW * abs(fx) or zero or last != [0.0, 0.0, 1.0]:
        wrong("camera_matrix is not [fx 0 cx; 0 fy cy; 0 0 1]", "calibrate without skew")
        return None
    try:
        camera = Camera(width, height, np.array([fx, fy]), np.array([cx, cy]), distortion, model)
    except InputError as error:
        for problem in error.problems:
            wrong(f"{problem.where} {problem.what}", problem.remedy)
        return None
    for key, what, remedy in implausible(camera):
        wrong(f"{key}: {what}", remedy)
    return camera


def _numbers(document: dict[str, Any], key: str, wrong: Any) -> Floats | None:
    """The entries of a matrix, in rows."""
    value = document.get(key)
    data = value.get("data") if isinstance(value, dict) else value
    flat = data if isinstance(data, list) else None
    if flat is None or not all(type(v) in (int, float) for v in flat):
        wrong(f"{key} is {shown(value)}" if key in document else f"{key} is missing", "give a matrix with its data")
        return None
    return np.array(flat, dtype=np.float64)


def _model(document: dict[str, Any], distortion: Floats | None, wrong: Any) -> str | None:
    """The lens: as it is named, or by the count of its numbers. OpenCV's four numbers are k1, k2, p1, p2."""
    named = document.get("distortion_model")
    if named is not None and not (isinstance(named, str) and named in _ROS_MODELS):
        wrong(f"distortion_model is {shown(named)}", f"known are {', '.join(_ROS_MODELS)}")
        return None
    if distortion is None:
        return None
    fisheye = document.get("fisheye_model") == 1
    model = _ROS_MODELS[named] if named else "fisheye" if fisheye else "rational" if len(distortion) == 8 else BROWN
    if model == BROWN and len(distortion) == 4:
        distortion.resize(5, refcheck=False)
    if len(distortion) != len(LENSES[model]):
        names = ", ".join(LENSES[model])
        wrong(f"distortion_coefficients has {len(distortion)} numbers", f"a lens of the model {model} has {names}")
        return None
    return model


def camera_yaml(camera: Camera, style: str) -> bytes:
    """The camera as OpenCV or ROS (`style`, one of STYLES) reads it; floats by repr."""
    (fx, fy), (cx, cy) = camera.focal.tolist(), camera.center.tolist()
    matrix, lens = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], camera.distortion.tolist()
    lines = [f"image_width: {camera.width}", f"image_height: {camera.height}"]
    if style == "opencv":
        lines = ["%YAML:1.0", "---", *lines]
        if camera.model == "fisheye":
            lines.append("fisheye_model: 1")
        tag, kind = " !!opencv-matrix", ["   dt: d"]
    else:
        ros = next(name for name, model in _ROS_MODELS.items() if model == camera.model)
        lines += ["camera_name: camera", f"distortion_model: {ros}"]
        tag, kind = "", []
    tables = [("camera_matrix", matrix, 3), ("distortion_coefficients", lens, 1)]
    if style == "ros":  # camera_info holds these besides: no rectification
        projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]
        tables += [("rectification_matrix", np.eye(3).ravel().tolist(), 3), ("projection_matrix", projection, 3)]
    for key, values, rows in tables:
        lines += [f"{key}:{tag}", f"   rows: {rows}", f"   cols: {len(values) // rows}", *kind]
        lines.append(f"   data: [{', '.join(map(repr, values))}]")
    return ("\n".join(lines) + "\n").encode()
