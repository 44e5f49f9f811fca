"""A mechanism is named only where its own model explains the readings and the others do not."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cpcal.calibration import LegEquations, calibrate_study
from cpcal.calibration.diagnosis import Asked, corrected, sag_shape, vertical
from cpcal.simulate import simulate_study
from cpcal.simulate.studies import mechanisms_of
from tests.changed import with_drift

SIZE = {"runs": 4, "validation_runs": 2, "random_poses": 16}


def found_of(**imperfect):
    return calibrate_study(simulate_study(seed=2, **SIZE, **imperfect))


@pytest.mark.parametrize(
    ("imperfect", "named", "unexplained"),
    [
        ({}, (), False),
        ({"sag": 2.0}, ("sag",), False),
        ({"gain": 0.002}, ("gain",), False),
        ({"backlash": 0.4}, ("play",), True),
        ({"axis_offset": 3.0}, (), True),
        ({"joint_error": 0.5}, (), True),
    ],
)
def test_what_was_put_in_is_named_or_none_of_the_models(imperfect, named, unexplained):
    found = found_of(**imperfect).record.diagnosis
    if imperfect == {"sag": 2.0}:
        sag = next(model for model in found.models if model.name == "sag")
        assert sag.values == pytest.approx([2.0] * 6, rel=0.02)
        assert "SAG: the legs shorten by their weight" in found.sentence
    assert (found.named, found.unexplained) == (named, unexplained)
    assert ("NONE OF THESE" in found.sentence) == unexplained
    assert ("No imperfection" in found.sentence) == (not imperfect)


def test_a_drifting_sensor_is_named():
    found = calibrate_study(with_drift(simulate_study(seed=2, **SIZE), 0.2)).record.diagnosis
    assert found.named == ("drift",)
    assert "DRIFT" in found.sentence


def test_a_scale_that_all_legs_share_may_be_the_cameras():
    study = simulate_study(seed=2, **SIZE)
    tables = (replace(table, position=1.002 * table.position) for table in (study.calibration, study.validation))
    found = calibrate_study(
        replace(study, **dict(zip(("calibration", "validation"), tables, strict=True)))
    ).record.diagnosis
    assert found.named == ("gain",)
    assert "single camera cannot tell" in found.sentence


def test_what_cannot_be_negative_explains_nothing_where_it_is():
    asked = Asked("lateral", (-100.0,), (5.0,), (0.1,), 0.5)
    assert not asked.explains
    assert Asked("gain", (-100.0,), (5.0,), (0.1,), 0.5).explains


def test_a_correction_is_found_with_its_standard_error():
    found = found_of(gain=0.001)
    noise = found.repeats.noise(np.full(64, 4))
    given = LegEquations.of(found.campaign), noise, vertical(found.campaign)
    gain = corrected(*given, found.x_c_sigma.parameters, "gain")
    truth = mechanisms_of(json.loads(simulate_study(seed=2, **SIZE, gain=0.001).provenance["options"])).gain
    errors = np.array(gain.errors)
    assert (np.abs(-np.array(gain.values) - truth) < 4.0 * errors).all()  # what the sensors add is to be taken away
    assert (errors < 1e-4).all()


def test_a_flat_leg_of_mid_range_length_has_all_of_its_sag():
    up = np.array([0.0, 0.0, 1.0])
    assert sag_shape(np.array([400.0, 0.0, 0.0]), np.array(400.0), 400.0, up) == pytest.approx(1.0)
    assert sag_shape(np.array([0.0, 0.0, 400.0]), np.array(400.0), 400.0, up) == pytest.approx(0.0)
    assert sag_shape(np.array([400.0, 0.0, 0.0]), np.array(440.0), 400.0, up) == pytest.approx(1.1**7)
