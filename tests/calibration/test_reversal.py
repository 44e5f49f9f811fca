"""Reversal values (ISO 230-2): what was put in comes out, by leg; chance is not called play."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal import InputError
from cpcal.calibration import as_campaign, calibrate_study, describe, repeat_tests, repeatability
from cpcal.calibration.repeat_tests import REVERSAL, RUNS
from cpcal.calibration.reversal import reversals
from cpcal.files import load_study, save_study
from cpcal.robot import NEGATIVE, POSITIVE, PoseTable
from cpcal.simulate import simulate_study
from cpcal.simulate.disturbances import with_reversal
from tests.changed import of_poses

SIZE = 0.02  # mm: half of what the equations scatter by


@pytest.fixture(scope="module")
def studies():
    perfect = simulate_study(seed=2, runs=6, validation_runs=2, random_poses=8)
    return with_reversal(perfect, 0.0), with_reversal(perfect, SIZE)


def test_the_mean_reversal_of_each_leg_is_what_was_put_in_within_its_uncertainty(studies):
    for study, true in zip(studies, (0.0, SIZE), strict=True):
        found = repeatability(as_campaign(study.calibration, study.robot))
        for one in reversals(found, study.calibration.approach):
            assert one.targets == 64
            assert abs(one.mean - true) < 3.0 * one.error
            assert one.largest >= abs(one.mean)
            assert one.both >= max(one.forward, one.backward)
            assert one.both >= one.largest


def test_a_reversal_is_called_play_and_no_drift(studies):
    for study, expected in zip(studies, ((), ("play",)), strict=True):
        found = calibrate_study(study)
        assert found.diagnosis.named == expected
        assert bool(found.tests.found(REVERSAL)) == bool(expected)
        assert not found.tests.found(RUNS)


def test_by_hand():
    """Two targets, four runs each: B, R and the mean of ISO 230-2 as anybody computes them."""
    study = with_reversal(simulate_study(seed=1, runs=4, validation_runs=1, random_poses=1), 0.5)
    table = of_poses(study, ("e00", "e01")).calibration
    found = repeatability(as_campaign(table, study.robot))
    (one, *_), g = reversals(found, table.approach), found.equations[:, 0]
    forward = np.array([side == POSITIVE for side in table.approach])
    b, r = [], []
    for pose in ("e00", "e01"):
        here = np.array([name == pose for name in table.pose])
        plus, minus = g[here & forward], g[here & ~forward]
        b.append(plus.mean() - minus.mean())
        s = plus.std(ddof=1), minus.std(ddof=1)
        r.append(max(2 * s[0] + 2 * s[1] + abs(b[-1]), 4 * s[0], 4 * s[1]))
    assert (one.mean, one.largest, one.both) == pytest.approx((np.mean(b), np.max(np.abs(b)), max(r)))


def test_runs_without_directions_have_no_reversal_and_the_tests_are_as_before(studies):
    study = studies[0]
    found = repeatability(as_campaign(study.calibration, study.robot))
    assert reversals(found, None) == ()
    assert reversals(found, [POSITIVE] * len(study.calibration)) == ()
    plain, _ = repeat_tests(found, study.calibration.run, describe(found.spread))
    assert REVERSAL not in {test.kind for test in plain.tests}


def test_the_direction_survives_the_file_and_other_words_are_refused_with_their_line(studies, tmp_path):
    save_study(studies[1], tmp_path)
    assert load_study(tmp_path) == studies[1]
    path = tmp_path / "calibration.csv"
    path.write_text(path.read_text().replace(NEGATIVE, "left", 1))
    with pytest.raises(InputError) as caught:
        load_study(tmp_path)
    (problem,) = caught.value.problems
    assert (problem.line, problem.remedy) == (3, "write positive or negative")


def test_images_of_a_run_come_from_one_side():
    one = np.array([[0.0, 0.0, 500.0]] * 2), np.array([[1.0, 0.0, 0.0, 0.0]] * 2), np.zeros((2, 6))
    with pytest.raises(InputError, match="another image of the run"):
        PoseTable(("a", "a"), ("1", "1"), *one, image=("1", "2"), approach=(POSITIVE, NEGATIVE))
