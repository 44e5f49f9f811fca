"""`cpcal import` and `cpcal robot`: from a tracker's log to a campaign. (tests/test_documentation.py goes on.)"""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import cpcal
from cpcal.files import load_settings
from cpcal.robot import DELTALAB, ROBOTS, LegEquations, rotation_matrix
from cpcal.robot.mistakes import spread_of
from cpcal.simulate import simulate
from tests.cli.command import done, refused, run

TRUE = simulate(seed=4, truncate=2.9)
EULER = Rotation.from_quat(TRUE.quaternion, scalar_first=True).as_euler("xyz", degrees=True)
MAP = "pose=Frame, x=Tx (m)[m], y=Ty (m)[m], z=Tz (m)[m], r1=Rx, r2=Ry, r3=Rz, " + ", ".join(
    f"L{i}=S{i}" for i in range(1, 7)
)
SIGMA = "position=0.0633[mm], rotation=0.0119[deg], length=0.019[mm]"
LIKE_THIS = ("--robot", "deltalab", "--map", MAP, "--rotation", "euler-xyz-deg", "--sigma", SIGMA)


@pytest.fixture
def log(tmp_path):
    """As a laser tracker's software in Europe exports it: metres, degrees, semicolons, decimal commas, Latin-1."""
    rows = np.column_stack([np.arange(1, len(TRUE) + 1), TRUE.position / 1e3, EULER, TRUE.length])
    lines = [";".join([f"{row[0]:.0f}", *(f"{v:.9f}".replace(".", ",") for v in row[1:])]) for row in rows]
    names = "Frame;Tx (m);Ty (m);Tz (m);Rx;Ry;Rz;S1;S2;S3;S4;S5;S6"
    path = tmp_path / "tracker.csv"
    path.write_bytes("\n".join(["Export v4.2", "Operator: Müller", "", names, *lines, ""]).encode("latin-1"))
    return path


def test_what_is_imported_is_what_was_measured(tmp_path, log):
    assert "Next: cpcal check" in run("import", log, *LIKE_THIS, "-o", tmp_path / "campaign").stdout
    campaign = cpcal.load_campaign(tmp_path / "campaign")
    assert_allclose(campaign.position, TRUE.position, atol=1e-6)
    assert_allclose(campaign.length, TRUE.length, atol=1e-8)
    assert_allclose(rotation_matrix(campaign.quaternion), rotation_matrix(TRUE.quaternion), atol=1e-10)
    assert campaign.measurement_ids[:2] == ("1/1", "2/1")
    assert campaign.uncertainty.factor == 3.0
    assert_allclose(campaign.uncertainty.rotation, np.radians(0.0119))
    assert campaign.provenance["imported_from"] == "tracker.csv"


def test_metres_become_the_nearest_float_in_mm(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("x,y,z,qw,qx,qy,qz,L1\n0.1234567,0.3,1.1,1,0,0,0,0.7\n")
    (tmp_path / "own.toml").write_text(
        'format = "cpcal-campaign/1"\n[robot]\nname="one"\nbase=[[0,0,0]]\nmobile=[[0,0,0]]\noffset=[0]\n'
        "[uncertainty]\nexact = true\n[provenance]\noperator = 'me'\n"
    )
    like = ("--robot", tmp_path / "own.toml", "--map", "x=x[m],y=y[m],z=z[m],L1=L1[m]", "--anyway")
    done("import", path, *like, "-o", tmp_path / "c")
    campaign = cpcal.load_campaign(tmp_path / "c")
    assert campaign.position.tolist() == [[123.4567, 300.0, 1100.0]]
    assert campaign.length.tolist() == [[700.0]]
    assert campaign.exact
    assert campaign.provenance["operator"] == "me"


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (("--rotation", "euler-xyz-rad"), "rotation angles are in degrees"),
        (("--map", MAP.replace("L1=S1, L2=S2", "L1=S2, L2=S1")), "leg 1 stands in L2, leg 2 stands in L1"),
    ],
)
def test_what_looks_mixed_up_is_not_written(tmp_path, log, wrong, cause):
    said = done("import", log, *LIKE_THIS, *wrong, "-o", tmp_path / "campaign", status=1)
    assert cause in said
    assert "Nothing was written" in said
    assert not (tmp_path / "campaign").exists()
    done("import", log, *LIKE_THIS, *wrong, "--anyway", "-o", tmp_path / "campaign")
    assert (tmp_path / "campaign").is_dir()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--robot", "deltalab", "--map", MAP, "--rotation", "euler-xyz-deg"), "uncertainty: is not stated"),
        (("--robot", "none.toml", "--exact"), "none.toml: does not exist -> make it with `cpcal robot init`"),
        (("--robot", "delta", "--exact"), "did you mean 'deltalab'"),
        ((*LIKE_THIS, "--exact"), "give one of the two"),
        ((*LIKE_THIS, "--sigma", "position=1[deg], rotation=1, length=1"), "position is '1' in deg"),
        ((*LIKE_THIS, "--sigma", "position=1"), "rotation_sigma and length_sigma missing"),
        ((*LIKE_THIS, "--sigma", "position=1, rotation=1, length=1"), "rotation has no unit -> write rotation=1[deg]"),
        ((*LIKE_THIS, "--map", "x=Tx"), "there is no column 'Tx'"),
        ((*LIKE_THIS, "--map", "pose=Frame"), "the column 'x' is missing"),
    ],
)
def test_what_cannot_be_imported_is_said(tmp_path, log, arguments, message):
    assert message in refused("import", log, *arguments, "-o", tmp_path / "campaign")
    assert not (tmp_path / "campaign").exists()


