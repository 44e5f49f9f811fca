"""One self-contained HTML page from a campaign and its result: no network, light and dark; it checks itself."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shlex
import zlib
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cpcal.common.errors import InputError, PluginError, Problem, printable
from cpcal.common.files import write_file
from cpcal.common.numbers import stated
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import REPORT_NAME
from cpcal.legs import PLAIN, LegModel
from cpcal.questions import INFORMATION, Result, model_of
from cpcal.report.leg_section import DRAWING_FRAME, DrawingFrames, leg_section
from cpcal.report.overview import errors_svg, forcing_numbers, platform_svg
from cpcal.report.result_table import result_table
from cpcal.report.words import FRAME, LONGER, QUANTIFIER, assumptions, notices, overall, summary
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions

# ------------------------------------------------------------------------------------------------------------------
# How pages are made of templates: text escaped and cleaned.


def rendered(template: str, context: dict[str, Any]) -> str:
    """The page of a template in `cpcal/report/templates`."""
    environment = Environment(
        loader=PackageLoader("cpcal.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: _visible(value) if type(value) is str else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context) + "\n"


def _visible(text: str) -> str:
    """Hidden characters as escapes; line breaks stay, an HTML page shows them as spaces."""
    return "\n".join(printable(line) for line in text.expandtabs().split("\n"))


# ------------------------------------------------------------------------------------------------------------------
# Where a page comes from: the command that repeats the run, and the versions at work.

_PACKAGES = ("numpy", "scipy", "python-flint")


def command(result: Result) -> str:
    """The `cpcal certify` command that asks the same again, for a shell; the two folders are placeholders."""
    return shlex.join(["cpcal", "certify", "CAMPAIGN", "-o", "RUN", *result.options.words()])


def versions() -> str:
    """Of cpcal and of what it computes and draws with, here and now."""
    return ", ".join([f"cpcal {__version__}", *(f"{name} {_version(name)}" for name in _PACKAGES)])


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "of unknown version"


# ------------------------------------------------------------------------------------------------------------------
# Whether a result, which may come from a file, is of this campaign and can be shown.


def check_match(campaign: Campaign, result: Result) -> None:
    """Raises InputError when the result is of another campaign, or of legs that it has not."""
    sha256 = campaign_sha256(campaign)
    if result.campaign_sha256 != sha256:
        what = f"is of another campaign (sha256 {printable(str(result.campaign_sha256))}, not {sha256})"
        raise InputError([Problem("result", what, "give the campaign that was certified, or certify this one")])
    absent = [leg.leg for leg in result.legs if leg.leg > campaign.legs]
    if absent:
        what, remedy = f"names a leg that is not there: {absent[0]}", f"certify again: legs are 1 to {campaign.legs}"
        raise InputError([Problem("result", what, remedy)])


# ------------------------------------------------------------------------------------------------------------------
# What a page holds so that it can check itself: campaign, certificates, checker, script.

_CAMPAIGN = "campaign.json"
_MOST = 4_000_000  # characters; a page with more is too slow to open


@dataclass(frozen=True)
class Embedded:
    """Made by us, or base64: nothing in it needs to be escaped.

    data     JSON: the campaign and the certificates, deflated
    checker  the certificate checker; it runs in a worker only
    script   the page's own script; source  its name in a content security policy
    """

    data: Markup
    checker: Markup
    script: Markup
    source: str


def embedded(run: Path | None, result: Result) -> Embedded | None:
    """Of the folder of a run; None where it holds no certificate of the result, or more than a page should.

    The same files give the same text.
    """
    certificates = [] if run is None else _certificates(run, result)
    if run is None or not certificates or not (run / _CAMPAIGN).is_file():
        return None
    campaign = (run / _CAMPAIGN).read_bytes()
    if hashlib.sha256(campaign).hexdigest() != result.campaign_sha256:
        return None
    data = json.dumps({"campaign": _deflated(campaign), "certificates": certificates}).replace("<", "\\u003c")
    if len(data) > _MOST:
        return None
    script = _script("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return Embedded(Markup(data), Markup(_script("checker.js")), Markup(script), f"'sha256-{digest}'")


def _certificates(run: Path, result: Result) -> list[dict[str, object]]:
    """Those of the brackets and of the ranges that lie in the folder."""
    out: list[dict[str, object]] = []
    for leg in result.legs:
        named = {"bracket": leg.certificate, "ranges": None if leg.ranges is None else leg.ranges.certificate}
        for kind, name in named.items():
            if name is not None and (run / name).is_file():
                content = _deflated((run / name).read_bytes())
                out.append({"leg": leg.leg, "kind": kind, "name": name, "deflated": content})
    return out


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _script(name: str) -> str:
    return (files("cpcal.report") / "browser" / name).read_text(encoding="utf-8")


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
        "drawing_frame": DRAWING_FRAME,
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
