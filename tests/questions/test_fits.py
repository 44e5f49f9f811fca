"""x_c and x_c_sigma as solutions: what is verified is written and read again."""

import json

import pytest

import cpcal
from cpcal.calibration import calibrate_study
from cpcal.checker import check
from cpcal.questions.fits import certify_fits, load_fits
from cpcal.simulate import simulate_study


@pytest.fixture(scope="module")
def found():
    return calibrate_study(simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0))


def test_both_fits_are_verified_with_certificates(found, tmp_path):
    fits = certify_fits(found.campaign, found.record, tmp_path / "fits", legs=[2, 5])
    assert load_fits(tmp_path / "fits") == fits
    cpcal.save_campaign(found.campaign, tmp_path / "campaign")
    for (name, verified), fit in zip(fits.both, (found.x_c, found.x_c_sigma), strict=True):
        assert [leg.leg for leg in verified] == [2, 5]
        for leg in verified:
            assert leg.certificate == f"{name}.leg{leg.leg}.cert.jsonl"
            alone = cpcal.certify_point(found.campaign, leg.leg, fit.parameters[leg.leg - 1])
            assert (leg.verified, leg.point) == (alone.verified, alone.point)
            assert leg.verified.verdict is cpcal.Verdict.REFUTED
            point = check(tmp_path / "fits" / leg.certificate).claims.point
            assert (len(point.holds), len(point.fails)) == (leg.verified.holds, leg.verified.fails)


def test_another_campaign_is_refused(found, tmp_path):
    with pytest.raises(cpcal.InputError, match="another campaign"):
        certify_fits(cpcal.simulate(seed=2), found.record, tmp_path)


@pytest.mark.parametrize("data", [[], {}, {"format": "cpcal-fits/2"}, {"format": "cpcal-fits/3"}])
def test_a_garbled_file_is_refused(tmp_path, data):
    (tmp_path / "fits.json").write_text(json.dumps(data))
    with pytest.raises(cpcal.InputError, match=r"is not JSON|is not of format|lacks"):
        load_fits(tmp_path)
