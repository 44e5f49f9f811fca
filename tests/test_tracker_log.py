"""From a tracker's log to a verdict, the parameters to load and an accuracy statement: four commands, or six lines.

The platform, its kinematics, its errors and the log are this file's own: numpy and scipy's rotations, no cpcal. The log
is what a laser tracker writes: metres and degrees, in the tracker's frame, the pose of a target whose place on the
platform nobody measured. Every pose was read once, and one leg was read wrong once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import cpcal
from cpcal.questions.accuracy import load_accuracy
from tests.cli.command import done

LEGS, POSES, WRONG, WRONG_LEG = 6, 60, 17, 3
SIGMA_P, SIGMA_R, SIGMA_L = 0.02, 1e-4, 0.01  # mm, rad, mm: as stated; the noise is cut at 2.9 of them
TOLERANCE = 0.5  # mm


@dataclass(frozen=True)
class Frame:
    """x in this frame is R x + t in the other."""

    rotation: Rotation
    origin: np.ndarray

    def __matmul__(self, other: Frame) -> Frame:
        return Frame(self.rotation * other.rotation, self.rotation.apply(other.origin) + self.origin)

    def inverse(self) -> Frame:
        back = self.rotation.inv()
        return Frame(back, -back.apply(self.origin))


def hexapod(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (6, 3), (6, 3) and offsets (6,) of the drawing, mm: pairs of joints on two rings."""

    def ring(radius: float, half_angle: float, turn: float) -> np.ndarray:
        angles = np.radians([c + s * half_angle + turn for c in (0, 120, 240) for s in (-1, 1)])
        return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), rng.uniform(-15, 15, LEGS)])

    return ring(640.0, 18.0, 0.0), np.roll(ring(330.0, 14.0, 60.0), 1, axis=0), np.full(LEGS, 410.0)


def leg_lengths(robot: tuple[np.ndarray, np.ndarray, np.ndarray], frames: list[Frame]) -> np.ndarray:
    """What the encoders of an ideal machine read, (N, 6) mm."""
    base, mobile, offset = robot
    return np.array([np.linalg.norm(f.rotation.apply(mobile) + f.origin - base, axis=1) - offset for f in frames])


