"""The page of a whole study from the folder that `cpcal demo` leaves."""

from __future__ import annotations

from pathlib import Path

from cpcal.calibration import RECORD_NAME, load_record
from cpcal.certify.fits import load_fits
from cpcal.cli.checked import check_all
from cpcal.cli.folders import CAMPAIGN, FITS, PIXEL_RUN, PIXEL_SETS, RUN, TIMEOUT
from cpcal.files import load_campaign
from cpcal.report.images import load_images
from cpcal.report.study_report import StudyFound
from cpcal.results import load_result


def holds_study(folder: Path) -> bool:
    """Whether a folder is that of a study, not of a run."""
    return (folder / RECORD_NAME).is_file()


def study_found(folder: Path) -> tuple[bool, StudyFound]:
    """What the folder holds, and whether the checker, asked now, accepts all its certificates. Raises InputError."""
    campaign, record = load_campaign(folder / CAMPAIGN), load_record(folder)
    fits, result, timeout = load_fits(folder / FITS), load_result(folder / RUN), load_result(folder / TIMEOUT)
    parts = (FITS, RUN, PIXEL_SETS, PIXEL_RUN)
    accepted, said = check_all(path for part in parts for path in sorted((folder / part).glob("*.cert.jsonl")))
    return accepted, StudyFound(
        campaign=campaign,
        record=record,
        fits=fits,
        result=result,
        timeout=timeout,
        checked=said,
        images=load_images(folder),
    )
