"""x_c and x_c_sigma as solutions: what is known of them is what their certificates prove."""

import shutil

import pytest

import cpcal
from cpcal.cli.verify import checked_certificates
from cpcal.questions import calibrate_study
from cpcal.questions.points import certify_fits, fits_of
from cpcal.simulate import simulate_study


@pytest.fixture(scope="module")
def found():
    return calibrate_study(simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0))


@pytest.fixture(scope="module")
def folder(found, tmp_path_factory):
    return tmp_path_factory.mktemp("fits") / "fits"


@pytest.fixture(scope="module")
def fits(found, folder):
    return certify_fits(found.campaign, found.record, folder, legs=[5, 2])


def test_both_fits_are_verified_with_certificates(found, fits, folder):
    accepted = checked_certificates(folder)
    assert fits_of(folder, found.campaign, [2, 5], accepted) == fits
    assert sorted(accepted) == [f"{name}.leg{leg}.cert.jsonl" for name in ("x_c", "x_c_sigma") for leg in (2, 5)]
    for verified, fit in ((fits["x_c"], found.x_c), (fits["x_c_sigma"], found.x_c_sigma)):
        assert [leg.leg for leg in verified] == [2, 5]
        for leg in verified:
            alone = cpcal.certify_point(found.campaign, leg.leg, fit.parameters[leg.leg - 1])
            assert (leg.verified, leg.point) == (alone.verified, alone.point)
            assert leg.verified.verdict is cpcal.Verdict.REFUTED


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda run: (run / "x_c.leg2.cert.jsonl").unlink(), "it is missing"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg1.cert.jsonl"), "is called so"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg5.cert.jsonl"), "is called so"),
        (lambda run: (run / "x_c.leg2.cert.jsonl").write_text(""), "it is empty"),
        (lambda run: [path.unlink() for path in run.glob("*.jsonl")], "it is missing"),
    ],
)
def test_a_folder_that_was_touched_is_refused(found, fits, folder, tmp_path, change, reason):
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    change(run)
    with pytest.raises(cpcal.InputError, match=reason):
        fits_of(run, found.campaign, [2, 5], checked_certificates(run))


def test_a_point_of_another_model_or_of_some_measurements_is_no_fit(found, fits, folder, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    at = [*fits["x_c"][0].point, 0.0]
    path = run / "x_c.leg2.cert.jsonl"
    cpcal.certify_point(found.campaign, 2, at, model="gain", certificate=path)
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(run, found.campaign, [2, 5], checked_certificates(run))


def test_another_campaign_is_refused(found, fits, folder, tmp_path):
    other = cpcal.simulate(seed=2)
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(folder, other, [2, 5], checked_certificates(folder))
    with pytest.raises(cpcal.InputError, match="another campaign"):
        certify_fits(other, found.record, tmp_path)
