"""Campaigns and studies on disk: round trips bit for bit, digests; unusable files with every problem."""

import dataclasses
import hashlib
import os
import pickle
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cpcal.common.errors import InputError
from cpcal.files import load_campaign, load_study, save_campaign, save_study
from cpcal.files.folders import campaign_json, campaign_sha256, load_campaign_json, save_campaign_json
from cpcal.robot import DELTALAB, Campaign, PoseTable, Robot, Study, Uncertainty
from cpcal.simulate import simulate, simulate_study

ARRAYS = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")

finite = st.floats(-1e12, 1e12)
sizes = st.floats(0, 1e12)
text = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=12)
names = st.text(st.characters(exclude_categories=["C", "Z"], exclude_characters="/"), min_size=1, max_size=6).filter(
    lambda name: name not in (".", "..")
)


def bits(campaign):
    return [getattr(campaign, name).tobytes() for name in ARRAYS]


@st.composite
def campaigns(draw):
    legs, count = draw(st.integers(1, 4)), draw(st.integers(1, 5))

    def array(*shape, of=finite):
        size = int(np.prod(shape))
        return np.array(draw(st.lists(of, min_size=size, max_size=size))).reshape(shape)

    robot = Robot(draw(text), array(legs, 3), array(legs, 3), array(legs))
    uncertainty = None
    if draw(st.booleans()):
        factor = draw(st.none() | st.floats(0, 1))
        uncertainty = Uncertainty(array(3, of=sizes), array(3, of=sizes), array(legs, of=sizes), factor)
    radii = {}
    for name, width in (("position_radius", 3), ("rotation_radius", 3), ("length_radius", legs)):
        if draw(st.booleans()):
            radii[name] = array(count, width, of=sizes)
    quaternion = array(count, 4, of=st.floats(-1, 1)) + np.array([2.0, 0.0, 0.0, 0.0])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return Campaign.of(
        robot, array(count, 3), quaternion, array(count, legs),
        pose=draw(st.lists(names, min_size=count, max_size=count, unique=True)),
        run=draw(st.lists(names, min_size=count, max_size=count)),
        uncertainty=uncertainty, exact=uncertainty is None,
        provenance=draw(st.dictionaries(text, text, max_size=3)), **radii,
    )  # fmt: skip


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(campaigns())
def test_what_is_saved_is_loaded_bit_for_bit(tmp_path_factory, campaign):
    folder = tmp_path_factory.mktemp("round") / "campaign"
    save_campaign(campaign, folder)
    loaded = load_campaign(folder)
    assert loaded == campaign
    assert bits(loaded) == bits(campaign)
    assert loaded.robot.parameters.tobytes() == campaign.robot.parameters.tobytes()
    assert campaign_sha256(loaded) == campaign_sha256(campaign)
    assert pickle.loads(pickle.dumps(loaded)) == campaign


def test_the_digest_is_of_the_files_as_they_are(tmp_path):
    campaign = simulate(seed=1)
    save_campaign(campaign, tmp_path)
    digest = hashlib.sha256(campaign_json(campaign)).hexdigest()
    assert campaign_sha256(load_campaign(tmp_path)) == campaign_sha256(campaign) == digest
    toml = (tmp_path / "campaign.toml").read_bytes() + b"# a remark\n"
    (tmp_path / "campaign.toml").write_bytes(toml)
    loaded = load_campaign(tmp_path)
    assert loaded == campaign
    assert campaign_sha256(loaded) != campaign_sha256(campaign)
    assert loaded.files[0] == ("campaign.toml", hashlib.sha256(toml).hexdigest())
    # the exact file gives it back, with the digests of the originals
    again = load_campaign_json(save_campaign_json(loaded, tmp_path))
    assert (again, again.files, campaign_sha256(again)) == (loaded, loaded.files, campaign_sha256(loaded))
    # a changed copy is not tied to the files any more
    assert campaign_sha256(dataclasses.replace(loaded, length=loaded.length + 1)) not in (
        campaign_sha256(loaded),
        campaign_sha256(campaign),
    )


