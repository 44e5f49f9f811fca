"""Values stay what they are: copied, replaced, pickled, their arrays are read-only and their digest is true."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256, load_campaign, save_campaign
from cpcal.robot import DELTALAB, ModelChoice, Robot
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
