"""The page of a whole study: every table and figure, the paper's values beside ours, nothing hostile."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from tinyhtml5.parser import HTMLParser

import cpcal
from cpcal.files import campaign_sha256
from cpcal.questions import CampaignNote
from cpcal.report import study_page
from cpcal.report.study_page import render_study

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&\x1b[31m"


def parsed(page):
    parser = HTMLParser()
    parser.parse(page)
    assert parser.errors == []
    return page


@pytest.fixture(scope="module")
def page(study_page):
    return study_page.read_text(encoding="utf-8")


def test_every_table_and_figure_has_its_heading_and_the_papers_values(study, page):
    for k in range(1, 8):
        assert page.count(f"<h3>Table {k}: ") == 1
    for text in ("<h3>Figure 5: ", "Section 5.1.2"):
        assert text in page
    for value in (*study_page.TABLE_7_CERTIFIED, *study_page.TABLE_7_ATTAINED):
        assert f"<td>{value:.2f}</td>" in page
    assert page.count("Errors of the validation poses with ") == 2
    assert study.checked.split("(")[0] in page
    assert "#0102" not in page
    boxes = np.array([[leg.ranges.box.lo, leg.ranges.box.hi] for leg in study.result.legs])
    true = study.truth.parameters
    held = int(np.sum((boxes[:, 0] <= true) & (true <= boxes[:, 1])))
    of_u = np.abs(np.array(study.record.x_c.values) - true) <= 2.0 * np.array(study.record.x_c.standard_errors)
    assert f"True parameters: {held} of 42 inside proved ranges; {of_u.sum()} of 42 inside x_c ± U" in page
    assert "x_c minimises g (mm) instead of f" in page
    assert "<title>Simulated: DeltaLab" in page


def test_table_7_rounds_to_the_proved_side(page):
    assert "<td>0.08901174</td>" in page  # of 0.0890117468
    assert "<td>0.08901176</td>" in page  # of 0.0890117515
    assert "<td>∞</td>" in page  # the timeout method found no point for a leg


def test_verdicts_are_told_as_they_are(page):
    assert "Is x_c a solution, within the stated reading uncertainty? Refuted for leg 1, 2, 3, 4, 5, 6." in page
    assert "Is x_c_sigma a solution, within the stated reading uncertainty? Proved for leg 6; refuted for leg 1" in page
    assert (
        "no parameters within ±100 mm satisfy all equations within the stated reading uncertainty (leg 1, 2, 3, 4, 5)"
        in page
    )
    assert "some parameters do (leg 6)" in page


def test_hostile_names_do_nothing(study):
    robot = dataclasses.replace(study.campaign.robot, name=HOSTILE[:-5])
    campaign = dataclasses.replace(study.campaign, robot=robot, provenance={HOSTILE[:-5]: HOSTILE[:-5] + "}}{% raw %}"})
    sha = {"campaign_sha256": campaign_sha256(campaign)}
    errors = study.record.validation.x_c
    names = tuple(HOSTILE + str(k) for k in range(len(errors.names)))
    before, after = errors.position
    lost = dataclasses.replace(errors, names=names, position=(before, (math.nan, *after[1:])))
    record = dataclasses.replace(
        study.record,
        robot=HOSTILE,
        repeats=dataclasses.replace(study.record.repeats, screening=HOSTILE),
        validation=dataclasses.replace(study.record.validation, x_c=lost),
        **sha,
    )
    note = CampaignNote(campaign_sha256(campaign), HOSTILE, len(campaign))
    result, timeout = (dataclasses.replace(one, campaign=note) for one in (study.result, study.timeout))
    hostile = study._replace(campaign=campaign, record=record, result=result, timeout=timeout, checked=HOSTILE)
    page = parsed(render_study(hostile))
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;script&gt;" in page
    assert "\x1b" not in page


@pytest.mark.parametrize("part", ["record", "timeout", "result"])
def test_parts_of_another_study_are_refused(study, part):
    found = getattr(study, part)
    sha256: dict[str, Any] = {"campaign_sha256": "0" * 64}
    if part in ("timeout", "result"):
        sha256 = {"campaign": CampaignNote("0" * 64, "R", 64)}
    other = dataclasses.replace(found, **sha256)
    with pytest.raises(cpcal.InputError, match="another campaign"):
        render_study(study._replace(**{part: other}))
