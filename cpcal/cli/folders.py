"""Where results go: refused before the work begins, not after it."""

from __future__ import annotations

import os
from pathlib import Path

import typer

from cpcal.common.errors import InputError, Problem
from cpcal.common.files import unwritable
from cpcal.files.run_folder import FolderKind, check_replaceable

__all__ = ["check_new", "check_target", "check_writable", "made", "output_path", "unwritable"]

# What stands in the folder of a study beside calibration.json, as `cpcal calibrate` and `cpcal demo` leave it.
STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT = "study", "campaign", "validation", "fits", "run", "timeout"
PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN = "pixel-sets", "pixel-campaign", "pixel-run"  # where poses came from images

_CHOOSE = "choose a folder that can be written to"


def check_new(folder: Path, *, force: bool) -> None:
    """InputError when `folder` holds something, unless `force`d, or cannot be written."""
    check_writable(folder)
    try:
        full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise unwritable(folder, error) from None
    if full and not force:
        remedy = "choose another one, or overwrite what it holds with --force"
        raise InputError([Problem(str(folder), "is a folder that is not empty", remedy)])


def is_earlier_demo(folder: Path) -> bool:
    """Whether a folder holds a study that `cpcal demo` wrote, or the poses found so far, and nothing besides."""
    files = {"calibration.json", "images", "images.json", "report.html"}
    known = files | {STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT, PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN}
    begun = folder / "poses-calibration.csv.journal"
    if not ((folder / STUDY / "study.toml").is_file() or begun.is_file()):
        return False
    return all(path.name in known or path.name.startswith("poses-") for path in folder.iterdir())


def check_writable(folder: Path) -> None:
    """InputError when `folder` is no folder that can be written, or made."""
    ancestor = folder.absolute()
    while not os.path.lexists(ancestor):
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise InputError([Problem(str(folder), f"cannot be a folder: {ancestor} is not one", _CHOOSE)])
    if not os.access(ancestor, os.W_OK | os.X_OK):
        raise InputError([Problem(str(folder), f"cannot be written: no permission in {ancestor}", _CHOOSE)])


def output_path(text: str) -> Path:
    """The value of an option that names what to write. Raises BadParameter."""
    if not text.strip() or "\0" in text:
        raise typer.BadParameter("an empty name is no place to write to: name a file or folder")
    return Path(text)


def check_target(folder: Path, kind: FolderKind, campaign: Path | None = None) -> None:
    """InputError when answers about a campaign cannot be written to `folder`, or must not."""
    check_writable(folder)
    if campaign is not None and folder.exists() and campaign.exists() and folder.samefile(campaign):
        raise InputError([Problem(str(folder), "is the campaign itself", "choose another folder for the answers")])
    check_replaceable(folder, kind)


def made(folder: Path) -> None:
    """Make the folder if need be. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
