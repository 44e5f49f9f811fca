"""`cpcal handeye-legs`: joints of certified legs in the robot's own frames. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from cpcal.cli.talk import Talk, talking
from cpcal.common.numbers import at_least, at_most, bracket_text, rounded_down, rounded_up
from cpcal.handeye.hand_eye_result import load_hand_eye_result
from cpcal.handeye.legs_in_frames import JOINTS, legs_in_frames
from cpcal.results import load_result


@talking
def hand_eye_legs(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Of cpcal certify, with --tolerance.")],
    frames: Annotated[Path, typer.Option(metavar="RUN", help="Of cpcal handeye: camera and target of that robot.")],
    *,
    talk: Talk,
) -> None:
    """Joints of the legs in the frames of base and platform, for all frames in the ranges of a hand-eye run.

    The campaign must be in the frames of camera and target, as `cpcal calibrate` makes it: eps* of a leg then needs no
    frames. Proved, if `cpcal verify` accepts both runs; the camera is taken as exact.
    """
    known = load_hand_eye_result(frames)
    found = legs_in_frames(load_result(run), known)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "eps* [mm]", "joint", "at least", "at most", "width"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for leg in found:
        low, high = bracket_text(leg.eps_lo, leg.eps_hi)
        for k, (name, a, b) in enumerate(zip(JOINTS, leg.low, leg.high, strict=True)):
            first = (str(leg.leg), f"[{low}, {high}]") if not k else ("", "")
            table.add_row(*first, name, rounded_down(a, 3), rounded_up(b, 3), at_most(b - a, 3))
    talk.out.print(table)
    talk.say(
        f"For every pair of frames that explains the pixels to {at_least(known.ranges.eps, 4)} px, and all parameters "
        f"of a leg at its tolerance ({', '.join(sorted({at_least(leg.eps, 4) for leg in found}))} mm). Base in the "
        "drawing's base frame, mobile in its mobile frame."
    )
