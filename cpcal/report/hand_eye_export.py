"""The camera's frame of a hand-eye run, as other programs take it, with the proved ranges beside each number.

What is written are the best frames found: those that attain the upper end of the bracket. Lengths are in m where the
format has them in m.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from cpcal.common.numbers import at_least, bracket_text, rounded_down, rounded_up
from cpcal.handeye.certify import HandEyeResult
from cpcal.robot import normalised, rotation_matrix


def hand_eye_text(found: HandEyeResult, form: str) -> str:
    """The text of one of HAND_EYE_FORMS."""
    return HAND_EYE_FORMS[form](found)


def _parent(found: HandEyeResult) -> str:
    return "tool0" if found.setup == "eye-in-hand" else "base_link"


def _told(found: HandEyeResult, mark: str) -> list[str]:
    """What is proved, as comments."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    said = [f"cpcal {found.version}, {found.setup}: camera in {_parent(found)}; eps* in [{low}, {high}] px"]
    if found.ranges.empty:
        return [f"{mark} {said[0]}"]
    said.append(f"proved of all frames that explain every pixel to {at_least(found.ranges.eps, 4)} px:")
    names = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
    for k, name in enumerate(names):
        unit = "mm" if k < 3 else "deg from the rotation below"
        said.append(f"  {name}: {rounded_down(found.ranges.low[k], 4)} to {rounded_up(found.ranges.high[k], 4)} {unit}")
    return [f"{mark} {line}" for line in said]


def _metres(found: HandEyeResult) -> list[str]:
    return [repr(v / 1000.0) for v in found.point.camera_position]


def _quaternion(found: HandEyeResult) -> list[str]:
    return [repr(v) for v in found.point.camera_quaternion]


def _ros2(found: HandEyeResult) -> str:
    """A node of a ROS 2 launch file in Python."""
    (x, y, z), (w, i, j, k) = _metres(found), _quaternion(found)
    pairs = [("x", x), ("y", y), ("z", z), ("qx", i), ("qy", j), ("qz", k), ("qw", w)]
    lines = [f'        "--{name}", "{value}",' for name, value in pairs]
    lines += [f'        "--frame-id", "{_parent(found)}",', '        "--child-frame-id", "camera_optical_frame",']
    head = ["from launch_ros.actions import Node", "", *_told(found, "#"), "Node("]
    head += ['    package="tf2_ros",', '    executable="static_transform_publisher",', "    arguments=["]
    return "\n".join([*head, *lines, "    ],", ")"]) + "\n"


def _easy_handeye(found: HandEyeResult) -> str:
    """A calibration file of easy_handeye."""
    (x, y, z), (w, i, j, k) = _metres(found), _quaternion(found)
    in_hand = found.setup == "eye-in-hand"
    base = "robot_effector_frame: tool0" if in_hand else "robot_base_frame: base_link"
    lines = [*_told(found, "#"), "parameters:", f"  eye_on_hand: {str(in_hand).lower()}", f"  {base}"]
    lines += ["  tracking_base_frame: camera_optical_frame", "transformation:"]
    lines += [f"  {name}: {value}" for name, value in (("x", x), ("y", y), ("z", z))]
    lines += [f"  {name}: {value}" for name, value in (("qx", i), ("qy", j), ("qz", k), ("qw", w))]
    return "\n".join(lines) + "\n"


def _urdf(found: HandEyeResult) -> str:
    """A fixed joint; rpy are turns about fixed axes x, y, z in that order, rad."""
    r = rotation_matrix(normalised(found.point.camera_quaternion)).tolist()
    roll, yaw = math.atan2(r[2][1], r[2][2]), math.atan2(r[1][0], r[0][0])
    pitch = math.asin(max(-1.0, min(1.0, -r[2][0])))
    told = [f"  {line}" for line in _told(found, "")]
    return (
        "\n".join(
            [
                "<!--",
                *told,
                "-->",
                '<joint name="camera_optical_joint" type="fixed">',
                f'  <parent link="{_parent(found)}"/>',
                '  <child link="camera_optical_frame"/>',
                f'  <origin xyz="{" ".join(_metres(found))}" rpy="{roll!r} {pitch!r} {yaw!r}"/>',
                "</joint>",
            ]
        )
        + "\n"
    )


def _opencv(found: HandEyeResult) -> str:
    """Matrices of both frames for cv::FileStorage, translations in mm, named as OpenCV's functions name them."""
    in_hand = found.setup == "eye-in-hand"
    point = found.point
    camera, target = ("cam2gripper", "target2base") if in_hand else ("cam2base", "target2gripper")
    lines = ["%YAML:1.0", "---", *_told(found, "#")]
    for name, position, quaternion in (
        (camera, point.camera_position, point.camera_quaternion),
        (target, point.target_position, point.target_quaternion),
    ):
        turn = [repr(v) for row in rotation_matrix(normalised(quaternion)).tolist() for v in row]
        lines += _matrix(f"R_{name}", 3, turn) + _matrix(f"t_{name}", 1, [repr(v) for v in position])
    return "\n".join(lines) + "\n"


def _matrix(name: str, columns: int, values: list[str]) -> list[str]:
    shape = [f"{name}: !!opencv-matrix", "  rows: 3", f"  cols: {columns}", "  dt: d"]
    return [*shape, f"  data: [ {', '.join(values)} ]"]


HAND_EYE_FORMS: dict[str, Callable[[HandEyeResult], str]] = {
    "ros2": _ros2,
    "easy-handeye": _easy_handeye,
    "urdf": _urdf,
    "opencv": _opencv,
}
