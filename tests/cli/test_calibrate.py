"""`cpcal calibrate`: what it writes, prints and refuses."""

import pytest

import cpcal
from cpcal.files import campaign_sha256, save_study
from cpcal.questions import calibrate_study, load_record
from cpcal.simulate import simulate_study
from tests.cli.command import done, refused


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibrate") / "study"
    save_study(simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=1.0), folder)
    return folder


def test_it_writes_campaigns_and_record_and_prints_tables(study, tmp_path):
    said = done("calibrate", study, "-o", tmp_path / "c", "--factor", 2, "-v")
    assert sorted(p.name for p in (tmp_path / "c").iterdir()) == ["calibration.json", "campaign", "validation"]
    campaign, record = cpcal.load_campaign(tmp_path / "c" / "campaign"), load_record(tmp_path / "c")
    assert record.campaign_sha256 == campaign_sha256(campaign)
    assert record.factor == 2.0
    expected = calibrate_study(cpcal.files.load_study(study), factor=2.0)
    assert campaign_sha256(campaign) == campaign_sha256(expected.campaign)
    for text in (
        "Table 2: standard deviation",
        "x_c_sigma",
        "orientation, mean [°]",
        "DOES NOT EXPLAIN",
        "Table 6: errors of the validation poses",
    ):
        assert text in said
    done("calibrate", study, "-o", tmp_path / "c")
    assert load_record(tmp_path / "c").factor == 3.0


def test_without_verbose_it_ends_with_twelve_lines_that_hold_the_doubts(tmp_path):
    rough = simulate_study(seed=3, runs=4, validation_runs=2, random_poses=5, sag=1.0, backlash=0.4)
    save_study(rough, tmp_path / "study")
    said = done("calibrate", tmp_path / "study", "-o", tmp_path / "c", "--lens", "0.01")
    lines = said.splitlines()
    assert len(lines) <= 12
    record = load_record(tmp_path / "c")
    doubts = [sentence for says_no, sentence in record.repeats.tests if says_no]
    assert doubts
    for sentence in (*doubts, record.budget.sentence):
        assert sentence in lines
    assert "U (k = 2)" in said


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(["--factor", "0"], "--factor"), (["--factor", "nan"], "--factor"), (["--lens", "-1"], "lens")],
)
def test_senseless_options_are_refused(study, tmp_path, arguments, text):
    assert text in refused("calibrate", study, "-o", tmp_path / "c", *arguments)
    assert not (tmp_path / "c" / "campaign").exists()
    assert "does not exist" in refused("calibrate", tmp_path / "absent", "-o", tmp_path / "c")


def test_a_budget_is_printed_with_what_was_stated_and_kept_in_the_record(study, tmp_path):
    stated = ("--camera-scale", "1e-4", "--lens", "0.01", "--sensor-scale", "1e-5", "--temperature", "2")
    said = done("calibrate", study, "-o", tmp_path, *stated, "-v")
    for text in ("Uncertainty budget (GUM)", "camera scale", "U (k = 2)", "nothing was stated: target_scale"):
        assert text in said
    record = load_record(tmp_path)
    assert record.budget is not None
    assert (record.budget.inputs.camera_scale, record.budget.inputs.temperature) == (1e-4, 2.0)
    assert max(max(row) for row in record.budget.expanded) == pytest.approx(2.0 * record.budget.largest)
