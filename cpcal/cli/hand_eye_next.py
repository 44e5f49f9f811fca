"""`cpcal handeye-next`: which poses to measure next. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from cpcal.cli.talk import Talk, talking
from cpcal.common.names import listed
from cpcal.common.numbers import nearest
from cpcal.handeye.hand_eye_files import load_hand_eye, load_hand_poses
from cpcal.handeye.next_images import ChosenPose, next_poses


@talking
def hand_eye_next(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    poses: Annotated[
        Path, typer.Option(metavar="CSV", help="Poses that the robot can reach: image,x,y,z,qw,qx,qy,qz.")
    ],
    count: Annotated[int, typer.Option(metavar="N", help="How many to choose.")] = 3,
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error of the ranges.", show_default="1.1 eps*")
    ] = None,
    *,
    talk: Talk,
) -> None:
    """Choose the poses whose images would shrink the widest range of a STUDY most, one after another.

    The widths are first-order estimates about the best frames, not proofs: certify again when the images are there.
    """
    found = next_poses(load_hand_eye(study), load_hand_poses(poses), count, tolerance=tolerance, tell=talk.progress())
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    table.add_column("pose")
    for name in ("camera mm", "camera deg", "target mm", "target deg", "widest mm"):
        table.add_column(name, justify="right")
    for label, one in (("so far", found.before), *((f"+ {one.name}", one) for one in found.chosen)):
        table.add_row(label, *_widths(one), nearest(one.widest, 3))
    talk.out.print(table)
    talk.say(
        f"Widths of ranges at {nearest(found.tolerance, 4)} px: first-order estimates, with each pose and those above "
        f"it. The widest counts a turn as what it moves at {nearest(found.reach, 3)} mm."
    )
    if found.unseen:
        talk.say(f"The camera would not see the whole target from {len(found.unseen)} poses: {listed(found.unseen)}.")


def _widths(one: ChosenPose) -> list[str]:
    return [nearest(max(one.widths[k : k + 3]), 3) for k in (0, 3, 6, 9)]
