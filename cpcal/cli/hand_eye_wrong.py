"""`cpcal handeye-wrong`: which images are wrong. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable, output_path
from cpcal.cli.status import Status
from cpcal.cli.talk import Talk, talking
from cpcal.files.run_folder import HANDEYE_WRONG, answers_into, check_replaceable
from cpcal.handeye.certify_hand_eye import Within
from cpcal.handeye.hand_eye_files import hand_eye_files, load_hand_eye
from cpcal.handeye.hand_eye_words import wrong_sentences
from cpcal.handeye.wrong_images import find_wrong_images, save_wrong_images
from cpcal.report.wrong_images_page import WRONG_PAGE, write_wrong_images


@talking
def wrong_images(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the run; replaced there."),
    ],
    outliers: Annotated[int, typer.Option(metavar="N", help="Images that may be wrong, at most.")] = 1,
    within: Annotated[
        str,
        typer.Option(metavar="DEG,MM", help="Search within these of the trimmed fit; 'any' for all rotations."),
    ] = "any,2000",
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error of right images.", show_default="1.1 eps*")
    ] = None,
    *,
    talk: Talk,
) -> None:
    """Bracket the least largest error of a STUDY when some images may be wrong, and prove which ones are.

    A wrong image has a slipped board, a wrong robot pose, a wrong name. Nobody needs to know which.
    """
    check_writable(folder)
    check_replaceable(folder, HANDEYE_WRONG)
    loaded = load_hand_eye(study)
    with answers_into(folder, HANDEYE_WRONG) as draft:
        for name, content in hand_eye_files(loaded).items():
            (draft / name).write_bytes(content)
        found = find_wrong_images(
            loaded,
            outliers,
            draft,
            within=Within.parsed(within),
            tolerance=tolerance,
            tell=talk.progress(),
        )
        save_wrong_images(found, draft)
        write_wrong_images(loaded, found, draft)
    for text in wrong_sentences(found):
        talk.say(text)
    talk.say(f"Page: {folder / WRONG_PAGE}")
    raise typer.Exit(Status.ANSWERED if found.eps_lo > 0.0 else Status.UNKNOWN)
