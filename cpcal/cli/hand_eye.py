"""`cpcal handeye`: how accurate a hand-eye calibration can be. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.folders import check_writable, output_path
from cpcal.cli.status import Status
from cpcal.cli.talk import Talk, talking
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.numbers import rounded_down, rounded_up
from cpcal.files.run_folder import HANDEYE, answers_into, check_replaceable
from cpcal.handeye.certify_hand_eye import GAP, Within, certify_hand_eye
from cpcal.handeye.hand_eye_files import hand_eye_files, load_hand_eye
from cpcal.handeye.hand_eye_result import HandEyeResult, save_hand_eye_result
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.hand_eye_words import names_of, sentences
from cpcal.report.hand_eye_page import HAND_EYE_PAGE, write_hand_eye


@talking
def hand_eye(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the run; replaced there."),
    ],
    within: Annotated[
        str,
        typer.Option(metavar="DEG,MM", help="Search within these of the classical answer; 'any' for all rotations."),
    ] = "any,2000",
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error allowed.", show_default="ranges at 1.1 eps*")
    ] = None,
    images: Annotated[
        str | None, typer.Option(metavar="A,B", help="Names of the images to use.", show_default="all")
    ] = None,
    gap: Annotated[float, typer.Option(help="Relative width of the bracket that is asked for.")] = GAP,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds for each proof, at most.")] = None,
    *,
    talk: Talk,
) -> None:
    """How well can any camera and target frames explain the pixels of a STUDY, and how well are the frames known?

    The least possible largest error eps* in pixels is bracketed: proved from below by a certificate, attained
    from above by frames that are checked in exact arithmetic. Then come ranges of all frames that are nearly as good.
    """
    check_writable(folder)
    check_replaceable(folder, HANDEYE)
    loaded = _chosen(load_hand_eye(study), images)
    with answers_into(folder, HANDEYE) as draft:
        for name, content in hand_eye_files(loaded).items():
            (draft / name).write_bytes(content)
        found = certify_hand_eye(
            loaded,
            within=Within.parsed(within),
            tolerance=tolerance,
            gap=gap,
            certificates=draft,
            time_limit=np.inf if time_limit is None else time_limit,
            tell=talk.progress(),
        )
        save_hand_eye_result(found, draft)
        write_hand_eye(found, draft)
    _show(talk.out, found)
    talk.say(f"Page: {folder / HAND_EYE_PAGE}")
    raise typer.Exit(_status(found))


def _chosen(study: HandEyeStudy, images: str | None) -> HandEyeStudy:
    if images is None:
        return study
    names = [name.strip() for name in images.split(",")]
    strange = [name for name in names if name not in study.images]
    if strange or len(set(names)) < len(names):
        what = f"names {strange[0]!r:.60}, which is no image" if strange else "names an image twice"
        raise InputError([Problem("option --images", what, "give names of poses.csv, each once, by commas")])
    return study.part(np.array([study.images.index(name) for name in names], dtype=np.intp))


def _show(console: Console, found: HandEyeResult) -> None:
    for text in sentences(found):
        console.print(printable(text), soft_wrap=not console.is_terminal)
    if found.ranges.empty:
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("parameter", "at least", "at most", "unit"):
        table.add_column(name, justify="right" if name.startswith("at") else "left")
    ends = zip(found.ranges.low, found.ranges.high, strict=True)
    for (name, unit), (low, high) in zip(names_of(found.setup), ends, strict=True):
        table.add_row(name, rounded_down(low, 3), rounded_up(high, 3), unit)
    console.print(table)


def _status(found: HandEyeResult) -> Status:
    if found.tolerance is not None:
        return Status.ANSWERED if found.passes else Status.UNKNOWN
    return Status.ANSWERED if found.complete else Status.UNKNOWN
