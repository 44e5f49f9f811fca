"""`cpcal demo`: the whole study, here a small one and one leg of it."""

import shutil

import pytest

import cpcal
from cpcal.cli.study import DemoPlan
from cpcal.cli.verify import checked_certificates
from cpcal.files import campaign_sha256, load_study
from cpcal.questions import load_record
from cpcal.questions.points import fits_of
from tests.cli.command import done, refused, run

SMALL = DemoPlan(size={"runs": 3, "validation_runs": 2, "random_poses": 5}, legs=(6,), timeout_seconds=1.0)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "demo"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cpcal.cli.study.PLAN", SMALL)
        outcome = run("demo", "-o", folder, "--seed", 3)
    return folder, outcome


def test_it_goes_the_whole_way(demo):
    folder, outcome = demo
    assert outcome.exit_code == 0, outcome.stderr
    names = ["calibration.json", "campaign", "fits", "report.html", "run", "study", "timeout", "validation"]
    assert sorted(p.name for p in folder.iterdir()) == names
    campaign, record = cpcal.load_campaign(folder / "campaign"), load_record(folder)
    result, timeout = cpcal.load_result(folder / "run"), cpcal.load_result(folder / "timeout")
    assert load_study(folder / "study").truth.seed == 3
    hashes = {record.campaign_sha256, result.campaign.sha256, timeout.campaign.sha256}
    assert hashes == {campaign_sha256(campaign)}
    assert (result.options.method, timeout.options.method) == ("bound", "timeout")
    assert not campaign.exact


def test_the_model_is_refuted_and_both_methods_agree(demo):
    folder, outcome = demo
    leg, timed = cpcal.load_result(folder / "run").legs[0], cpcal.load_result(folder / "timeout").legs[0]
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    assert leg.bracket.lo > 0.0
    assert timed.bracket.lo <= leg.bracket.hi
    assert leg.bracket.lo <= timed.bracket.hi
    campaign, accepted = cpcal.load_campaign(folder / "campaign"), checked_certificates(folder / "fits")
    for verified in fits_of(folder / "fits", campaign, [6], accepted).values():
        assert verified[0].verified.verdict is cpcal.Verdict.REFUTED
    written = sum(len(list((folder / part).glob("*.cert.jsonl"))) for part in ("fits", "run"))
    for text in (
        "the stated reading uncertainty? Refuted for leg 6.",
        "The paper's timeout method",
        f"accepted all {written} certificates",
        "report.html",
        "Where this differs from the paper: ",
        "Tolerance: 1 mm",
    ):
        assert text in outcome.stdout
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert written >= 4
    for text in ("Table 7", f"accepted all {written} certificates", "bound: none below", "24.01"):
        assert text in page


def test_report_writes_the_same_page_again(demo, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(demo[0], folder)
    page = folder / "report.html"
    first = page.read_bytes()
    page.unlink()
    done("report", folder)
    assert page.read_bytes() == first
    next((folder / "fits").glob("x_c.leg*")).unlink()
    assert "it is missing" in refused("report", folder)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("run/result.json", '"hi": ', '"hi": 1'),
        ("fits/x_c.leg6.cert.jsonl", '"fails":[', '"fails":[["upper",0],["upper",0],'),
    ],
)
def test_no_page_is_made_of_a_study_that_was_touched(demo, tmp_path, file, old, new):
    copy = tmp_path / "demo"
    shutil.copytree(demo[0], copy)
    text = (copy / file).read_text(encoding="utf-8")
    assert old in text
    (copy / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    outcome = run("report", copy, "-o", tmp_path / "page.html")
    assert outcome.exit_code in (1, 2), outcome.output
    assert not (tmp_path / "page.html").exists()