def test_bom_crlf_column_order_blank_lines_and_spaces_do_not_matter(tmp_path):
    campaign = simulate(seed=1)
    save_campaign(campaign, tmp_path)
    toml, table = tmp_path / "campaign.toml", tmp_path / "measurements.csv"
    toml.write_bytes(b"\xef\xbb\xbf" + toml.read_bytes().replace(b"\n", b"\r\n"))
    rows = [line.split(",")[::-1] for line in table.read_text().splitlines()]
    text = "\r\n\r\n".join(" , ".join(row) for row in rows) + "\r\n"
    table.write_bytes(b"\xef\xbb\xbf" + text.encode())
    loaded = load_campaign(tmp_path)
    assert loaded == campaign
    assert bits(loaded) == bits(campaign)


def test_override_columns_replace_half_widths_row_by_row(tmp_path):
    save_campaign(simulate(seed=1, factor=2.0), tmp_path)
    table = tmp_path / "measurements.csv"
    lines = table.read_text().splitlines()
    extra = [",dy,dL6,drx", ",0.5,,1e-3", ",,0,", *[",,,"] * 62]
    table.write_text("".join(f"{line}{more}\n" for line, more in zip(lines, extra, strict=True)))
    plain, loaded = simulate(seed=1, factor=2.0), load_campaign(tmp_path)
    assert loaded.position_radius[0].tolist() == [plain.position_radius[0, 0], 0.5, plain.position_radius[0, 2]]
    assert loaded.rotation_radius[0].tolist() == [1e-3, *plain.rotation_radius[0, 1:]]
    assert loaded.length_radius[1].tolist() == [*plain.length_radius[1, :5], 0.0]
    assert np.array_equal(loaded.length_radius[2:], plain.length_radius[2:])
    assert not loaded.exact


def test_whether_readings_are_exact_is_never_taken_for_granted():
    arrays = (DELTALAB, np.zeros((2, 3)), [[1, 0, 0, 0]] * 2, np.zeros((2, 6)))
    some = {"position_radius": 0.1, "rotation_radius": 0.0}
    for way in ({}, some, {"uncertainty": Uncertainty([0] * 3, [0] * 3, [0] * 6), "exact": True}):
        with pytest.raises(InputError, match="exact=True"):
            Campaign.of(*arrays, **way)
    assert Campaign.of(*arrays, exact=True).exact
    assert not Campaign.of(*arrays, **some, length_radius=0.0).exact


@pytest.mark.parametrize(
    ("save", "load", "make", "head", "fatal"),
    [
        (save_campaign, load_campaign, simulate, "campaign.toml", "campaign.toml"),
        (save_campaign, load_campaign, simulate, "campaign.toml", "measurements.csv"),
        (save_study, load_study, partial(simulate_study, runs=1, validation_runs=1), "study.toml", "validation.csv"),
    ],
)
def test_an_interrupted_save_leaves_nothing_rather_than_a_mixture(tmp_path, monkeypatch, save, load, make, head, fatal):
    old = tmp_path / "old"
    save(make(seed=1), old)
    real = os.replace

    def replace(source, target):
        if Path(target) == old / fatal:
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr("os.replace", replace)
    with pytest.raises(InputError, match="No space left"):
        save(make(seed=2), old)
    with pytest.raises(InputError, match=f"{head}: does not exist"):
        load(old)
    assert os.listdir(tmp_path) == ["old"]


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


@pytest.mark.parametrize("more", [{}, {"images": 2}, {"backlash": 1.0, "sag": 0.3, "gain": 1e-3, "joint_error": 1.0}])
def test_what_is_saved_is_loaded_and_saved_again_byte_for_byte(tmp_path, more):
    study = simulate_study(seed=7, runs=2, validation_runs=1, random_poses=4, **more)
    save_study(study, tmp_path / "one")
    loaded = load_study(tmp_path / "one")
    assert loaded == study
    assert loaded.calibration.length.tobytes() == study.calibration.length.tobytes()
    save_study(loaded, tmp_path / "two")
    assert all((tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes() for name in NAMES)


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
    assert [p.where for p in caught.value.problems] == ["study provenance 'a'", "study calibration", "study truth"]
