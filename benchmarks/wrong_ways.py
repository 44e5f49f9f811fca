"""Wrong ways to enter the data of a campaign: each takes a true one and returns what a hurried user would have made."""

# mypy: ignore-errors
from collections.abc import Callable
from dataclasses import replace as changed

import numpy as np
from scipy.spatial.transform import Rotation

from cpcal.robot import Campaign, Pose, Robot, Uncertainty, inverse, rotation_vector
from cpcal.robot.units import quaternion_from_euler


def euler(campaign, sequence):
    return Rotation.from_quat(campaign.quaternion, scalar_first=True).as_euler(sequence)


def of_other_axes(campaign, axes):
    """Written in frames whose axes are the rows of a matrix."""
    axes = np.array(axes, dtype=float)
    matrix = Rotation.from_quat(campaign.quaternion, scalar_first=True).as_matrix()
    turned = Rotation.from_matrix(axes @ matrix @ axes.T).as_quat(scalar_first=True)
    return changed(campaign, position=campaign.position @ axes.T, quaternion=turned)


def in_tracker_frame(campaign):
    camera = Rotation.from_rotvec([0.4, -2.0, 1.0])
    target = Rotation.from_rotvec([0.1, 0.3, -0.2])
    platform = Rotation.from_quat(campaign.quaternion, scalar_first=True)
    seen = (camera * platform * target).as_quat(scalar_first=True)
    place = camera.apply(campaign.position + platform.apply([10.0, -20.0, 35.0])) + [500.0, 900.0, 1500.0]
    return changed(campaign, position=place, quaternion=seen)


def inverted(campaign):
    pose = inverse(Pose(campaign.position, campaign.quaternion))
    return changed(campaign, position=pose.position, quaternion=pose.quaternion)


def of_target(campaign, turn):
    """Of a target on the mobile platform, shifted and turned."""
    platform = Rotation.from_quat(campaign.quaternion, scalar_first=True)
    place = campaign.position + platform.apply([50.0, -20.0, 80.0])
    seen = (platform * Rotation.from_rotvec(turn)).as_quat(scalar_first=True)
    return changed(campaign, position=place, quaternion=seen)


def with_drawing(campaign, **parts):
    return changed(campaign, robot=changed(campaign.robot, **parts))


def in_unit(campaign, factor, *what):
    return changed(campaign, **{name: getattr(campaign, name) / factor for name in what})


def with_length(campaign, where, change):
    """Some leg readings changed."""
    length = campaign.length.copy()
    length[where] = change(length[where])
    return changed(campaign, length=length)


def twice(campaign):
    rows = [*range(len(campaign)), 4, 9]
    fields = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")
    names = {"pose": [*campaign.pose, "again", "more"], "run": [*campaign.run, "1", "1"]}
    return changed(campaign, **{name: getattr(campaign, name)[rows] for name in fields}, **names)


def wrong_turn(campaign):
    quaternion = campaign.quaternion.copy()
    quaternion[11] = quaternion[12]
    return changed(campaign, quaternion=quaternion)


def one_pose(campaign):
    rows = np.zeros(len(campaign), dtype=int)
    noise = np.random.default_rng(1).normal(0.0, 0.02, campaign.length.shape)
    place, turn = campaign.position[rows], campaign.quaternion[rows]
    return changed(campaign, position=place + noise[:, :3], quaternion=turn, length=campaign.length[rows] + noise)


def sigma_in_degrees(campaign):
    stated = Uncertainty([0.06] * 3, [0.12] * 3, [0.01] * campaign.legs, 3.0)
    return changed(campaign, uncertainty=stated, rotation_radius=np.full_like(campaign.position, 0.36))


