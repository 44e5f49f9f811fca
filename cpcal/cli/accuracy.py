"""`cpcal accuracy`: how far from where its controller says the platform can be. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from cpcal.cli.options import Status, argument, numbers_of, option, output
from cpcal.cli.terminal import Talk, answer
from cpcal.cli.verify import refusals
from cpcal.common.errors import unusable
from cpcal.files import load_campaign, load_campaign_json
from cpcal.files.run_folder import ACCURACY
from cpcal.files.tables import load_poses
from cpcal.models.platform import Workspace
from cpcal.questions import load_result
from cpcal.questions.accuracy import Accuracy, NamedPoses, certify_accuracy, save_accuracy
from cpcal.report.accuracy_page import assumption, sentences, write_accuracy


def accuracy(
    run: Path = argument("RUN", "Folder that certify wrote, with all six legs."),
    folder: Path = output(
        "DIR", "Folder for accuracy.json, accuracy.html, campaign.json and certificates; replaced there."
    ),
    workspace: str | None = option(
        None, "x=LO:HI,y=LO:HI,z=LO:HI in mm, and rx, ry, rz in degrees (default 0).", "BOX"
    ),
    poses: Path | None = option(None, "Poses: pose,x,y,z,qw,qx,qy,qz.", "CSV"),
    count: int = option(4, "Poses to measure next, by each of two rules.", "N", "--next", min=0),
    model_error: str | None = option(
        None, "ASSUMED model error everywhere: one number, or one a leg.", "MM", show_default="suggested"
    ),
    controller: Literal["nominal", "fit", "proved"] = option("fit", "Whose parameters the controller has."),
    validation: Path | None = option(None, "More poses to judge the model error by, same frames.", "CAMPAIGN"),
    gap: float = option(0.2, "Relative width at which the worst of the workspace is settled."),
    cells: int = option(600, "Of the workspace, at most."),
    *,
    talk: Talk,
) -> Status:
    """How far off can the platform of a certified RUN be, at given poses or anywhere in a workspace?

    Bounds are proved under one assumption, which is printed first: how large the model error is at poses that nobody
    measured. It also says which poses to measure next: those where the certified sets leave most open (estimates).
    """
    if workspace is None and poses is None:
        raise unusable("accuracy", "has nothing to speak of", "give --workspace or --poses, or both")
    space = None if workspace is None else Workspace.parsed(workspace)
    named = None if poses is None else NamedPoses(*load_poses(poses))
    error = numbers_of(model_error, float, "mm: give one, or one for each leg: 0.2,0.3,...", "--model-error")
    campaign, result = load_campaign_json(run), load_result(run)
    known = None if validation is None else load_campaign(validation)

    def find(draft: Path) -> Accuracy:
        if refused := refusals(run):
            raise unusable(str(run), f"is refused: {refused[0]}", "certify again")
        return certify_accuracy(
            campaign,
            result,
            poses=named,
            workspace=space,
            model_error=error[0] if error is not None and len(error) == 1 else error,
            controller=controller,
            validation=known,
            gap=gap,
            cells=cells,
            next_poses=count,
            certificates=draft,
            tell=talk.progress(),
        )

    def show(found: Accuracy) -> None:
        talk.say(assumption(found), *sentences(found))

    found = answer(folder, ACCURACY, find, save_accuracy, write_accuracy, show, talk, campaign)
    over = found.workspace
    lost = found.refuted or any(not pose.proved for pose in found.poses) or (over is not None and over.left_out)
    return Status.UNKNOWN if lost else Status.ANSWERED
