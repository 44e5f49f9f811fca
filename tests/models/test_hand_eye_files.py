"""Hand-eye studies in files: what is written is read back, and every mistake is named with its line."""

from dataclasses import replace

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.hand_eye import load_hand_eye, save_hand_eye, simulate_hand_eye


@pytest.fixture
def folder(tmp_path):
    save_hand_eye(simulate_hand_eye(images=4, corners=(3, 3), seed=1).study, tmp_path / "study")
    return tmp_path / "study"


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_study_is_read_back_bit_for_bit(tmp_path, setup):
    study = simulate_hand_eye(setup=setup, images=4, corners=(3, 3), seed=1).study
    widths = np.linspace(0.0, 0.1, 24).reshape(4, 6)
    wide = replace(study, half_width=np.linspace(0.1, 0.3, len(study.image)), pose_half_width=widths)
    for one in (study, wide):
        assert load_hand_eye(save_hand_eye(one, tmp_path / "study")) == one


def _replace(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_all_problems_are_told_at_once(folder):
    _replace(folder / "handeye.toml", "eye-in-hand", "eye-on-foot")
    _replace(folder / "poses.csv", "image002,", "image002,x")
    _replace(folder / "poses.csv", "image003,", "image001,")
    _replace(folder / "points.csv", "image001,p2,", "image001,p1,")
    with pytest.raises(InputError) as raised:
        load_hand_eye(folder)
    text = str(raised.value)
    assert "setup is 'eye-on-foot'" in text
    assert "poses.csv:3" in text
    assert "poses.csv:4: image 'image001' was given on line 2 already -> give each image once" in text
    assert "points.csv:3: image 'image001' point 'p1' was given on line 2 already" in text


def test_images_on_one_side_only_are_named(folder):
    lines = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join([*lines[:-1], lines[-1].replace("image004", "image009")]) + "\n")
    with pytest.raises(InputError) as raised:
        load_hand_eye(folder)
    assert "'image004' has no pose" in str(raised.value)
    assert "'image009' has no points" in str(raised.value)
