"""`cpcal accuracy`: how far from where its controller says the platform can be. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cpcal.checker import Refused, Unusable, check_run
from cpcal.cli.options import Status, Talk, answer, check_target, output
from cpcal.common.errors import InputError, Problem
from cpcal.files import load_campaign, load_campaign_json
from cpcal.files.run_folder import ACCURACY
from cpcal.files.tables import load_poses
from cpcal.models.platform import Workspace
from cpcal.questions import load_result
from cpcal.questions.accuracy import Accuracy, NamedPoses, certify_accuracy, save_accuracy
from cpcal.report.accuracy_page import ACCURACY_PAGE, assumption, sentences, write_accuracy


def accuracy(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify wrote, with all six legs.")],
    folder: Annotated[
        Path, output("DIR", "Folder for accuracy.json, accuracy.html, campaign.json and certificates; replaced there.")
    ],
    workspace: Annotated[
        str | None,
        typer.Option(metavar="BOX", help="x=LO:HI,y=LO:HI,z=LO:HI in mm, and rx, ry, rz in degrees (default 0)."),
    ] = None,
    poses: Annotated[Path | None, typer.Option(metavar="CSV", help="Poses: pose,x,y,z,qw,qx,qy,qz.")] = None,
    count: Annotated[
        int, typer.Option("--next", metavar="N", min=0, help="Poses to measure next, by each of two rules.")
    ] = 4,
    model_error: Annotated[
        str | None,
        typer.Option(
            metavar="MM", help="ASSUMED model error everywhere: one number, or one a leg.", show_default="suggested"
        ),
    ] = None,
    controller: Annotated[
        Literal["nominal", "fit", "proved"], typer.Option(help="Whose parameters the controller has.")
    ] = "fit",
    validation: Annotated[
        Path | None, typer.Option(metavar="CAMPAIGN", help="More poses to judge the model error by, same frames.")
    ] = None,
    gap: Annotated[float, typer.Option(help="Relative width at which the worst of the workspace is settled.")] = 0.2,
    cells: Annotated[int, typer.Option(help="Of the workspace, at most.")] = 600,
    *,
    talk: Talk,
) -> Status:
    """How far off can the platform of a certified RUN be, at given poses or anywhere in a workspace?

    Bounds are proved under one assumption, which is printed first: how large the model error is at poses that nobody
    measured. It also says which poses to measure next: those where the certified sets leave most open (estimates).
    """
    if workspace is None and poses is None:
        raise InputError([Problem("accuracy", "has nothing to speak of", "give --workspace or --poses, or both")])
    space = None if workspace is None else Workspace.parsed(workspace)
    named = None if poses is None else NamedPoses(*load_poses(poses))
    check_target(folder, ACCURACY)
    _check(run)
    campaign, result = load_campaign_json(run), load_result(run)
    error = None if model_error is None else _numbers(model_error)
    known = None if validation is None else load_campaign(validation)

    def find(draft: Path) -> Accuracy:
        return certify_accuracy(
            campaign,
            result,
            poses=named,
            workspace=space,
            model_error=error,
            controller=controller,
            validation=known,
            gap=gap,
            cells=cells,
            next_poses=count,
            certificates=draft,
            tell=talk.progress(),
        )

    def write(found: Accuracy, draft: Path) -> None:
        save_accuracy(found, draft)
        write_accuracy(found, draft)

    def show(found: Accuracy, failure: InputError | None) -> None:
        talk.say(assumption(found), *sentences(found))
        if failure is None:
            talk.say(f"Page: {folder / ACCURACY_PAGE}")

    found = answer(folder, ACCURACY, find, write, show, campaign)
    over = found.workspace
    lost = found.refuted or any(not pose.proved for pose in found.poses) or (over is not None and over.left_out)
    return Status.UNKNOWN if lost else Status.ANSWERED


def _check(run: Path) -> None:
    """Raises InputError unless every certificate of the run is accepted."""
    try:
        refused = [f"leg {leg.leg}: {leg.refused}" for leg in check_run(run) if leg.refused is not None]
    except (Refused, Unusable) as reason:
        refused = [str(reason)]
    if refused:
        raise InputError([Problem(str(run), f"is refused: {refused[0]}", "certify again")])


def _numbers(text: str) -> float | tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        what = f"{text!r:.60} is not numbers of mm"
        raise InputError(
            [Problem("option --model-error", what, "give one, or one for each leg: 0.2,0.3,...")]
        ) from None
    return values[0] if len(values) == 1 else values