def test_bad_cells_are_named_by_line_all_at_once(tmp_path, log):
    lines = log.read_bytes().split(b"\n")
    lines[5] = lines[5].replace(b"0,0", b"oops", 1)
    lines[7] = lines[7][: lines[7].rindex(b";") + 1]
    log.write_bytes(b"\n".join(lines))
    said = refused("import", log, *LIKE_THIS, "-o", tmp_path / "campaign")
    assert "tracker.csv:6: " in said
    assert "tracker.csv:8: L6 is empty" in said


@pytest.mark.parametrize("name", ROBOTS)
def test_a_template_of_a_known_robot_has_its_drawing(tmp_path, name):
    file = tmp_path / "campaign.toml"
    assert run("robot", "init", name, "-o", file).exit_code == 0
    filled = file.read_text(encoding="utf-8")
    file.write_text(re.sub(r"\bnan\b", "0.1", filled), encoding="utf-8")
    settings = load_settings(file)
    assert settings.robot == ROBOTS[name].robot
    assert settings.uncertainty.factor == 3.0


def test_a_template_that_is_not_filled_in_is_refused_line_by_line(tmp_path):
    file = tmp_path / "own.toml"
    assert run("robot", "init", "my crane", "--legs", "4", "-o", file).exit_code == 0
    with pytest.raises(cpcal.InputError, match=r"own\.toml:\d+: base of leg 4 holds nan"):
        load_settings(file)
    assert "is there already" in refused("robot", "init", "my crane", "-o", file)


# The log of a tracker: metres, degrees, its own frame, a target anywhere on the platform, each pose read once.

NAMES = ["No", "X [m]", "Y [m]", "Z [m]", *(f"R{axis} [deg]" for axis in "xyz"), *(f"L{i} [mm]" for i in range(1, 7))]
STATED = {"position_sigma": 0.02, "rotation_sigma": 1e-4, "length_sigma": 0.01}
WRONG = 16, 2  # row and leg, from 0


