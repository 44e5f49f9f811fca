"""Campaigns from what users have in memory: units, rotation forms, DataFrames, and every mistake said."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from cpcal import load_log
from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Campaign, rotation_matrix
from cpcal.robot.units import SEQUENCES, RotationForm, column_map, override_columns, reading_columns
from cpcal.simulate import simulate

pandas = pytest.importorskip("pandas")

GOOD = simulate(seed=3, random_poses=5)
TURNS = Rotation.from_quat(GOOD.quaternion, scalar_first=True)


def from_arrays(rotations, **more):
    arguments = {"exact": True, "robot": DELTALAB, **more}
    return Campaign.from_arrays(GOOD.position, rotations, GOOD.length, **arguments)


def same_rotations(campaign):
    assert_allclose(rotation_matrix(campaign.quaternion), TURNS.as_matrix(), atol=1e-12)


def test_every_euler_sequence_means_what_it_means_in_scipy():
    assert len(SEQUENCES) == 24
    angles = np.random.default_rng(0).uniform(-3, 3, (20, 3))
    for sequence in SEQUENCES:
        expected = Rotation.from_euler(sequence, angles).as_matrix()
        for unit, values in (("rad", angles), ("deg", np.degrees(angles))):
            found = RotationForm.named(f"euler-{sequence}-{unit}").quaternions(values)
            assert_allclose(rotation_matrix(found), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("form", "rotations"),
    [
        ("quaternion-wxyz", GOOD.quaternion),
        ("quaternion-xyzw", TURNS.as_quat()),
        ("matrix", TURNS.as_matrix()),
        ("matrix", TURNS.as_matrix().reshape(-1, 9)),
        ("matrix", np.round(TURNS.as_matrix(), 15)),
        ("vector-rad", TURNS.as_rotvec()),
        ("vector-deg", TURNS.as_rotvec(degrees=True)),
        ("euler-xyz-deg", TURNS.as_euler("xyz", degrees=True)),
        ("quaternion-wxyz", TURNS),
    ],
)
def test_all_forms_of_the_same_rotations_give_the_same_campaign(form, rotations):
    same_rotations(from_arrays(rotations, rotation=form))
    assert RotationForm.named(form).name == form


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rotation": "euler-xxy-deg"}, "no form of rotations -> give quaternion-wxyz"),
        ({"robot": "delta"}, "there is no robot called 'delta'"),
        ({"exact": False}, "is missing -> give the standard deviations"),
        ({"position_sigma": 0.1}, "rotation_sigma and length_sigma missing"),
        ({"length_sigma": [1, 2], "position_sigma": 0, "rotation_sigma": 0}, "give one number, or 3, 3 and 6"),
        ({"rotation": "quaternion-xyzw", "rotations": GOOD.quaternion[:, :3]}, "give one row of 4 numbers"),
        ({"rotations": 2 * GOOD.quaternion}, "rotation of row 0: is a quaternion whose norm is not 1"),
        ({"rotation": "matrix", "rotations": -TURNS.as_matrix()}, "left-handed"),
        ({"rotation": "vector-rad", "rotations": TURNS.as_rotvec() * np.nan}, "not finite"),
        ({"rotations": GOOD.quaternion + 0j}, "rotations: values of the type complex128 are no real numbers"),
        ({"rotations": np.ma.masked_less(GOOD.quaternion, 0.0)}, "rotations: some values are masked"),
    ],
)
def test_mistakes_are_said(changes, message):
    with pytest.raises(InputError) as caught:
        from_arrays(changes.pop("rotations", GOOD.quaternion), **changes)
    assert message in str(caught.value)


@pytest.mark.parametrize("which", [0, 1])
def test_readings_that_are_no_real_numbers_are_refused_instead_of_taken(which):
    """Readings that were marked as bad must not come back as good ones."""
    for spoil in (lambda v: np.ma.masked_greater(v, v.mean()), lambda v: v + 1j, lambda v: v > 0.0):
        given = [GOOD.position, GOOD.length]
        given[which] = spoil(given[which])
        with pytest.raises(InputError, match=r"masked|no real numbers"):
            Campaign.from_arrays(given[0], GOOD.quaternion, given[1], robot="deltalab", exact=True)
        with pytest.raises(InputError, match=r"masked|no real numbers"):
            Campaign.of(DELTALAB, given[0], GOOD.quaternion, given[1], exact=True)
    masked = [np.ma.masked_greater(row, 0.0) for row in GOOD.position]
    with pytest.raises(InputError, match="masked"):
        Campaign.from_arrays(masked, GOOD.quaternion, GOOD.length, robot="deltalab", exact=True)


def framed():
    """GOOD as a data frame with the columns of measurements.csv, half-widths included."""
    numbers = (GOOD.position, GOOD.quaternion, GOOD.length)
    radii = (GOOD.position_radius, GOOD.rotation_radius, GOOD.length_radius)
    titles = [*reading_columns(6)[2:], *override_columns(6)]
    frame = pandas.DataFrame(np.concatenate([*numbers, *radii], axis=1), columns=titles)
    frame.insert(0, "pose", list(GOOD.pose))
    frame.insert(1, "run", list(GOOD.run))
    return frame


def test_a_frame_is_read_as_the_campaign_that_it_holds():
    frame = framed()
    again = load_log(frame, robot=DELTALAB, exact=True)  # but for half-widths in the frame itself
    for name in ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius"):
        assert np.array_equal(getattr(again, name), getattr(GOOD, name))
    assert again.measurement_ids == GOOD.measurement_ids


def test_a_frame_with_foreign_columns_is_mapped():
    table = {"Tx": GOOD.position[:, 0] / 1e3, "Ty": GOOD.position[:, 1] / 1e3, "Tz, up": GOOD.position[:, 2] / 1e3}
    angles = TURNS.as_euler("ZYX", degrees=True)
    table |= {name: angles[:, k] for k, name in enumerate("ABC")}
    table |= {f"leg{i + 1}": GOOD.length[:, i] for i in range(6)}
    frame = pandas.DataFrame(table)
    legs = ", ".join(f"L{i}=leg{i}" for i in range(1, 7))
    campaign = load_log(
        frame,
        robot="deltalab",
        columns=f'x=Tx[m], y=Ty[m], z="Tz, up"[m], r1=A, r2=B[deg], r3=#6, {legs}',
        rotation="euler-ZYX-deg",
        exact=True,
    )
    same_rotations(campaign)
    assert_allclose(campaign.position, GOOD.position, rtol=1e-14)
    assert campaign.measurement_ids[:2] == ("p1/1", "p2/1")


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("L1=L2, L2=L2", "L1 and L2 are the same column, 'L2' -> map each to its own"),
        ("L3=#11, L1=L2, L2=L1", "L3 and L1 are the same column"),
        ("drx=error", r"drx has no unit -> write drx=error[deg] or [rad]"),
    ],
)
def test_maps_that_would_be_wrong_without_a_word_are_refused(columns, message):
    frame = framed().iloc[:, :15]
    frame["error"] = 0.01
    with pytest.raises(InputError) as caught:
        load_log(frame, robot="deltalab", columns=columns, exact=True)
    assert message in str(caught.value)


def test_frames_that_do_not_fit_are_refused_with_every_problem():
    frame = framed().drop(columns=["z", "L3"])
    with pytest.raises(InputError, match="add z, L1, L2, L3, L4, L5, L6"):
        load_log(frame, robot="deltalab", exact=True)
    with pytest.raises(InputError, match="x cannot be in deg"):
        load_log(framed(), robot="deltalab", columns="x=x[deg]", exact=True)
    with pytest.raises(InputError, match=r"uncertainty: is not stated; .* --exact"):
        load_log(framed().iloc[:, :15], robot="deltalab")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X=Tx", "unknown column 'X'"),
        ("x=Tx, x=Ty", "x is given twice"),
        ("x=", "x has no column"),
        ("x=Tx[yd]", "unknown unit 'yd'"),
        ("nonsense", "cannot be read from 'nonsense' on"),
        ("x=a[mm]b", "cannot be read"),
    ],
)
def test_maps_that_mean_nothing_are_refused(text, message):
    with pytest.raises(InputError) as caught:
        column_map(text, ["x", "y"])
    assert message in str(caught.value)
