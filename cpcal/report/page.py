"""One self-contained HTML page from a campaign and its result: no network, light and dark; it checks itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from markupsafe import Markup

from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, PluginError
from cpcal.common.numbers import stated
from cpcal.files.run_folder import REPORT_NAME
from cpcal.legs import PLAIN, LegModel
from cpcal.report import drawing_frames
from cpcal.report.assumptions import assumptions
from cpcal.report.drawing_frames import DrawingFrames
from cpcal.report.embedded import embedded
from cpcal.report.leg_section import leg_section
from cpcal.report.match import check_match
from cpcal.report.origin import command, versions
from cpcal.report.overview import errors_svg, forcing_numbers, platform_svg
from cpcal.report.result_table import result_table
from cpcal.report.template import rendered
from cpcal.report.words import FRAME, LONGER, QUANTIFIER, notices, overall, summary
from cpcal.results import INFORMATION, Result, model_of
from cpcal.robot import Campaign
from cpcal.robot.suspicions import suspicions

_HEAD = ("date", "operator", "serial")  # of the campaign's provenance, shown at the top of the page


def write_report(
    campaign: Campaign,
    result: Result,
    folder: str | os.PathLike[str],
    model: LegModel | None = None,
    *,
    checker: bool = True,
) -> Path:
    """`write_page` to `report.html` in `folder`, made if missing; its path.

    `checker`: the page checks the certificates of the run that lie in the folder.
    """
    return write_page(campaign, result, Path(folder) / REPORT_NAME, model, run=folder if checker else None)


def write_page(
    campaign: Campaign,
    result: Result,
    file: str | os.PathLike[str],
    model: LegModel | None = None,
    *,
    run: str | os.PathLike[str] | None = None,
) -> Path:
    """Write the page to `file`, all or nothing, in a folder that is made if missing; its path.

    The same campaign and result give the same bytes. Bounds are printed rounded to the side on which they
    stay proved; every answer is for SOME reading in the set of each measurement. Raises InputError when the
    result is of another campaign, or when the file cannot be written. `model`: the result's leg model, where no
    installed package provides it; without it the page says which figures it lacks. `run`: the folder of the run,
    whose certificates the page then holds and checks in the browser; without certificates there it has no checker.
    """
    return write_file(file, render(campaign, result, model=model, run=run))


def render(
    campaign: Campaign,
    result: Result,
    study: dict[str, Any] | None = None,
    model: LegModel | None = None,
    run: str | os.PathLike[str] | None = None,
) -> str:
    """The page as text; `study` is what study.html.j2 shows before the legs (`cpcal.report.study_report`), `run` the
    folder of the run where the page is to check its certificates.

    Raises InputError when the result is of another campaign, or garbled.
    """
    check_match(campaign, result)
    frames = None if study is None else DrawingFrames.of(study["record"])
    proof = embedded(None if run is None else Path(run), result)
    return rendered("report.html.j2", {"study": study, "proof": proof, **_context(campaign, result, model, frames)})


def _context(
    campaign: Campaign, result: Result, model: LegModel | None, frames: DrawingFrames | None
) -> dict[str, Any]:
    table = result_table(result)
    model, lacking = _known(result, model)
    legs = [leg_section(campaign, result, leg, model, frames) for leg in result.legs]
    return {
        "robot": campaign.robot.name,
        "count": len(campaign),
        "result": result,
        "tolerance": None if result.options.tolerance is None else stated(result.options.tolerance),
        "summary": summary(result),
        "asked": None if result.options.eps is None else stated(result.options.eps),
        "missing": notices(result, campaign.legs),
        "table": table,
        "legs": legs,
        "overall": overall(result),
        "errors": Markup(errors_svg(result, [leg["fit_error"] for leg in legs])) if legs else None,  # made by us
        "platform": Markup(platform_svg(campaign, result)) if legs else None,  # made by us: names in it are escaped
        "forcing": len(forcing_numbers(campaign, result)),
        "head": [(name, campaign.provenance[name]) for name in _HEAD if name in campaign.provenance],
        "frame": FRAME,
        "drawing_frame": drawing_frames.FRAME,
        "quantifier": QUANTIFIER,
        "longer": LONGER,
        "lacking": lacking,
        "plain": result.model.name == PLAIN.name,
        "suspicions": suspicions(campaign),
        "information": INFORMATION,
        "assumptions": assumptions(campaign, result),
        "provenance": {k: v for k, v in campaign.provenance.items() if k not in _HEAD},
        "versions": versions(),
        "command": command(result),
    }


def _known(result: Result, model: LegModel | None) -> tuple[LegModel | None, str | None]:
    """The leg model; or None and, for the page, why the residuals cannot be drawn. Raises InputError for another one
    that is given."""
    try:
        return model_of(result, model), None
    except (InputError, PluginError):
        if model is not None:
            raise
        why = f"the leg model {result.model.name!r} is not known here"
        return None, f"{why}; install the package that provides it and write the page again with `cpcal report`"