def reached(robot: tuple[np.ndarray, np.ndarray, np.ndarray], near: Frame, lengths: np.ndarray) -> Frame:
    """Where the platform stands with these readings, near a pose."""

    def moved(x: np.ndarray) -> Frame:
        return Frame(Rotation.from_rotvec(x[3:] / 300.0) * near.rotation, near.origin + x[:3])

    found = least_squares(
        lambda x: leg_lengths(robot, [moved(x)])[0] - lengths, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return moved(found.x)


def poses_in_base(rng: np.random.Generator, count: int) -> list[Frame]:
    places = rng.uniform([-120, -120, 560], [120, 120, 760], (count, 3))
    turns = Rotation.from_rotvec(rng.uniform(-0.25, 0.25, (count, 3)))
    return [Frame(turn, place) for turn, place in zip(turns, places, strict=True)]


@pytest.fixture(scope="module")
def world():
    """Drawing, true robot, the two frames that nobody knows, true poses, and the generator."""
    rng = np.random.default_rng(38)
    drawing = hexapod(rng)
    true = tuple(part + rng.uniform(-0.8, 0.8, part.shape) for part in drawing)
    tracker = Frame(Rotation.from_euler("ZYX", [118.0, -7.0, 4.0], degrees=True), np.array([2310.0, -870.0, 145.0]))
    target = Frame(Rotation.from_euler("ZYX", [35.0, 3.0, -2.0], degrees=True), np.array([40.0, -25.0, 92.0]))
    return drawing, true, tracker, target, poses_in_base(rng, POSES), rng


@pytest.fixture(scope="module")
def log(world, tmp_path_factory):
    """The two files that an engineer has: the log, and the drawing."""
    drawing, true, tracker, target, poses, rng = world
    lengths = leg_lengths(true, poses)

    def noise(sigma: float, shape: tuple[int, ...]) -> np.ndarray:
        return sigma * np.clip(rng.standard_normal(shape), -2.9, 2.9)

    rows = []
    for k, (pose, length) in enumerate(zip(poses, lengths, strict=True)):
        seen = tracker @ pose @ target
        turn = Rotation.from_rotvec(noise(SIGMA_R, (3,))) * seen.rotation
        read = length + noise(SIGMA_L, (LEGS,))
        read[WRONG_LEG - 1] += 2.5 if k + 1 == WRONG else 0.0  # mm: a slipped encoder
        place = (seen.origin + noise(SIGMA_P, (3,))) / 1e3
        rows.append([k + 1, *place, *turn.as_euler("xyz", degrees=True), *(read / 1e3)])
    folder = tmp_path_factory.mktemp("tracker")
    names = ["pose", "X [m]", "Y [m]", "Z [m]", "Rx [deg]", "Ry [deg]", "Rz [deg]"]
    names += [f"L{i} [m]" for i in range(1, LEGS + 1)]
    lines = [",".join([f"{row[0]}", *(f"{value:.9f}" for value in row[1:])]) for row in rows]
    (folder / "log.csv").write_text("\n".join([",".join(names), *lines]) + "\n")
    listed = [np.round(part, 3).tolist() for part in drawing]
    (folder / "drawing.toml").write_text(
        'format = "cpcal-campaign/1"\n[robot]\nname = "own hexapod"\n'
        f"base = {listed[0]}\nmobile = {listed[1]}\noffset = {listed[2]}\n[uncertainty]\nexact = true\n"
    )
    return folder


def frames_chosen(campaign: cpcal.Campaign, world: tuple[Any, ...], log: np.ndarray) -> tuple[Frame, Frame]:
    """Frames (C, D): the campaign's pose of a true platform pose A is C A D. From the log and the campaign, between
    which there is no noise: campaign pose = B (pose in the log) T."""
    _, _, tracker, target, _, _ = world
    turns = Rotation.from_euler("xyz", log[:, 3:6], degrees=True)
    given = Rotation.from_quat(campaign.quaternion, scalar_first=True)

    def both(x: np.ndarray) -> tuple[Frame, Frame]:
        left, right = (Frame(Rotation.from_rotvec(v[3:]), v[:3]) for v in (x[:6], x[6:]))
        return left @ tracker.inverse(), target.inverse() @ right

    def misfit(x: np.ndarray) -> np.ndarray:
        left, right = both(x)
        found = left @ Frame(turns, 1e3 * log[:, :3])
        found = Frame(found.rotation * right.rotation, found.rotation.apply(right.origin) + found.origin)
        turned = (found.rotation * given.inv()).as_rotvec()
        return np.concatenate([(found.origin - campaign.position).ravel(), 1e3 * turned.ravel()])

    best = least_squares(misfit, np.zeros(12), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(best.fun).max() < 1e-4  # mm, mrad: what the campaign holds is the log in other frames
    left, right = both(best.x)
    return left @ tracker, target @ right


SIGMAS = f"position={SIGMA_P}[mm], rotation={SIGMA_R}[rad], length={SIGMA_L}[mm]"
UNSEEN = 500
FORM = "euler-xyz-deg"


@dataclass(frozen=True)
class Unseen:
    """Poses that nobody measured: the platform's (in the campaign's frames), and what its encoders read there."""

    frames: list[Frame]
    lengths: np.ndarray
    robot: tuple[np.ndarray, np.ndarray, np.ndarray]  # the true one, in the campaign's frames

    def largest_error(self, x: tuple[float, ...], leg: int) -> float:
        """Of leg number `leg` (from 0) with the parameters x = (a, b, l), mm."""
        a, b, offset = np.array(x[:3]), np.array(x[3:6]), x[6]
        places = np.array([f.rotation.apply(b) + f.origin for f in self.frames])
        return float(np.abs(np.linalg.norm(places - a, axis=1) - offset - self.lengths[:, leg]).max())


@pytest.fixture(scope="module")
def runs(log):
    """What the commands say: with all measurements, and with one that may be wrong."""
    said = done(
        "import", log / "log.csv", "-o", log / "campaign", "--robot", log / "drawing.toml",
        "--rotation", FORM, "--sigma", SIGMAS,
    )  # fmt: skip
    every = done("certify", log / "campaign", "-o", log / "run", "--tolerance", TOLERANCE, status=1)
    done("certify", log / "campaign", "-o", log / "without", "--tolerance", TOLERANCE, "--outliers", 1)
    return said, every


@pytest.fixture(scope="module")
def elsewhere(log, runs, world):
    """500 poses that were not measured, in the frames that the import chose."""
    _, true, *_, rng = world
    campaign = cpcal.load_campaign(log / "campaign")
    rows = np.loadtxt(log / "log.csv", delimiter=",", skiprows=1)[:, 1:]
    left, right = frames_chosen(campaign, world, rows)
    poses = poses_in_base(rng, UNSEEN)
    base, mobile, offset = true
    back = right.inverse()
    seen = left.rotation.apply(base) + left.origin, back.rotation.apply(mobile) + back.origin, offset
    return Unseen([left @ pose @ right for pose in poses], leg_lengths(true, poses), seen)


def test_the_wrong_reading_is_named_with_the_leg_that_it_refutes(log, runs):
    assert f"Leg {WRONG_LEG}: fail because of measurement {WRONG}" in runs[1]
    result = cpcal.load_result(log / "run")
    assert [cpcal.verdict_of(result, leg).word for leg in result.legs].count("fail") == 1


def test_without_it_every_leg_passes_with_parameters_as_good_as_least_squares_without_it(log, elsewhere):
    result, campaign = cpcal.load_result(log / "without"), cpcal.load_campaign(log / "campaign")
    for leg, found in enumerate(result.legs):
        assert cpcal.verdict_of(result, found).word == "pass"
        rows = np.array([k for k in range(POSES) if (k + 1, leg + 1) != (WRONG, WRONG_LEG)])

        def residuals(x, rows=rows, leg=leg):
            places = Rotation.from_quat(campaign.quaternion[rows], scalar_first=True).apply(x[3:6])
            return np.linalg.norm(campaign.position[rows] + places - x[:3], axis=1) - x[6] - campaign.length[rows, leg]

        plain = least_squares(residuals, campaign.robot.parameters[leg], x_scale="jac", xtol=1e-15, ftol=1e-15).x
        ours, theirs = (elsewhere.largest_error(x, leg) for x in (found.recommended.point, plain))
        assert theirs < 0.1  # mm: the frames and the noise are what they should be
        assert ours <= 1.2 * theirs


@pytest.mark.parametrize("count", [12, pytest.param(UNSEEN, marks=pytest.mark.nightly)])  # a certificate names each
def test_the_accuracy_that_is_stated_holds_where_nobody_measured(log, elsewhere, count):
    frames = elsewhere.frames[:count]
    quaternions = [f.rotation.as_quat(scalar_first=True) for f in frames]
    rows = [
        ",".join([str(k + 1), *(repr(float(v)) for v in (*f.origin, *q))])
        for k, (f, q) in enumerate(zip(frames, quaternions, strict=True))
    ]
    (log / f"unseen-{count}.csv").write_text("\n".join(["pose,x,y,z,qw,qx,qy,qz", *rows]) + "\n")
    done("accuracy", log / "without", "--poses", log / f"unseen-{count}.csv", "-o", log / f"accuracy-{count}")
    found, result = load_accuracy(log / f"accuracy-{count}"), cpcal.load_result(log / "without")
    loaded = np.array([leg.recommended.point for leg in result.legs])
    robot = loaded[:, :3], loaded[:, 3:6], loaded[:, 6]
    beyond = 0
    for pose, frame, lengths in zip(found.poses, frames, leg_lengths(robot, frames), strict=True):
        there = reached(elsewhere.robot, frame, lengths)
        off = float(np.linalg.norm(there.origin - frame.origin))
        assert pose.proved
        assert off <= pose.position_bound
        assert (there.rotation * frame.rotation.inv()).magnitude() <= pose.rotation_bound
        beyond += off > pose.u_position
    assert beyond <= 0.1 * count  # U is an estimate, which covers about 95 of 100


def test_six_lines_of_python_say_the_same(log, runs):
    campaign = cpcal.load_log(
        log / "log.csv", robot=str(log / "drawing.toml"), rotation=FORM,
        position_sigma=SIGMA_P, rotation_sigma=SIGMA_R, length_sigma=SIGMA_L,
    )  # fmt: skip
    result = cpcal.certify(campaign, tolerance=TOLERANCE, outliers=1)
    words = [cpcal.verdict_of(result, leg).word for leg in result.legs]
    load = [leg.recommended.point for leg in result.legs]
    accuracy = cpcal.certify_accuracy(campaign, result, cells=4)  # the workspace, coarsely: for speed
    assert words == ["pass"] * LEGS
    assert result.legs[WRONG_LEG - 1].bracket.left_out == (f"{WRONG}/1",)
    kept = cpcal.load_result(log / "without")
    np.testing.assert_allclose(load, [leg.recommended.point for leg in kept.legs], atol=1e-6)
    assert accuracy.poses
    assert all(pose.proved for pose in accuracy.poses)
