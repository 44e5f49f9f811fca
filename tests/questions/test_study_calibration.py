"""The whole classical way on simulated studies: what was put in comes out, and goes through a file."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cpcal import InputError
from cpcal.calibration import nearest_motion
from cpcal.calibration.statistics import study_rows
from cpcal.files import load_study, save_study
from cpcal.questions import Inputs, StudyCalibration, calibrate_study, load_record, save_record
from cpcal.report.study_page import calibration
from cpcal.robot import PoseTable, Robot, Study, inverse, transformed
from cpcal.simulate import simulate_study, true_robot
from tests.changed import with_outliers


@pytest.fixture(scope="module")
def study() -> Study:
    return simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12)


@pytest.fixture(scope="module")
def found(study: Study) -> StudyCalibration:
    return calibrate_study(study)


def test_the_true_parameters_are_found(study: Study, found: StudyCalibration) -> None:
    truth = study.truth
    assert truth is not None
    base, mobile = transformed(truth.camera, truth.robot.base), transformed(inverse(truth.target), truth.robot.mobile)
    true = Robot("", base, mobile, truth.robot.offset).parameters
    for campaign in (found.campaign, found.check):  # means keep what the study says of itself
        assert campaign.simulated
        known = true_robot(campaign)
        assert known is not None
        np.testing.assert_allclose(known.parameters, true, atol=1e-9)
    for best in (found.x_c, found.x_c_sigma):
        assert np.mean(np.abs(best.parameters - true) <= 3.9 * best.standard_errors) > 0.9
        assert np.abs(best.parameters - true).max() < 0.5


def test_poses_improve_and_validation_knows_the_noise_of_its_own_readings(found: StudyCalibration) -> None:
    check = found.record.validation
    for validation in (check.x_c, check.x_c_sigma):
        assert not validation.failed
        assert validation.floor is not None
        for kind, floor in zip(("position", "orientation"), validation.floor, strict=True):
            figures = validation.figures(kind)
            assert figures["mean"][1] < 0.2 * figures["mean"][0]
            assert 0.3 < figures["rms"][1] / floor < 3.0


def test_one_gross_error_leaves_statistics_and_validation_alone(study: Study, found: StudyCalibration) -> None:
    def spoiled(table: PoseTable) -> PoseTable:
        position = table.position.copy()
        position[5] += 100.0
        return replace(table, position=position)

    tables = (spoiled(table) for table in (study.calibration, study.validation))
    calibration, validation = tables
    wrong, good = calibrate_study(replace(study, calibration=calibration, validation=validation)).record, found.record
    assert wrong.repeats.left_out == ("e01/2",)
    assert wrong.validation.left_out == ("r001/3",)
    assert wrong.repeats.channels[0].sigma == pytest.approx(good.repeats.channels[0].sigma, rel=0.05)
    errors = [one.validation.x_c.figures("position")["mean"][1] for one in (wrong, good)]
    assert errors[0] < 1.2 * errors[1]


# The frames that joint centres define.


def test_frames_are_known_as_well_as_is_said() -> None:
    """Three studies: where the true joint centres would have put them."""
    for seed in range(3):
        study = simulate_study(seed=seed, runs=2, validation_runs=1, random_poses=2)
        found, truth = calibrate_study(study), study.truth
        assert truth is not None
        for frame, true, centres, drawn in (
            (found.record.camera_in_base, inverse(truth.camera), truth.robot.base, study.robot.base),
            (found.record.target_in_mobile, truth.target, truth.robot.mobile, study.robot.mobile),
        ):
            ideal = nearest_motion(transformed(inverse(true), centres), drawn)
            assert np.abs(frame.position - ideal.position).max() < 5 * max(frame.sigma[:3])


# Errors that all images share: counted in full in reading sets and frames, however often a pose is repeated.

SHARED = np.array([0.01, 0.02, 0.05, 2e-5, 3e-5, 1e-5])


@pytest.fixture(scope="module")
def shared(study: Study) -> Study:
    tables = (replace(t, shared=np.tile(SHARED, (len(t), 1))) for t in (study.calibration, study.validation))
    calibration, validation = tables
    return replace(study, calibration=calibration, validation=validation)


def test_the_shared_part_is_stated_and_not_divided_by_the_repeats(study: Study, shared: Study, tmp_path: Path) -> None:
    plain, counted = (calibrate_study(one, factor=2.0) for one in (study, shared))
    for before, after in ((plain.campaign, counted.campaign), (plain.check, counted.check)):
        widths, without = (
            np.concatenate([one.position_radius, one.rotation_radius], axis=1) for one in (after, before)
        )
        np.testing.assert_allclose(widths**2 - without**2, np.tile((2.0 * SHARED) ** 2, (len(after), 1)), rtol=1e-9)
        np.testing.assert_array_equal(after.length_radius, before.length_radius)
        assert "share are counted in full" in after.provenance["averaged"]
    np.testing.assert_array_equal(plain.x_c.parameters, counted.x_c.parameters)
    record, without_it = counted.record, plain.record
    save_record(record, tmp_path)
    assert load_record(tmp_path) == record
    assert record.repeats.shared is not None
    assert record.repeats.shared == pytest.approx(SHARED)
    rows, before_rows = ([*calibration(one)][1].tables[0].rows for one in (record, without_it))  # Table 3
    named = {row[0]: row[1:] for row in rows}
    assert named["shared by all images, beside it"][:3] == ("0.01", "0.02", "0.05")
    assert named["this study"] == before_rows[0][1:]
    assert "No repeat shows them" in record.repeats.shared_sentence
    for frame in ("camera_in_base", "target_in_mobile"):
        sigma, before = (getattr(one, frame).sigma for one in (record, without_it))
        added = np.sqrt(np.square(sigma) - np.square(before))
        assert (added[:3] >= 0.05 - 1e-9).all()
        assert added[3:] == pytest.approx(3e-5)


def test_files_keep_it_and_refuse_half_of_it(shared: Study, tmp_path: Path) -> None:
    save_study(shared, tmp_path / "study")
    assert load_study(tmp_path / "study") == shared
    path = tmp_path / "study" / "calibration.csv"
    text = path.read_text()
    rows = [line.rsplit(",", 1)[0] for line in text.splitlines()]
    for wrong, said in (
        (text.replace("shared_sz", "shared_sq", 1), "shared_sq"),
        ("\n".join(rows) + "\n", "'shared_srz' is missing"),
        (text.replace(",0.02,", ",-0.02,"), "shared deviation is negative"),
    ):
        path.write_text(wrong)
        with pytest.raises(InputError, match=said):
            load_study(tmp_path / "study")


# The uncertainty budget: what repeats cannot show is propagated, and simulated studies agree with it.


@pytest.mark.parametrize("values", [{"lens": -1.0}, {"lens": math.nan}])
def test_senseless_inputs_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(InputError, match="budget"):
        Inputs(**values)


# `calibration.json`: what calibrate_study found goes out and comes back; garbled files are refused.


def test_the_record_makes_a_round_trip_with_what_is_no_number(found: StudyCalibration, tmp_path: Path) -> None:
    record = found.record
    odd = replace(record.x_c, standard_errors=((math.inf,) * 7, *record.x_c.standard_errors[1:]))
    before, after = record.validation.x_c.position
    lost = replace(record.validation.x_c, position=(before, (math.nan, *after[1:])))
    path = save_record(replace(record, x_c=odd, validation=replace(record.validation, x_c=lost)), tmp_path / "new")
    again = load_record(path.parent)
    assert again.x_c == odd
    assert again.validation.x_c.failed == (lost.names[0],)
    first = path.read_bytes()
    assert save_record(again, path.parent).read_bytes() == first
    assert [p.name for p in path.parent.iterdir()] == ["calibration.json"]


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (("format",), "cpcal-calibration/9", "not of format"),
        (("robot",), 5, "robot is no text"),
        (("x_c", "values"), [[0.0] * 7], "a fit"),
        (("x_c", "values", 0, 0), "nan", "not finite"),
        (("x_c_sigma", "standard_errors", 0), [1.0], "a fit"),
        (("validation", "x_c", "names"), [], "validation"),
        (("drawing", 0), [], "drawing"),
    ],
)
def test_a_garbled_file_is_refused(found: StudyCalibration, tmp_path: Path, path, value, text) -> None:
    file = save_record(found.record, tmp_path)
    data = json.loads(file.read_text(encoding="utf-8"))
    part = data
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    file.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError, match=text):
        load_record(tmp_path)


def test_images_of_a_run_share_its_leg_readings() -> None:
    repeats = calibrate_study(
        simulate_study(seed=3, runs=4, validation_runs=2, random_poses=4, images=3)
    ).record.repeats
    assert not repeats.left_out
    assert repeats.channels[11].sigma == pytest.approx(0.019, rel=0.2)


def test_so_many_outliers_are_none() -> None:
    study = with_outliers(simulate_study(seed=3, runs=5, validation_runs=1, random_poses=2), 0.2, 1.0)
    screening = study_rows(study.calibration, study.robot).screening
    assert screening is not None
    assert screening.too_many
    assert screening.keep.all()
    assert "TOO MANY FOR OUTLIERS" in screening.sentence
