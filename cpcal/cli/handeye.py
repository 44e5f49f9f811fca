"""`cpcal handeye`: a study, how accurate its calibration can be, and legs in the robot's own frames."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from cpcal.checker.files import STUDY_NAME
from cpcal.cli.certify import show
from cpcal.cli.verbs import FIRST_ROW, FORCE, Status, Talk, answer, argument, check_new, numbers_of, option, output
from cpcal.common.errors import refuse, unusable
from cpcal.common.files import listed
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, rounded_down, rounded_up
from cpcal.files import load_study
from cpcal.files.run_folder import HANDEYE, check_replaceable
from cpcal.models.hand_eye import (
    HandEyeStudy,
    Setup,
    load_hand_eye,
    load_hand_poses,
    save_hand_eye,
    simulate_hand_eye,
    study_json,
)
from cpcal.models.hand_eye_sources import (
    other_direction,
    photo_names,
    platform_poses,
    read_pose_pairs,
    study_of_pairs,
    study_of_photos,
    study_of_robot,
    with_half_widths,
)
from cpcal.questions import load_result
from cpcal.questions.hand_eye import (
    GAP,
    JOINTS,
    HandEyeResult,
    Within,
    certify_hand_eye,
    legs_in_frames,
    load_hand_eye_result,
    save_hand_eye_result,
)
from cpcal.questions.next_measurement import next_images
from cpcal.report.hand_eye_page import (
    BOTH,
    HAND_EYE_PAGE,
    answered,
    given_values,
    known_frames,
    question,
    searched,
    write_both,
    write_hand_eye,
)
from cpcal.robot.units import CONTROLLERS
from cpcal.vision.batch.detect import hinted
from cpcal.vision.files.plate_and_camera import load_camera, load_target
from cpcal.vision.target import TEXTS

# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye study`: from photographs, from pairs of poses, or simulated.


def study(
    folder: Path = output("DIR", "Folder for the study."),
    setup: Setup = option("eye-in-hand", "Where the camera is."),
    photos: Path | None = option(None, "Photographs of a board.", "DIR"),
    board: str | None = option(None, f"target.toml, or {TEXTS}.", "TARGET"),
    first_row: str | None = FIRST_ROW,
    camera: Path | None = option(None, "Of the photographs.", "FILE"),
    poses: Path | None = option(None, "Of the hand at each photograph: a table, or matrices.", "FILE"),
    rotation: str | None = option(
        None,
        f"How --poses has rotations: {', '.join(CONTROLLERS)}, euler-xyz-deg (fixed axes), euler-ZYX-deg (turned "
        "axes), vector-rad, ...",
        "FORM",
        show_default="told by the columns of quaternions and matrices",
    ),
    unit: Literal["mm", "m"] | None = option(
        None, "Of lengths in --poses, where it states none, or --pairs.", show_default="mm (ur: m), of --pairs m"
    ),
    base_in_hand: bool = option(False, "--poses has the base in the hand frame, not the hand in the base frame."),
    pairs: Path | None = option(None, "Pairs of poses: MoveIt's samples, OpenCV's lists, ROS.", "YAML"),
    robot: Path | None = option(
        None, "A parallel robot's study: its drawing and legs say where the platform is.", "STUDY"
    ),
    of: Path | None = option(None, "A study, to say --off of it.", "STUDY"),
    off: str | None = option(
        None, "How far each pose of the robot may be off, on each axis; or 'estimated' from the data.", "MM,DEG"
    ),
    size: float = option(100.0, "Of the square that stands in for a marker.", "MM"),
    simulated: int | None = option(None, "Simulate N images.", "N", "--simulate"),
    pixel_error: float = option(0.2, "With --simulate: at most, on each axis.", "PX"),
    position_error: float = option(0.0, "With --simulate: of the robot.", "MM"),
    rotation_error: float = option(0.0, "With --simulate: of the robot.", "DEG"),
    seed: int = option(1, "With --simulate."),
    force: bool = FORCE,
) -> None:
    """Make a study for `cpcal handeye certify`: from --photos of a board, from --pairs of poses, or with --simulate.

    With --robot the poses are those of a parallel robot's platform, as its drawing has them; its photographs are named
    POSE/RUN or POSE/RUN/IMAGE, and without --photos the poses that its camera saw stand in for them.
    """
    if sum([bool(photos or robot), bool(pairs), bool(of), simulated is not None]) != 1:
        remedy = "give --photos, --pairs, --simulate N, --of STUDY, or --robot with or without --photos"
        raise unusable("handeye study", "needs one source", remedy)
    check_new(folder, force=force)
    left = list[str]()
    if photos is not None:
        if board is None or camera is None or (poses is None) == (robot is None):
            remedy = "give --board, --camera and --poses (or --robot) too"
            raise unusable("option --photos", "is not enough", remedy)
        if poses is not None:
            names = photo_names(photos)
            given = load_hand_poses(poses, rotation=rotation, unit=unit or "", base_in_hand=base_in_hand, names=names)
        elif robot is not None:
            given, setup = platform_poses(load_study(robot)), "eye-to-hand"
        lens, turn, target = load_camera(camera).camera, hinted(first_row), load_target(board)
        made, left = study_of_photos(photos, target, camera=lens, poses=given, setup=setup, first_row=turn)
    elif robot is not None:
        made = study_of_robot(load_study(robot))
    elif of is not None:
        made = load_hand_eye(of)
    elif pairs is not None:
        made = study_of_pairs(*read_pose_pairs(pairs, setup=setup, metres=unit != "mm"), setup=setup, size=size)
    else:
        images = simulated or 0
        if not 3 <= images <= 1000:
            raise unusable("option --simulate", f"is {images}", "give a number of images from 3 to 1000")
        made = simulate_hand_eye(
            setup=setup,
            images=images,
            pixel_error=pixel_error,
            position_error=position_error,
            rotation_error=float(np.radians(rotation_error)),
            seed=seed,
        ).study
    if off is not None:
        made = with_half_widths(made, off)
    save_hand_eye(made, folder)
    Talk().say(
        *(f"left out: {text}" for text in left),
        *(other_direction(made) if photos is not None or pairs is not None else ()),
        f"{made.setup}: {len(made.images)} images, {len(made.image):,} points in {folder}",
        *(f"half-widths of poses, {made.provenance['half_widths']}" for _ in [off] if off == "estimated"),
    )


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye certify`: how accurate a calibration can be; which images are wrong; which poses to measure next.


def certify(
    folder: Path = argument("STUDY", "Folder of handeye.toml, a camera file, poses.csv, points.csv."),
    run: Path | None = output(
        "DIR", "Folder for the run; replaced there.", None, show_default="required, but with --next"
    ),
    tolerance: float | None = option(
        None, "Largest error allowed.", "PX", show_default="1.1 eps*, 1.01 if a turn is open"
    ),
    wrong: int = option(0, "So many images may be wrong, nobody knows which.", "Q", min=0),
    count: int | None = option(
        None, "Certify nothing; choose N of --poses that shrink the ranges most.", "N", "--next"
    ),
    poses: Path | None = option(None, "With --next: what the robot can reach: image,x,y,z,qw,qx,qy,qz.", "CSV"),
    within: str = option("any,2000", "Search within these of the classical answer; 'any' for all rotations.", "DEG,MM"),
    poses_off: str | None = option(
        None,
        "Ask twice: with exact poses, and with poses that may be off by so much on each axis, or by what is "
        "'estimated' from the data.",
        "MM,DEG",
        "--off",
    ),
    known: str = option(
        "",
        "What you know of camera or target in the hand or base frame: x, y, z (mm), or the tilt between their z axes "
        "(degrees).",
        "camera.z=LOW:HIGH,...",
    ),
    gap: float = option(GAP, "Relative width of the bracket that is asked for."),
    time_limit: float | None = option(None, "Seconds for each proof, at most.", "S"),
    at: str | None = option(
        None,
        "How accurate is a point there, mm in the camera frame?",
        "X,Y,Z",
        show_default="on its axis, as far as the target",
    ),
    *,
    talk: Talk,
) -> Status:
    """How well can any camera and target frames explain the pixels of a STUDY, and how well are the frames known?

    The least possible largest error eps* in pixels is bracketed: proved from below by a certificate, attained
    from above by frames that are checked in exact arithmetic. Then come ranges of all frames that are nearly as good.
    With --wrong the bracket holds whichever Q images are left out (a slipped board, a wrong robot pose, a wrong name),
    and images that must be wrong are named. With --next the widths are first-order estimates, not proofs.
    """
    together, alone = "--next and --poses go together", "--gap, --time-limit and --at have no meaning with --wrong"
    refuse(
        ((count is None) != (poses is None), "options", together, "give both, or none"),
        (
            count is not None and (known or poses_off),
            "--known and --off",
            "have no meaning with --next",
            "leave them out",
        ),
        (count is None and run is None, "option --output", "is missing", "name a folder for the run"),
        (wrong and (gap != GAP or time_limit is not None or at is not None), "options", alone, "leave them out"),
    )
    study = load_hand_eye(folder)
    if count is not None and poses is not None:
        return _next(study, poses, count, tolerance, talk)
    assert run is not None
    point, box = numbers_of(at, float, "x, y, z in mm", "--at"), Within.parsed(within, known)

    def find(part: HandEyeStudy, draft: Path) -> HandEyeResult:
        (draft / STUDY_NAME).write_bytes(study_json(part))  # for whoever checks the run
        return certify_hand_eye(
            part,
            outliers=wrong,
            within=box,
            tolerance=tolerance,
            gap=gap,
            certificates=draft,
            time_limit=np.inf if time_limit is None else time_limit,
            at=point,
            tell=talk.progress(),
        )

    def told(found: HandEyeResult) -> None:
        talk.say(searched(found))
        title = "Answer" if poses_off is None else question(found)
        show(talk, answered(found)._replace(title=title), *known_frames(found))

    head, held = (BOTH[0], "two questions") if poses_off is None else (".", "one question")
    if (run / head / HANDEYE.head).exists():
        raise unusable(run, f"holds the run of {held}", "name another folder, or move it away")
    parts = [(run, study)]
    if poses_off is not None:
        check_replaceable(run, HANDEYE)
        exact, uncertain = BOTH
        parts = [(run / exact, study.exactly()), (run / uncertain, with_half_widths(study, poses_off))]
    good = True
    for place, part in parts:
        found = answer(place, HANDEYE, partial(find, part), save_hand_eye_result, write_hand_eye, told, talk)
        good &= bool(found.eps_lo > 0.0 if wrong else found.complete if found.tolerance is None else found.passes)
    if poses_off is not None:
        talk.say(f"Both: {write_both(run, run / HAND_EYE_PAGE)}")
    return Status.ANSWERED if good else Status.UNKNOWN


def _next(study: HandEyeStudy, poses: Path, count: int, tolerance: float | None, talk: Talk) -> Status:
    found = next_images(study, load_hand_poses(poses), count, tolerance=tolerance, tell=talk.progress())
    rows = []
    for label, one in (("so far", found.before), *((f"+ {one.name}", one) for one in found.chosen)):
        widths = [nearest(max(one.widths[k : k + 3]), 3) for k in (0, 3, 6, 9)]
        rows.append((label, *widths, nearest(one.widest, 3)))
    talk.table(("pose", "camera mm", "camera deg", "target mm", "target deg", "widest mm"), rows)
    talk.say(
        f"Widths of ranges at {nearest(found.tolerance, 4)} px: first-order estimates, with each pose and those above "
        f"it. The widest counts a turn as what it moves at {nearest(found.reach, 3)} mm."
    )
    if found.unseen:
        talk.say(f"The camera would not see the whole target from {len(found.unseen)} poses: {listed(found.unseen)}.")
    return Status.ANSWERED


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye legs`: joints of certified legs in the robot's own frames.


def legs(
    run: Path = argument("RUN", "Of cpcal certify, with --tolerance."),
    frames: Path = option(..., "Of cpcal handeye certify: camera and target of that robot.", "RUN"),
    *,
    talk: Talk,
) -> None:
    """Joints of the legs in the frames of base and platform, for all frames in the ranges of a hand-eye run.

    The campaign must be in the frames of camera and target, as `cpcal calibrate` makes it: eps* of a leg then needs no
    frames. Proved, if `cpcal verify` accepts both runs; the camera is taken as exact.
    """
    result, known = load_result(run), load_hand_eye_result(frames)
    joints, rows = legs_in_frames(result, known), []
    for leg in result.legs:
        low, high = bracket_text(leg.bracket.lo, leg.bracket.hi)
        for k, (name, a, b) in enumerate(zip(JOINTS, *joints[leg.leg], strict=True)):
            first = ("", "") if k else (str(leg.leg), f"[{low}, {high}]")
            rows.append((*first, name, rounded_down(a, 3), rounded_up(b, 3), at_most(b - a, 3)))
    talk.table(("leg", "eps* [mm]", "joint", "at least", "at most", "width"), rows, left=(2,))
    tolerances = sorted({at_least(leg.ranges.eps, 4) for leg in result.legs if leg.ranges is not None})
    talk.say(
        f"For every pair of frames that explains the pixels to {at_least(known.eps, 4)} px, and all parameters of a "
        f"leg at its tolerance ({', '.join(tolerances)} mm). Base in the drawing's base frame, mobile in its mobile "
        f"frame{given_values(known)}."
    )
