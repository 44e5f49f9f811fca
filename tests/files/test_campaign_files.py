"""Campaigns in memory and on disk: round trips bit for bit, digests, atomic writing."""

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
from cpcal.robot import DELTALAB, Campaign, Robot, Uncertainty
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
        robot,
        array(count, 3),
        quaternion,
        array(count, legs),
        pose=draw(st.lists(names, min_size=count, max_size=count, unique=True)),
        run=draw(st.lists(names, min_size=count, max_size=count)),
        uncertainty=uncertainty,
        exact=uncertainty is None,
        provenance=draw(st.dictionaries(text, text, max_size=3)),
        **radii,
    )


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