RADII = ("position_radius", "rotation_radius", "length_radius")
# What was done wrong, and what `check` must say of it.
WRONG_WAYS: dict[str, tuple[Callable[[Campaign], Campaign], str]] = {
    "quaternion scalar last": (lambda c: changed(c, quaternion=np.roll(c.quaternion, -1, axis=1)),
        "quaternions are in the order qx,qy,qz,qw"),
    "positions in metres": (lambda c: in_unit(c, 1e3, "position"), "positions are in metres"),
    "readings in metres": (lambda c: in_unit(c, 1e3, "length"), "leg readings are in metres"),
    "all in metres": (lambda c: in_unit(c, 1e3, "position", "length"), "positions and leg readings are in metres"),
    "drawing in inches": (lambda c: changed(c, robot=Robot.from_parameters("r", c.robot.parameters / 25.4)),
        "the drawing is in inches"),
    "degrees for radians": (lambda c: changed(c, quaternion=quaternion_from_euler("xyz", np.degrees(euler(c, "xyz")))),
        "rotation angles are in degrees"),
    "radians for degrees": (lambda c: changed(c, quaternion=quaternion_from_euler("ZYX", np.radians(euler(c, "ZYX")))),
        "rotation angles are in radians"),
    "Euler order": (lambda c: changed(c, quaternion=quaternion_from_euler("ZYX", euler(c, "XYZ"))),
        "rotations are Euler angles XYZ (or zyx), not Euler angles ZYX"),
    "fixed axes for turned ones": (lambda c: changed(c, quaternion=quaternion_from_euler("zyx", euler(c, "ZYX"))),
        "Euler angles xyz (or ZYX), not Euler angles XYZ"),
    "proper Euler angles": (lambda c: changed(c, quaternion=quaternion_from_euler("XYZ", euler(c, "ZXZ"))),
        "Euler angles ZXZ (or zxz), not Euler angles XYZ"),
    "rotation vector": (lambda c: changed(c, quaternion=quaternion_from_euler("XYZ", rotation_vector(c.quaternion))),
        "rotations are rotation vectors, not Euler angles XYZ"),
    "one angle in radians": (
        lambda c: changed(c, quaternion=quaternion_from_euler("ZYX", euler(c, "ZYX") / [1.0, 57.29578, 1.0])),
        "rotation angles are in radians, and were taken for degrees: the one about y alone"),
    "target shifted": (lambda c: of_target(c, [0.0, 0.0, 0.0]),
        "likely cause: poses are not those of the drawing's mobile frame: its origin is at (-"),
    "target turned": (lambda c: of_target(c, [0.1, 0.2, 0.3]),
        "likely cause: poses are not those of the drawing's mobile frame"),
    "base shifted": (lambda c: changed(c, position=c.position + [100.0, 0.0, -250.0]),
        "poses are not given in the drawing's base frame: its origin is at ("),
    "one leg counts backwards": (lambda c: with_length(c, (slice(None), 1), lambda read: 140.0 - read),
        "the readings of leg 2 count the other way"),
    "all legs count backwards": (lambda c: changed(c, length=140.0 - c.length),
        "readings have the wrong sign, and an offset is missing or wrong: all legs lack 1"),
    "two mobile joints exchanged": (lambda c: with_drawing(c, mobile=c.robot.mobile[[0, 1, 3, 2, 4, 5]]),
        "the rows of mobile are in another order than those of base (take rows 1, 2, 4, 3, 5, 6)"),
    "left-handed frame": (lambda c: of_other_axes(c, np.diag([1, -1, 1])),
        "frames are left-handed: the drawing's (x, y, z) are their (x, -y, z)"),
    "y is up": (lambda c: of_other_axes(c, [[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
        "frames are of other axes: the drawing's (x, y, z) are their (x, -z, y)"),
    "legs permuted": (lambda c: changed(c, length=c.length[:, [0, 2, 1, 3, 5, 4]]),
        "leg 2 stands in L3, leg 3 stands in L2, leg 5 stands in L6, leg 6 stands in L5"),
    "platforms swapped": (lambda c: with_drawing(c, base=c.robot.mobile, mobile=c.robot.base),
        "or the drawing's base and mobile are swapped"),
    "joints shifted": (lambda c: with_drawing(c, mobile=np.roll(c.robot.mobile, 1, axis=0)),
        "the rows of mobile are in another order than those of base (take rows 2, 3, 4, 5, 6, 1)"),
    "offset missing": (lambda c: with_drawing(c, offset=np.zeros(c.legs)), "an offset is missing or wrong"),
    "offset twice": (lambda c: changed(c, length=c.length + c.robot.offset), "readings are whole leg lengths"),
    "inverse pose": (inverted, "poses are those of the base in the mobile frame"),
    "transposed matrix": (lambda c: changed(c, quaternion=c.quaternion * [1, -1, -1, -1]),
        "rotations are from base to mobile frame"),
    "tracker frame": (in_tracker_frame, "a target in a tracker's frame"),
    "one leg in inches": (lambda c: with_length(c, (slice(None), 3), lambda read: read / 25.4),
        "the readings of leg 4 are in inches"),
    "rows shifted": (lambda c: changed(c, length=np.roll(c.length, 1, axis=0)), "leg readings stand 1 row below"),
    "encoder counts": (lambda c: changed(c, length=512.0 * c.length + 10_000.0), "1 mm is about 51"),
    "readings negative": (lambda c: changed(c, length=-c.length), "readings have the wrong sign"),
    "metres and scalar last": (
        lambda c: changed(c, position=c.position / 1e3, quaternion=np.roll(c.quaternion, -1, axis=1)),
        "positions are in metres, not mm, and quaternions are in the order"),
    "uncertainties too large": (
        lambda c: changed(c, **{name: 10.0 * getattr(c, name) for name in RADII}, uncertainty=None),
        "Your uncertainties are "),
    "uncertainties too small": (
        lambda c: changed(c, **{name: 0.01 * getattr(c, name) for name in RADII}, uncertainty=None),
        "times what you state: a convention, a frame or the model is wrong"),
    "duplicate rows": (twice, "the same numbers"),
    "one outlier": (lambda c: with_length(c, (7, 2), lambda read: read + 4.0), "e07/1: leg 3"),
    "one wrong pose": (wrong_turn, "e11/1: its pose"),
    "constant pose": (one_pose, "show the same pose"),
    "sigma in degrees": (sigma_in_degrees, "degrees are given where radians are meant"),
}  # fmt: skip
