"""The page of a whole study: the paper's tables and figures in its numbering, then the legs as in any other page."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.calibration import CalibrationRecord
from cpcal.calibration.record import Channel, Errors
from cpcal.certify.fits import CertifiedFits
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import about, bracket_text, nearest, rounded_up, stated
from cpcal.files import campaign_sha256
from cpcal.report import paper, study_tables
from cpcal.report.images import ImagesFound
from cpcal.report.page import render
from cpcal.report.study_figures import histogram_svg, validation_svg
from cpcal.report.study_tables import SYMBOLS, TextTable
from cpcal.results import Result
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict

_FRAME = study_tables.CENTROID  # that of the paper's tables 4 and 5


@dataclass(frozen=True)
class StudyFound:
    """Everything that a study led to, all of the same campaign.

    result   brackets by branch and bound; timeout  those by the paper's timeout method, with a time limit
    checked  a sentence on what the checker made of the certificates
    images   where the poses came from images
    """

    campaign: Campaign
    record: CalibrationRecord
    fits: CertifiedFits
    result: Result
    timeout: Result
    checked: str
    images: ImagesFound | None = None


def write_study_page(
    found: StudyFound, file: str | os.PathLike[str], *, run: str | os.PathLike[str] | None = None
) -> Path:
    """Write the page to `file`, all or nothing; its path. Raises InputError: parts of different campaigns, too."""
    return write_file(file, render_study(found, run))


def render_study(found: StudyFound, run: str | os.PathLike[str] | None = None) -> str:
    """The page as text; the same parts give the same text. `run`: the folder whose certificates the page checks."""
    expected, remedy = campaign_sha256(found.campaign), "give the parts of one study"
    for name, sha256 in (
        ("calibration record", found.record.campaign_sha256),
        ("certified fits", found.fits.campaign_sha256),
        ("result of the timeout method", found.timeout.campaign_sha256),
    ):
        if sha256 != expected:
            raise InputError([Problem(name, "is of another campaign", remedy)])
    for name, fits in found.fits.both:
        if any(fit.point != tuple(getattr(found.record, name).values[fit.leg - 1]) for fit in fits):
            raise InputError([Problem("certified fits", f"{name} is not the calibration record's", remedy)])
    return render(found.campaign, found.result, _context(found), run=run)


def _context(found: StudyFound) -> dict[str, Any]:
    record = found.record
    lengths = [c for c in record.channels if c.statistics.name.startswith("L")]
    poses = [c for c in record.channels if not c.statistics.name.startswith("L")]
    six = len(record.drawing) == len(paper.TABLE_4)
    return {
        "record": record,
        "checked": found.checked,
        "table1": study_tables.drawing(record),
        "table2": study_tables.leg_lengths(record),
        "table3": study_tables.poses(record),
        "table4": study_tables.parameters(record, record.x_c, _FRAME, paper.TABLE_4 if six else None),
        "table5": study_tables.parameters(record, record.x_c_sigma, _FRAME, paper.TABLE_5 if six else None),
        "equations": study_tables.equations(record),
        "table6": study_tables.validation(record, paper_too=True),
        "standards": study_tables.standards(record),
        "table7": _table7(found),
        "fits_table": _fits_table(found.fits),
        "fits": [_fit_sentence(name, [fit.verified.verdict for fit in fits]) for name, fits in found.fits.both],
        "figure3": [_histogram(channel) for channel in lengths],
        "figure4": [_histogram(channel) for channel in poses],
        "figure5": [_validation("x_c", record.validation), _validation("x_c_sigma", record.validation_sigma)],
        "apart": _apart(record),
        "errors": about(
            max(2.0 * max(row) for fit in (record.x_c, record.x_c_sigma) for row in fit.standard_errors), 2
        ),
        "loose": _loose(found.result),
        "exact": _exact_sentence(found.result),
        "images": found.images,
        "timeout_seconds": stated(found.timeout.options.time_limit or 0.0),
        "factor": stated(record.factor),
        "delta": stated(found.result.options.delta),
    }


def _histogram(channel: Channel) -> dict[str, Any]:
    name = channel.statistics.name
    svg = histogram_svg(channel, label=f"Centred errors of {name}: histogram")
    return {"svg": Markup(svg), "sentence": channel.statistics.sentence()}  # names of channels are ours


def _validation(name: str, errors: Errors) -> dict[str, Any]:
    found = errors.validation
    label = f"Errors and improvements of the validation poses with {name}"
    svg = validation_svg(found, label=label)
    return {"name": name, "svg": Markup(svg), "sentence": found.sentence}


def _table7(found: StudyFound) -> TextTable:
    """Both methods' brackets, lower ends rounded down and upper ends up, beside the paper's; a column a leg, mm."""
    legs = [leg.leg for leg in found.result.legs]
    timed = {leg.leg: leg for leg in found.timeout.legs}
    bounds = [bracket_text(leg.eps_lo, leg.eps_hi) for leg in found.result.legs]
    tried = [bracket_text(timed[leg].eps_lo, timed[leg].eps_hi) if leg in timed else ("—", "—") for leg in legs]
    rows = [
        ("bound: none below", *(lo for lo, _ in bounds)),
        ("bound: attained", *(hi for _, hi in bounds)),
        ("timeout: none below", *(lo for lo, _ in tried)),
        ("timeout: attained", *(hi for _, hi in tried)),
    ]
    if max(legs, default=0) <= len(paper.TABLE_7_CERTIFIED):
        rows.append(("the paper: none below", *(nearest(paper.TABLE_7_CERTIFIED[leg - 1], 2) for leg in legs)))
        rows.append(("the paper: attained", *(nearest(paper.TABLE_7_ATTAINED[leg - 1], 2) for leg in legs)))
    return TextTable(("leg", *map(str, legs)), tuple(rows))


def _fits_table(fits: CertifiedFits) -> TextTable:
    rows = []
    for name, verified in fits.both:
        rows.append((f"{name}: satisfied", *(str(fit.verified.holds) for fit in verified)))
        rows.append((f"{name}: refuting", *(str(fit.verified.fails) for fit in verified)))
    return TextTable(("leg", *(str(fit.leg) for fit in fits.x_c)), tuple(rows))


def _fit_sentence(name: str, verdicts: list[Verdict]) -> str:
    refuted = sum(verdict is Verdict.REFUTED for verdict in verdicts)
    proved = sum(verdict is Verdict.PROVED for verdict in verdicts)
    legs = f"of {len(verdicts)} legs"
    if refuted == len(verdicts):
        return f"{name} is no solution for any leg verified: refuted by measurements, with proof."
    return f"{name} is a solution for {proved} {legs} and refuted for {refuted}; of the others nothing is proved."


def _apart(record: CalibrationRecord) -> dict[str, Any]:
    """Where x_c and x_c_sigma differ most, mm, in the frames of the tables and in the same ones for both."""
    own = [study_tables.in_frame(record, fit, _FRAME)[0] for fit in (record.x_c, record.x_c_sigma)]
    difference = np.abs(np.array(own[0]) - np.array(own[1]))
    same = np.abs(record.in_drawing(record.x_c) - record.in_drawing(record.x_c_sigma))
    leg, k = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return {
        "mm": about(float(difference[leg, k]), 2),
        "name": SYMBOLS[int(k)],
        "leg": int(leg) + 1,
        "same": about(float(same.max()), 2),
    }


def _loose(result: Result) -> dict[str, Any] | None:
    """The widest proved bounds among the polygons' boxes: how far parameters may move for a little more eps."""
    boxes = [(leg.leg, leg.projections) for leg in result.legs if leg.projections is not None]
    if not boxes:
        return None
    leg, projections = max(boxes, key=lambda pair: float(np.max(pair[1].box.width)))
    k = int(np.argmax(projections.box.width))
    width = float(projections.box.width[k])
    eps = bracket_text(projections.eps, projections.eps)[0]
    return {"leg": leg, "name": SYMBOLS[k], "mm": rounded_up(width, 1), "eps": eps}


def _exact_sentence(result: Result) -> str:
    """The paper's second question: has any x in the box no model error at all?"""
    none = [str(leg.leg) for leg in result.legs if leg.eps_lo > 0.0]
    some = [str(leg.leg) for leg in result.legs if leg.not_refuted]
    rest = [str(leg.leg) for leg in result.legs if not leg.not_refuted and leg.eps_lo <= 0.0]
    said, delta = [], stated(result.options.delta)
    if none:
        said.append(f"proved: no parameters within ±{delta} mm satisfy all equations exactly (leg {', '.join(none)})")
    if some:
        said.append(f"proved: some parameters do (leg {', '.join(some)})")
    if rest:
        said.append(f"not known (leg {', '.join(rest)})")
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}." if text else "No leg was finished."
