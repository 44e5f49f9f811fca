"""Errors that all images share: counted in full in reading sets and frames, however often a pose is repeated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cpcal.calibration import calibrate_study, load_record, recorded, save_record
from cpcal.calibration.alignment import SharedError
from cpcal.common.errors import InputError
from cpcal.files import load_study, save_study
from cpcal.report.study_page import poses
from cpcal.robot import PoseTable, Study, quaternion_from_rotation_vector, quaternion_product
from cpcal.simulate import simulate_study

SHARED = np.array([0.01, 0.02, 0.05, 2e-5, 3e-5, 1e-5])


def with_shared(study: Study) -> Study:
    tables = (replace(t, shared=np.tile(SHARED, (len(t), 1))) for t in (study.calibration, study.validation))
    calibration, validation = tables
    return replace(study, calibration=calibration, validation=validation)


@pytest.fixture(scope="module")
def study() -> Study:
    return simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12)


def test_the_shared_part_is_not_divided_by_the_repeats(study: Study) -> None:
    plain, counted = (calibrate_study(one, factor=2.0) for one in (study, with_shared(study)))
    for before, after in ((plain.campaign, counted.campaign), (plain.check, counted.check)):
        widths, without = (
            np.concatenate([one.position_radius, one.rotation_radius], axis=1) for one in (after, before)
        )
        np.testing.assert_allclose(widths**2 - without**2, np.tile((2.0 * SHARED) ** 2, (len(after), 1)), rtol=1e-9)
        np.testing.assert_array_equal(after.length_radius, before.length_radius)
        assert "share are counted in full" in after.provenance["averaged"]
    assert plain.shared is None
    np.testing.assert_array_equal(plain.x_c.parameters, counted.x_c.parameters)


def test_the_record_states_both_figures(study: Study, tmp_path: Path) -> None:
    shared = with_shared(study)
    found, plain = calibrate_study(shared), calibrate_study(study)
    record, without = recorded(shared, found, factor=3.0), recorded(study, plain, factor=3.0)
    save_record(record, tmp_path)
    assert load_record(tmp_path) == record
    assert record.shared is not None
    assert record.shared.pose == pytest.approx(SHARED)
    named = {row[0]: row[1:] for row in poses(record, paper_too=False).rows}
    assert named["shared by all images, beside it"][:3] == ("0.01", "0.02", "0.05")
    assert named["this study"] == poses(without, paper_too=False).rows[0][1:]
    assert any("No repeat shows them" in sentence for sentence in record.sentences)
    for frame, before in (
        (record.frames.camera_in_base, without.frames.camera_in_base),
        (record.frames.target_in_mobile, without.frames.target_in_mobile),
    ):
        added = np.sqrt(np.square(frame.sigma) - np.square(before.sigma))
        assert (added[:3] >= 0.05 - 1e-9).all()
        assert added[3:] == pytest.approx(3e-5)


def test_a_pose_that_is_off_alike_everywhere_moves_the_frames_by_no_more_than_is_stated(study: Study) -> None:
    """All poses of the target moved by 0.05 mm and 0.1 mrad: the frames take it, and less than is stated."""
    plain = calibrate_study(study)
    rng = np.random.default_rng(1)
    for _ in range(3):
        step = rng.standard_normal(6) * np.repeat([0.05, 1e-4], 3)
        off = calibrate_study(replace(study, calibration=_moved(study.calibration, step)))
        shared = SharedError((0.05, 0.05, 0.05, 1e-4, 1e-4, 1e-4), float(np.linalg.norm(plain.campaign.position[0])))
        for before, after, stated in (
            (plain.base_frame, off.base_frame, shared.camera_in_base),
            (plain.mobile_frame, off.mobile_frame, shared.target_in_mobile),
        ):
            assert (np.abs(after.motion.position - before.motion.position) < 4.0 * stated[:3]).all()


def _moved(table: PoseTable, step: np.ndarray) -> PoseTable:
    turned = quaternion_product(quaternion_from_rotation_vector(step[3:]), table.quaternion)
    return replace(table, position=table.position + step[:3], quaternion=turned)


def test_files_keep_it_and_refuse_half_of_it(study: Study, tmp_path: Path) -> None:
    shared = with_shared(study)
    save_study(shared, tmp_path / "study")
    assert load_study(tmp_path / "study") == shared
    path = tmp_path / "study" / "calibration.csv"
    text = path.read_text()
    path.write_text(text.replace("shared_sz", "shared_sq", 1))
    with pytest.raises(InputError, match="shared_sq"):
        load_study(tmp_path / "study")
    rows = [line.rsplit(",", 1)[0] for line in text.splitlines()]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match="'shared_srz' is missing"):
        load_study(tmp_path / "study")
    path.write_text(text.replace(",0.02,", ",-0.02,"))
    with pytest.raises(InputError, match="shared deviation is negative"):
        load_study(tmp_path / "study")
