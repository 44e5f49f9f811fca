"""Studies made from pairs of poses and from photographs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cpcal.common.errors import InputError
from cpcal.models.hand_eye import load_hand_poses, simulate_hand_eye
from cpcal.models.hand_eye_sources import other_direction, photo_names, read_pose_pairs, study_of_photos
from cpcal.robot import Pose, inverse, quaternion_from_matrix
from cpcal.vision.camera import Camera
from cpcal.vision.target import target_from


def pairs(setup):
    """Hand in base and target in camera of a simulated study without errors, and its truth."""
    simulated = simulate_hand_eye(setup=setup, images=8, pixel_error=0.0, seed=2)
    study, truth = simulated.study, simulated.truth
    turn, shift = study.motions()
    r = truth.e_rotation @ turn @ truth.f_rotation
    t = (turn @ truth.f_translation + shift) @ truth.e_rotation.T + truth.e_translation
    return study.poses, Pose(t, quaternion_from_matrix(r)), truth


def _matrix(pose, k):
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = pose.rotation[k], pose.position[k] / 1000.0
    return m


def _transform(pose, k):
    t, q = pose.position[k] / 1000.0, pose.quaternion[k]
    return {
        "translation": dict(zip("xyz", t.tolist(), strict=True)),
        "rotation": dict(zip("wxyz", q.tolist(), strict=True)),
    }


def moveit(hand, seen):
    return [
        {
            "effector_wrt_world": _matrix(hand, k).ravel().tolist(),
            "object_wrt_sensor": _matrix(seen, k).ravel().tolist(),
        }
        for k in range(8)
    ]


def opencv(hand, seen):
    named = {"gripper2base": hand, "target2cam": seen}
    lists = {}
    for name, pose in named.items():
        lists[f"R_{name}"] = [_matrix(pose, k)[:3, :3].tolist() for k in range(8)]
        lists[f"t_{name}"] = [_matrix(pose, k)[:3, 3].tolist() for k in range(8)]
    return lists


def ros(hand, seen):
    return {"samples": [{"hand": _transform(hand, k), "camera_marker": _transform(seen, k)} for k in range(8)]}


@pytest.mark.parametrize("form", [moveit, opencv, ros])
def test_files_of_other_packages_are_read(tmp_path, form):
    hand, seen, _ = pairs("eye-in-hand")
    path = tmp_path / "samples.yaml"
    path.write_text(json.dumps(form(hand, seen)))  # JSON is YAML
    for given, read in zip((hand, seen), read_pose_pairs(path), strict=True):
        np.testing.assert_allclose(read.position, given.position, atol=1e-9)
        np.testing.assert_allclose(read.rotation, given.rotation, atol=1e-12)


def easy_handeye(hand, seen):
    """As ROS 2 writes a message: `NAME.samples` of easy_handeye2."""
    lines = ["samples:"]
    for k in range(8):
        for first, name, pose in (("-", "robot", hand), (" ", "tracking", seen)):
            lines.append(f"{first} {name}:")
            for part, values in _transform(pose, k).items():
                lines += [f"    {part}:", *(f"      {axis}: {value!r}" for axis, value in values.items())]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_samples_of_easy_handeye_are_read_as_it_stores_them(tmp_path, setup):
    hand, seen, _ = pairs(setup)
    path = tmp_path / "robot.samples"
    path.write_text(easy_handeye(inverse(hand) if setup == "eye-to-hand" else hand, seen))
    for given, read in zip((hand, seen), read_pose_pairs(path, setup=setup), strict=True):
        np.testing.assert_allclose(read.position, given.position, atol=1e-9)
        np.testing.assert_allclose(read.rotation, given.rotation, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "no list of samples"),
        ("{samples: [{robot: 1}]}", "holds no pairs of poses"),
        ("[{effector_wrt_world: [1, 2]}]", "cannot reshape"),
        ("a: [", "YAML"),
    ],
)
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_files_of_other_things_are_refused(tmp_path, text, reason, setup):
    path = tmp_path / "samples.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"samples.yaml.*{reason}.* -> "):
        read_pose_pairs(path, setup=setup)


@pytest.mark.parametrize("number", [".nan", "-.inf", "9" * 401])
@pytest.mark.parametrize("part", ["translation", "rotation"])
def test_a_number_that_is_no_length_and_no_rotation_is_refused(tmp_path, part, number):
    hand, seen, _ = pairs("eye-in-hand")
    for form in (moveit, opencv, ros):
        document = form(hand, seen)
        if form is ros:
            document["samples"][3]["hand"][part]["x"] = "HERE"
        elif form is opencv:
            where = document["t_target2cam"][3] if part == "translation" else document["R_target2cam"][3][1]
            where[0] = "HERE"
        else:
            document[3]["object_wrt_sensor"][3 if part == "translation" else 0] = "HERE"
        path = tmp_path / "samples.yaml"
        path.write_text(json.dumps(document).replace('"HERE"', number))
        with pytest.raises(InputError, match=r"samples.yaml.* -> give samples of MoveIt"):
            read_pose_pairs(path)


def test_points_of_a_chessboard_turn_with_it_and_one_that_looks_the_same_is_left_out(tmp_path):
    cv2 = pytest.importorskip("cv2")
    camera = Camera(400, 400, np.array([900.0, 900.0]), np.array([199.5, 199.5]), np.zeros(5))
    poses = {"up": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "down": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}

    def found(columns, rows, **hint):
        squares = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2 * 255
        picture, top, edge = np.full((400, 400), 255, np.uint8), 200 - 18 * (rows + 1), 200 - 18 * (columns + 1)
        picture[top : 400 - top, edge : 400 - edge] = np.kron(squares, np.ones((36, 36)))
        for name, seen in (("up", picture), ("down", picture[::-1, ::-1])):
            cv2.imwrite(str(tmp_path / f"{name}.png"), cv2.GaussianBlur(seen, (0, 0), 0.8))
        board = target_from(f"chessboard:{columns}x{rows}:36")
        return study_of_photos(tmp_path, board, camera=camera, poses=poses, setup="eye-in-hand", **hint)

    cv2.imwrite(str(tmp_path / "spare.png"), np.full((400, 400), 255, np.uint8))
    study, left = found(7, 6)  # a pixel of the picture and of the picture turned: their sum is 399
    assert left == ["spare.png has no pose"]
    assert study.images == ("down", "up")
    down, up = (study.pixels[study.image == k] for k in (0, 1))
    np.testing.assert_allclose(down + up, 399.0, atol=0.1)
    with pytest.raises(InputError, match="ambiguous: the target looks the same when it is turned"):
        found(8, 6)
    study, left = found(8, 6, first_row="top")
    assert len(left) == 1
    down, up = (study.pixels[study.image == k] for k in (0, 1))
    np.testing.assert_allclose(down, up, atol=0.1)


# ------------------------------------------------------------------------------------------------------------------
# Tables of the hand's poses, as controllers write them.


def fixed(angles):  # about x, then y, then z of the base
    return Rotation.from_euler("xyz", angles, degrees=True).as_matrix()


def turned(angles):  # A about z, B about the new y, C about the new x
    return Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()


def vector(turns):
    return Rotation.from_rotvec(turns).as_matrix()


def quaternion(q):
    return Rotation.from_quat(np.roll(q, -1)).as_matrix()


ANGLES = ((-176.5919, 9.8196, 2.0734), (172.8601, 12.2128, 0.3871), (30.5, -45.25, 100.0))
TURNS = ((0.3, -1.2, 2.2), (-0.01, 0.02, 0.005), (1.0, 1.0, -0.5))
UNITS = ((0.5, 0.5, -0.5, 0.5), (0.6, 0.0, 0.0, 0.8), (0.48, -0.64, 0.36, 0.48))
FORMS_OF_TABLES = [
    ("kuka", "name,X,Y,Z,A,B,C", 1.0, ANGLES, turned),
    ("yaskawa", "image;X [mm];Y [mm];Z [mm];Rx [deg];Ry [deg];Rz [deg]", 1.0, ANGLES, fixed),
    ("fanuc", "image,X,Y,Z,W,P,R", 1.0, ANGLES, fixed),
    ("ur", "image x y z rx ry rz", 1e-3, TURNS, vector),
    ("abb", "image,x,y,z,q1,q2,q3,q4", 1.0, UNITS, quaternion),
    ("euler-xyz-deg", "image,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", 1.0, ANGLES, fixed),
    ("euler-ZYX-deg", "image,x_m,y_m,z_m,rz_deg,ry_deg,rx_deg", 1e-3, ANGLES, turned),
    (None, "image,x,y,z,qw,qx,qy,qz", 1.0, UNITS, quaternion),
    ("kuka", "", 1.0, ANGLES, turned),
]
PLACES = ((905.634, -110.794, 337.887), (922.339, -28.866, 337.888), (-847.943, 46.255, 1.5))


@pytest.mark.parametrize(("form", "header", "scale", "turns", "matrix"), FORMS_OF_TABLES)
def test_a_table_in_a_controllers_form_holds_these_poses(tmp_path, form, header, scale, turns, matrix):
    mark = ";" if ";" in header else " " if " " in header else ","
    lines = [header] * bool(header)
    for k, (place, turn) in enumerate(zip(PLACES, turns, strict=True)):
        lines.append(mark.join([f"shot{k}", *(repr(scale * x) for x in place), *map(str, turn)]))
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    found = load_hand_poses(tmp_path / "poses.txt", rotation=form)
    assert list(found) == ["shot0", "shot1", "shot2"]
    rows = np.array(list(found.values()))
    np.testing.assert_allclose(rows[:, :3], PLACES, atol=1e-9)
    expected = np.array([matrix(np.array(turn)) for turn in turns])
    np.testing.assert_allclose(Pose(rows[:, :3], rows[:, 3:]).rotation, expected, atol=1e-12)


MATRICES = [np.block([[fixed(t), np.array([p]).T], [np.zeros((1, 3)), 1]]) for t, p in zip(ANGLES, PLACES, strict=True)]


def test_tables_of_poses_that_leave_a_doubt_are_refused(tmp_path):
    def refused(text, why, **more):
        (tmp_path / "poses.csv").write_text(text)
        with pytest.raises(InputError, match=why):
            load_hand_poses(tmp_path / "poses.csv", **more)

    angles = "image,x,y,z,rx,ry,rz\na,700,1,2,3,4,5\nb,700,2,3,4,5,6\n"
    refused(angles, "state --rotation")
    refused(angles, "call them image, x, y, z, qw, qx, qy, qz", rotation="abb")
    refused(angles, "is no form of rotations", rotation="adept")
    refused(angles.replace("\nb", "\na"), "names 'a' twice", rotation="fanuc")
    refused(angles.replace("700", "0.7"), "at most 3 mm from the base, if its lengths are in mm", rotation="fanuc")
    refused(angles, "at most 700000 mm from the base, if its lengths are in m", rotation="ur")
    refused(angles.replace("image,x", "ape,x"), "2 poses without names, and there are 3", rotation="fanuc", names="abc")
    refused(angles.replace("4,5\n", "4,up\n"), "'up' is not a number", rotation="fanuc")
    turned_over = "\n".join(" ".join(map(str, row)) for m in MATRICES for row in m.T)
    refused(turned_over, "is no matrix whose last row is 0 0 0 1")
    refused("1,2,3,4,5\n2,3,4,5,6\n", "has no names of columns, and 5 of them")


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_poses_that_run_from_base_to_hand_are_told_by_the_pixels(setup):
    study = simulate_hand_eye(setup=setup, images=8, pixel_error=0.2, seed=2).study
    assert other_direction(study) == []
    (said,) = other_direction(replace(study, poses=inverse(study.poses)))
    other = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}[setup]
    assert "0.11" in said
    assert "--base-in-hand" in said
    assert f"--setup {other}" in said
    assert other_direction(replace(study, setup=other, poses=inverse(study.poses))) == []


def test_photographs_go_by_their_numbers(tmp_path):
    for name in ("image10.png", "image2.png", "image1.png"):
        (tmp_path / name).write_bytes(b"")
    assert photo_names(tmp_path) == ["image1.png", "image2.png", "image10.png"]


@pytest.mark.parametrize("width", [4, 16])
@pytest.mark.parametrize("back", [False, True])
def test_matrices_one_after_the_other_are_poses_in_the_order_of_the_photographs(tmp_path, width, back):
    numbers = np.array([np.linalg.inv(m) if back else m for m in MATRICES])
    np.savetxt(tmp_path / "robot.txt", numbers.reshape(-1, width))
    found = load_hand_poses(tmp_path / "robot.txt", base_in_hand=back, names=["a", "b", "c"])
    rows = np.array([found[name] for name in "abc"])
    np.testing.assert_allclose(rows[:, :3], PLACES, atol=1e-9)
    np.testing.assert_allclose(Pose(rows[:, :3], rows[:, 3:]).rotation, [m[:3, :3] for m in MATRICES], atol=1e-12)
