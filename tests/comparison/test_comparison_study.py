"""The whole way: an imperfection that was switched on in a study is found by comparing models of the legs."""

from __future__ import annotations

import cpcal
from cpcal.calibration import calibrate_study
from cpcal.robot import simulate_study


def test_a_sensor_gain_error_is_found_in_a_study() -> None:
    study = simulate_study(seed=1, runs=4, validation_runs=2, random_poses=8, gain=0.02)
    campaign = calibrate_study(study).campaign
    comparison = cpcal.compare(campaign, ["plain", "gain", "lateral"], legs=[1], tolerance=0.3)
    entries = {entry.model: entry for entry in comparison.entries}
    assert entries["plain"].verdict(0.3) is cpcal.Verdict.REFUTED
    assert entries["lateral"].verdict(0.3) is cpcal.Verdict.REFUTED
    assert entries["gain"].eps_hi == 0.0  # the readings and a gain explain everything
    assert study.truth is not None
    assert abs(entries["gain"].enclosure["s"].mid) > 0.01