def tracked(path, seed, side=1.0, count=40):
    """Kinematics of the test's own: writes a log with 3 mm wrong in one cell; drawing, true poses, frames, readings."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.uniform(-0.25, 0.25, (count, 3)))
    place = np.array([0.0, 0.0, side * 350.0]) + rng.uniform(-50.0, 50.0, (count, 3))
    tracker, target = Rotation.random(random_state=seed), Rotation.random(random_state=seed + 1)
    at, on = 3000.0 * rng.standard_normal(3), 50.0 * rng.standard_normal(3)
    vectors = place[:, None] + np.einsum("kij,nj->kni", turn.as_matrix(), DELTALAB.mobile) - DELTALAB.base
    length = np.linalg.norm(vectors, axis=2) - DELTALAB.offset + 0.01 * rng.standard_normal((count, 6))
    length[WRONG] += 3.0
    seen = tracker.inv().apply(turn.apply(on) + place - at) + 0.02 * rng.standard_normal((count, 3))
    angles = (Rotation.from_rotvec(1e-4 * rng.standard_normal((count, 3))) * tracker.inv() * turn * target).as_euler(
        "xyz", degrees=True
    )
    rows = np.column_stack([np.arange(1, count + 1), seen / 1000.0, angles, length])
    lines = [",".join(NAMES), *(",".join([f"{row[0]:.0f}", *(f"{v:.7f}" for v in row[1:])]) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return place, turn, at, on, length


@pytest.mark.parametrize(("seed", "side"), [(1, 1.0), (2, -1.0), (3, 1.0)])
def test_frames_are_found_wherever_the_tracker_stands_in_spite_of_a_wrong_reading(tmp_path, seed, side):
    place, turn, at, on, length = tracked(tmp_path / "log.csv", seed, side)
    campaign = cpcal.load_log(tmp_path / "log.csv", robot=DELTALAB, rotation="euler-xyz-deg", **STATED)
    assert_allclose(campaign.length, length, atol=1e-6)  # the wrong reading too
    assert campaign.provenance["left_out"].endswith(": 17/1.")
    # every pose, through frames that noise and 40 poses leave to a few mm along and a mrad
    gauge = LegEquations.of(campaign).values(spread_of(campaign).fitted)
    gauge[WRONG] = 0.0
    assert np.abs(gauge).max() < 0.15
    assert np.linalg.norm(campaign.position - place, axis=1).max() < 15.0
    true = turn.as_quat(scalar_first=True)
    assert np.abs(np.abs(np.sum(true * campaign.quaternion, axis=1)) - 1.0).max() < 1e-3
    known = json.loads(campaign.provenance["tracker_in_base_pose"])["position"]
    assert np.linalg.norm(np.array(known) - at) < 150.0
    # a deviation of a turn moves the origin of the mobile frame, which is a lever away from the target
    pose = json.loads(campaign.provenance["target_in_mobile_pose"])["position"]
    assert np.linalg.norm(np.array(pose) - on) < 15.0
    sigma = campaign.position_radius[0] / 3.0
    assert np.sum(sigma**2) == pytest.approx(3 * 0.02**2 + 2 * (1e-4 * np.linalg.norm(pose)) ** 2, rel=1e-6)
    assert_allclose(campaign.rotation_radius, 3e-4, rtol=1e-9)


def test_a_log_goes_to_a_campaign_in_one_command(tmp_path):
    tracked(tmp_path / "log.csv", 1)
    stated_so = ("--rotation", "euler-xyz-deg", "--sigma", "position=0.02[mm], rotation=1e-4[rad], length=0.01[mm]")
    like = (tmp_path / "log.csv", "--robot", "deltalab", "-o", tmp_path / "c")
    said = done("import", *like, *stated_so)
    for text in ('x="X [m]"[m]', "Tracker in base: (", "Target in mobile: (", "kept in the campaign: 17/1."):
        assert text in said
    stated = {**STATED, "robot": "deltalab", "rotation": "euler-xyz-deg"}
    assert cpcal.load_campaign(tmp_path / "c") == cpcal.load_log(tmp_path / "log.csv", **stated)
    assert "leg 3 reads" in done("check", tmp_path / "c", status=1)
    far = done("import", *like, *stated_so, "--frames", "base", "--force", status=1)
    assert "The drawing and the readings disagree" in far


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ((), ("--exact",), "is not stated: with euler-xyz-deg .* -> say --rotation euler-xyz-deg"),
        ((), ("--exact", "--rotation", "euler-zyx-deg"), "is not euler-zyx-deg: with euler-xyz-deg"),
        ((), ("--rotation", "euler-xyz-deg"), r"uncertainty: is not stated; .* residuals of 0\.0[23]\d* mm"),
        ((" [m]", ""), ("--exact", "--rotation", "euler-xyz-deg"), r"'X', .* and its units: --map '.*x=\"X\"\[mm\]"),
        (("L3 [mm]", "S3 [mm]"), ("--exact", "--rotation", "euler-xyz-deg"), "add L1, L2, L3, L4, L5, L6"),
        ((".", ","), ("--exact",), "has decimal commas, and commas between columns too"),
    ],
)
def test_what_a_log_does_not_tell_is_asked_for_with_a_proposal(tmp_path, change, options, message):
    tracked(tmp_path / "log.csv", 1)
    if change:
        (tmp_path / "log.csv").write_text((tmp_path / "log.csv").read_text().replace(*change))
    said = refused("import", tmp_path / "log.csv", "--robot", "deltalab", "-o", tmp_path / "c", *options)
    assert re.search(message, " ".join(said.split()))
    assert not (tmp_path / "c").exists()
