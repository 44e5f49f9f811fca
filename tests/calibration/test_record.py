"""`calibration.json`: what calibrate_study found goes out and comes back; garbled files are refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cpcal import InputError
from cpcal.calibration import CalibrationRecord, StudyCalibration, calibrate_study, load_record, recorded, save_record
from cpcal.files import campaign_sha256
from cpcal.robot import Study
from cpcal.simulate import simulate_study


@pytest.fixture(scope="module")
def study() -> Study:
    return simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=1.0)


@pytest.fixture(scope="module")
def found(study: Study) -> StudyCalibration:
    return calibrate_study(study)


@pytest.fixture(scope="module")
def record(study: Study, found: StudyCalibration) -> CalibrationRecord:
    return recorded(study, found, factor=3.0)


def test_it_holds_what_was_found(found, record, study):
    assert np.array_equal(record.x_c.array, found.x_c.parameters)
    assert record.campaign_sha256 == campaign_sha256(found.campaign)
    assert record.validation.validation.summary_after == found.validation.summary_after
    assert [c.unit for c in record.channels] == ["mm"] * 3 + ["rad"] * 3 + ["mm"] * 6
    assert all(sum(c.histogram.counts) == len(study.calibration) for c in record.channels)
    assert any("THE NOISE DOES NOT EXPLAIN" in sentence for sentence in record.sentences)


def test_parameters_can_be_had_in_the_drawings_frames(found, record):
    apart = np.array(record.drawing) - record.in_drawing(record.x_c_sigma)
    residuals = (found.base_frame.residual, found.mobile_frame.residual)
    assert np.abs(apart[:, :6] - np.concatenate(residuals, axis=1)).max() < 1e-9
    assert np.abs(apart[:, :6]).max() < 10.0


def test_round_trip(record, tmp_path):
    path = save_record(record, tmp_path / "new")
    assert load_record(tmp_path / "new") == record
    first = path.read_bytes()
    assert save_record(load_record(path.parent), path.parent).read_bytes() == first
    assert [p.name for p in path.parent.iterdir()] == ["calibration.json"]


def test_what_is_no_number_survives(record, tmp_path):
    odd = replace(record.x_c, standard_errors=((math.inf,) * 7, *record.x_c.standard_errors[1:]))
    errors = replace(record.validation, position_after=(math.nan, *record.validation.position_after[1:]))
    save_record(replace(record, x_c=odd, validation=errors), tmp_path)
    again = load_record(tmp_path)
    assert again.x_c == odd
    assert again.validation.validation.failed == (errors.names[0],)


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (("format",), "cpcal-calibration/9", "not of format"),
        (("robot",), 5, "robot is no text"),
        (("factor",), True, "factor is no number"),
        (("readings",), 1.5, "readings is no whole number"),
        (("x_c", "values"), [[0.0] * 7], "a fit"),
        (("x_c", "values", 0, 0), "nan", "not finite"),
        (("x_c_sigma", "standard_errors", 0), [1.0], "a fit"),
        (("x_c",), [], "no object"),
        (("channels",), 5, "no list"),
        (("channels", 0, "statistics"), {}, "lacks"),
        (("validation", "names"), [], "validation"),
        (("drawing", 0), [], "drawing"),
    ],
)
def test_a_garbled_file_is_refused(record, tmp_path, path, value, text):
    file = save_record(record, tmp_path)
    data = json.loads(file.read_text(encoding="utf-8"))
    part = data
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    file.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError, match=text):
        load_record(tmp_path)


def test_no_file_and_no_json(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        load_record(tmp_path)
    (tmp_path / "calibration.json").write_text("{")
    with pytest.raises(InputError, match="is not JSON"):
        load_record(tmp_path)
