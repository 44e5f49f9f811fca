"""Values stay what they are: copied, replaced, pickled, with a true digest; campaigns are checked as a whole."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256, load_campaign, save_campaign
from cpcal.robot import DELTALAB, Campaign, ModelChoice, Robot, Uncertainty
from cpcal.simulate import simulate, simulate_study

CAMPAIGN = dataclasses.replace(simulate(seed=1, random_poses=3), model=ModelChoice("gain", {"s": 0.1}))
STUDY = simulate_study(seed=1, runs=1, validation_runs=1, random_poses=2, sag=0.5)
VALUES = {
    "campaign": CAMPAIGN, "robot": CAMPAIGN.robot, "uncertainty": CAMPAIGN.uncertainty, "model": CAMPAIGN.model,
    "study": STUDY, "table": STUDY.calibration, "truth": STUDY.truth,
}  # fmt: skip
WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "replace": dataclasses.replace,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
}


def arrays(value):
    """Every array inside."""
    if isinstance(value, np.ndarray):
        yield value
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from arrays(getattr(value, field.name))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", VALUES)
def test_a_copy_is_equal_and_read_only(name, way):
    value = VALUES[name]
    again = WAYS[way](value)
    assert again == value
    assert hash(again) == hash(value)
    for array in arrays(again):
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


@pytest.mark.parametrize("way", WAYS)
def test_the_digest_of_a_copy_is_true(way, tmp_path):
    assert campaign_sha256(WAYS[way](CAMPAIGN)) == campaign_sha256(CAMPAIGN)
    save_campaign(CAMPAIGN, tmp_path)
    (tmp_path / "campaign.toml").write_bytes((tmp_path / "campaign.toml").read_bytes() + b"# a remark\n")
    loaded = load_campaign(tmp_path)
    again = WAYS[way](loaded)
    either = campaign_sha256(loaded), campaign_sha256(CAMPAIGN)  # of the files, or of the same campaign without them
    assert campaign_sha256(again) in either
    changed = dataclasses.replace(again, length=again.length + 1.0)
    assert campaign_sha256(changed) not in (campaign_sha256(loaded), campaign_sha256(CAMPAIGN))


def test_values_do_not_hold_on_to_the_callers_arrays():
    position, provenance = np.array(CAMPAIGN.position), {"a": "b"}
    campaign = dataclasses.replace(CAMPAIGN, position=position, provenance=provenance)
    digest = campaign_sha256(campaign)
    position[:] = 0.0
    provenance["a"] = "c"
    assert campaign.position.any()
    assert campaign.provenance == {"a": "b"}
    assert campaign_sha256(dataclasses.replace(campaign)) == digest


def test_deltalab_is_the_papers_table_1():
    assert DELTALAB.legs == 6
    assert DELTALAB.parameters[3].tolist() == [20.0093, 269.2575, 0.0, 157.9880, 114.3013, 0.0, 345.0]
    assert np.abs(np.linalg.norm(DELTALAB.base, axis=1) - 270).max() < 0.1  # "a base of radius 270 mm"
    assert np.abs(np.linalg.norm(DELTALAB.mobile, axis=1) - 195).max() < 0.1


@pytest.mark.parametrize(
    ("base", "mobile", "offset", "count"),
    [
        ([[0, 0, 0]], [[0, 0]], [1], 1),
        ([[0, 0, 0]], [[0, 0, 0], [1, 1, 1]], [1, 2, 3], 2),
        ([[0, 0, float("nan")]], [[0, 0, 0]], [float("inf")], 2),
        ([], [], [], 3),
        ([[0, 0, 0], [0]], [["a", 0, 0]], [1], 3),
    ],
)
def test_senseless_robots_are_refused_with_every_problem(base, mobile, offset, count):
    with pytest.raises(InputError) as caught:
        Robot("r", base, mobile, offset)
    assert len(caught.value.problems) == count


def in_memory(**changes):
    values = {"position": np.zeros((3, 3)), "quaternion": np.tile([1.0, 0, 0, 0], (3, 1)), "length": np.zeros((3, 6))}
    how = {} if "uncertainty" in changes else {"exact": True}
    return Campaign.of(DELTALAB, **values | how | changes)


def test_every_problem_of_a_campaign_in_memory_is_reported_at_once():
    position = np.zeros((3, 3))
    position[1, 2] = np.nan
    quaternion = np.array([[1.0, 0, 0, 0], [1.0, 0.1, 0, 0], [0.0, 0, 0, 0]])
    with pytest.raises(InputError) as caught:
        in_memory(position=position, quaternion=quaternion, pose=["a", "a", "b/c"], run="111", length_radius=-1.0)
    message = str(caught.value)
    assert len(caught.value.problems) == 8
    for part in (
        "'b/c' cannot be a name",
        "measurement a/1: is given 2 times",
        "measurement a/1: its position is NaN",
        "measurement a/1: the quaternion has the norm 1.00498756, not 1",
        "measurement b/c/1: the quaternion is zero",
        "its length_radius is negative, NaN",
    ):
        assert part in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((0, 3)), "quaternion": np.zeros((0, 4)), "length": np.zeros((0, 6))}, "no meas"),
        ({"length": np.zeros((3, 5))}, r"has the shape \(3, 5\), not \(3, 6\)"),
        ({"quaternion": np.zeros((2, 4))}, "campaign quaternion"),
        ({"position_radius": np.zeros((2, 3))}, "campaign position_radius"),
        ({"run": ["1"]}, "has 1 names"),
        ({"pose": ["a", "b", "\ud800"]}, "cannot be a name"),
        ({"pose": ["a", "b", ""]}, "cannot be a name"),
        ({"pose": ["a", "b", 3]}, "cannot be a name"),
        ({"position": "abc"}, "numbers"),
        ({"position": 3.0}, "campaign position"),
        ({"provenance": {"a": 3}}, "printable"),
        ({"provenance": {"a": "\ud800"}}, "printable"),
        ({"uncertainty": Uncertainty([0, 0, 0], [0, 0, 0], [0] * 5, 3)}, "has 5 numbers for 6 legs"),
        ({"length": np.full((3, 6), np.inf)}, "infinite"),
        ({"quaternion": np.full((3, 4), 1e300)}, "the norm 2e\\+300"),
    ],
)
def test_what_makes_no_campaign_in_memory(changes, message):
    with pytest.raises(InputError, match=message):
        in_memory(**changes)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (([0, 0], [0, 0, 0], [0]), r"position: has the shape \(2,\)"),
        (([0, 0, -1], [0, 0, 0], [0]), "position: holds a number that is negative"),
        (([0, 0, 0], [0, 0, 0], [np.inf]), "length: holds a number that is negative, not finite"),
        (([1e308, 0, 0], [0, 0, 0], [0], 10.0), "position: holds a number that is negative, not finite or above"),
        (([0, 0, 0], [0, 0, 0], [0], -1.0), "factor: is -1.0"),
    ],
)
def test_senseless_uncertainties(arguments, reason):
    with pytest.raises(InputError, match=reason):
        Uncertainty(*arguments)
