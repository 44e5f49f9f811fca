"""Studies on disk: round trips byte for byte; unusable files with every problem, its file, line and remedy."""

import os

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.files import load_study, save_study
from cpcal.robot import DELTALAB, PoseTable, Robot, Study
from cpcal.simulate import simulate_study

NAMES = ("study.toml", "calibration.csv", "validation.csv")
TOML = """\
format = "cpcal-study/2"
[robot]
name = "two legs"
base = [[0, 0, 0], [1, 2, 3]]
mobile = [[0, 0, 0], [1, 0, 0]]
offset = [5, 6]
[provenance]
where = "here"
[truth]
seed = 3
parameters = [
    [0, 0, 0, 0, 0, 0, 5],
    [1, 2, 3, 1, 0, 0, 6],
]
[truth.camera]
position = [0, 0, 900]
quaternion = [0, 1, 0, 0]
[truth.target]
position = [1, 2, 3]
quaternion = [1, 0, 0, 0]
"""
TABLE = """\
pose,run,x,y,z,qw,qx,qy,qz,L1,L2
a,1,1,2,3,1,0,0,0,10,11
a,2,1,2,3,0,1,0,0,10,11
b,1,1,2,3,0.6,0.8,0,0,10,11
"""
IMAGES = """\
pose,run,image,x,y,z,qw,qx,qy,qz,L1,L2
a,1,1,1,2,3,1,0,0,0,10,11
a,1,2,1,2,3,0,1,0,0,10,11
"""


def load(folder, toml=TOML, calibration=TABLE, validation=TABLE):
    for name, text in zip(NAMES, (toml, calibration, validation), strict=True):
        if text is not None:
            (folder / name).write_text(text, encoding="utf-8")
    return load_study(folder)


def refused(folder, **texts):
    """(file, line, what, remedy) of every problem."""
    with pytest.raises(InputError) as caught:
        load(folder, **texts)
    assert all(problem.remedy for problem in caught.value.problems)
    return [(os.path.basename(p.where), p.line, p.what, p.remedy) for p in caught.value.problems]


def contents(folder):
    return {name: (folder / name).read_bytes() for name in NAMES}


@pytest.mark.parametrize("more", [{}, {"images": 2}, {"backlash": 1.0, "sag": 0.3, "gain": 1e-3, "joint_error": 1.0}])
def test_what_is_saved_is_loaded_and_saved_again_byte_for_byte(tmp_path, more):
    study = simulate_study(seed=7, runs=2, validation_runs=1, random_poses=4, **more)
    save_study(study, tmp_path / "one")
    loaded = load_study(tmp_path / "one")
    assert loaded == study
    assert loaded.calibration.length.tobytes() == study.calibration.length.tobytes()
    save_study(loaded, tmp_path / "two")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_a_measured_study_has_no_truth(tmp_path):
    study = load(tmp_path, toml=TOML.partition("[truth]")[0], validation=IMAGES)
    assert study.truth is None
    assert study.provenance == {"where": "here"}
    assert study.validation.row_ids == ["a/1/1", "a/1/2"]
    assert study.calibration.image is None
    save_study(study, tmp_path / "again")
    assert load_study(tmp_path / "again") == study


@pytest.mark.parametrize(
    ("old", "new", "line", "what", "remedy"),
    [
        ("cpcal-study/2", "cpcal-campaign/1", 1, "the format is 'cpcal-campaign/1'", "cpcal-study/2"),
        ("seed = 3", "seed = -3", 10, "seed is -3", "from 0"),
        ("seed = 3\n", "", 9, "'seed' is missing in [truth]", "take [truth] out"),
        ("[1, 2, 3, 1, 0, 0, 6]", "[1, 2, 3, 1, 0, 0]", 11, "parameters of leg 2 has 6 numbers, not 7", "ax"),
        ("quaternion = [0, 1, 0, 0]", "quaternion = [0, 1, 1, 0]", 17, "the norm 1.41421356, not 1", "divide"),
        ("quaternion = [0, 1, 0, 0]\n", "", 15, "'quaternion' is missing in [truth.camera]", "add"),
        ("[truth.camera]", "[truth.kamera]", 15, "unknown key 'kamera' in [truth]", "camera"),
    ],
)
def test_a_bad_study_toml(tmp_path, old, new, line, what, remedy):
    assert TOML.count(old) == 1
    found = refused(tmp_path, toml=TOML.replace(old, new))
    assert [row for row in found if row[:2] == ("study.toml", line) and what in row[2] and remedy in row[3]]
    assert {row[0] for row in found} == {"study.toml"}


def table(**more):
    values = {"position": np.zeros((2, 3)), "quaternion": [[1, 0, 0, 0]] * 2, "length": np.zeros((2, 6))} | more
    return PoseTable(values.pop("pose", ("a", "b")), values.pop("run", ("1", "1")), **values)


@pytest.mark.parametrize(
    ("more", "texts"),
    [
        ({"pose": (), "run": ()}, ["no measurements"]),
        ({"run": ("1",)}, ["run: has 1 names"]),
        ({"image": ("1",)}, ["image: has 1 names"]),
        ({"position": np.zeros((3, 3)), "length": np.zeros((2, 0))}, ["position: has the shape", "length: has the"]),
        ({"pose": ("a/", "a"), "run": (" ", "1")}, ["'a/' cannot be a name", "' ' cannot be a name"]),
        ({"pose": ("a", "a")}, ["row a/1: is given 2 times"]),
        ({"pose": ("a", "a"), "image": ("1", "1")}, ["row a/1/1: is given 2 times"]),
        ({"length": np.full((2, 6), np.nan)}, ["row a/1: its length is NaN", "row b/1: its length"]),
        ({"quaternion": [[1, 0, 0, 0], [1, 1, 0, 0]]}, ["row b/1: the quaternion has the norm"]),
    ],
)
def test_a_bad_table_in_memory(more, texts):
    with pytest.raises(InputError) as caught:
        table(**more)
    for text in texts:
        assert text in str(caught.value)


def test_a_bad_study_in_memory():
    few = Robot.from_parameters("five", DELTALAB.parameters[:5])
    truth = simulate_study(seed=0, runs=1, validation_runs=1, random_poses=1).truth
    with pytest.raises(InputError) as caught:
        Study(few, table(), table(length=np.zeros((2, 5))), truth, {"a": 1})
    assert [p.where for p in caught.value.problems] == ["study calibration", "study truth", "study provenance 'a'"]
