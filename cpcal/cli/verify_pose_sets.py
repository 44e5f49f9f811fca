"""`cpcal verify` of pose sets, from their pixels on."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Sequence
from fractions import Fraction as F
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.checker import Unusable
from cpcal.checker.pose_claim import PoseSetChecked, check_pose_set, check_pose_sets
from cpcal.cli.talk import Talk
from cpcal.common.errors import InputError, Problem, Problems
from cpcal.common.numbers import about, at_most
from cpcal.files.tables import JSON_MAX, json_object, small_file, unguarded
from cpcal.solver.contract import Verdict
from cpcal.vision.batch.enclose import stem_of
from cpcal.vision.camera import CAMERA_NUMBERS
from cpcal.vision.pose_sets.pose_certificate import SUFFIX

TABLE = "sets.csv"
NUMBERS = ("x", "y", "z", "qw", "qx", "qy", "qz", "dx", "dy", "dz", "drx", "dry", "drz")  # of it


def verify_pose_sets(target: Path, sources: Sequence[Path], talk: Talk) -> bool:
    """Check one claim or a folder of them, say what is proved. Raises InputError where there is nothing to check."""
    try:
        found = check_pose_sets(target) if target.is_dir() else [check_pose_set(target)]
    except Unusable as reason:
        raise InputError([Problem(str(target), str(reason), "name what cpcal pose-sets wrote")]) from None
    good = all(one.refused is None for one in found)
    for one in found:
        talk.say(f"{one.name}: {_proved(one)}")
    if (target / TABLE).is_file() and (wrong := _table_problem(target / TABLE, found)):
        good = False
        talk.say(f"{TABLE}: REFUSED, {wrong}")
    if good:
        say_assumptions(target, talk)
    for path in sources:
        good = _same_source(path, found, talk) and good
    return good


def _table_problem(path: Path, found: Sequence[PoseSetChecked]) -> str:
    """What the table of a folder states that its claims do not; "" where both agree, number by number."""
    problems = Problems()
    content = small_file(path, problems, "", most=JSON_MAX)
    problems.raise_any()
    claims = {one.name: one for one in found if one.refused is None}
    try:
        for row in csv.DictReader(io.StringIO((content or b"").decode()), strict=True):
            name, verdict, cells = row["file"], row["verdict"], [row[column] for column in NUMBERS]
            claim = claims.pop(stem_of(unguarded(name)), None)
            stated = [F(float(cell)) for cell in cells if cell]
            proved: list[F] = []
            verdict_of = None if claim is None else Verdict.REFUTED.value
            if claim is not None and claim.radii is not None:
                proved, verdict_of = [*claim.pose, *claim.radii], Verdict.PROVED.value
            if stated != proved:
                return f"{name}: its numbers are not those of a claim that is proved"
            if verdict != verdict_of and (
                claim is not None or verdict in (Verdict.PROVED.value, Verdict.REFUTED.value)
            ):
                return f"{name}: its verdict is {verdict}, and no claim that is proved says so"
    except (ValueError, KeyError, TypeError, OverflowError, csv.Error) as error:
        return f"is no table of pose sets: {error!s:.100}"
    return f"it leaves out {min(claims)}" if claims else ""


def say_assumptions(target: Path, talk: Talk) -> None:
    """What the claims of a folder, or one claim, assume of camera, plate and pixels."""
    files = sorted(target.glob(f"*{SUFFIX}")) if target.is_dir() else [target]
    for sentence in sorted({_assumed(json_object(file, "name a claim", "name a claim")) for file in files}):
        talk.say(f"Assumed, not proved: {sentence}")


def _assumed(claim: dict[str, Any]) -> str:
    """Floats that the claim holds, in print: they are given, and nothing is rounded to a side."""
    pixels, camera, target = (claim["inputs"][key] for key in ("pixels", "camera", "target"))
    exact = np.vectorize(float.fromhex, otypes=[np.float64])
    reach = about(float((exact(pixels["hi"]) - exact(pixels["lo"])).max()) / 2.0)
    seen = "the centre of each dot's image" if pixels["of"] == "images" else "the image of each dot's centre"
    but = f", but of at most {claim['outliers']} dots" * bool(claim["outliers"])
    spread = exact(camera["spread"])
    if spread.size:
        each = np.linalg.norm(spread, axis=1) if camera["ball"] else np.abs(spread).sum(axis=1)
        shape = "an ellipsoid" if camera["ball"] else "a box"
        far = ", ".join(f"{name} {about(value, 2)}" for name, value in zip(CAMERA_NUMBERS, each.tolist(), strict=True))
        lens = f"the camera's numbers are in {shape} of half-widths {far}"
    else:
        lens = "the camera is exact"
    widths = exact(target["half_widths"]).max(axis=0)
    scale = float.fromhex(target["scale"])
    plate = f"dots are within {' x '.join(about(v) for v in widths.tolist())} mm" if widths.any() else "dots are exact"
    size = f"within {about(100.0 * scale)} %" if scale else "exact"
    return f"{seen} is within {reach} px{but}; {lens}; {plate}, the plate's size is {size}"


def _proved(one: PoseSetChecked) -> str:
    if one.refused is not None:
        return f"REFUSED, {one.refused}"
    but = f" but at most {one.outliers}" if one.outliers else ""
    count = f"{len(one.certificates)} certificates, assumptions SHA-256 {one.digest[:16]}"
    if one.radii is None:
        return f"no pose shows all {one.dots} dots{but} in their boxes of pixels: PROVED, {count}"
    position = " x ".join(at_most(float(v), 3) for v in one.radii[:3])
    turn = " x ".join(at_most(degrees(float(v)), 3) for v in one.radii[3:])
    sides = f"{position} mm and {turn} degrees"
    return f"all poses that show all {one.dots} dots{but} are within {sides} of the stated one: PROVED, {count}"


def _same_source(path: Path, found: Sequence[PoseSetChecked], talk: Talk) -> bool:
    """Whether a file is the one that all pose sets name, byte for byte."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError([Problem(str(path), f"cannot be read: {error.strerror}", "name a file")]) from None
    stated = {sha for one in found for name, sha in one.files if name == path.name}
    if stated == {digest}:
        talk.say(f"{path.name}: the file that the pose sets name, by its SHA-256")
        return True
    what = "no pose set names it" if not stated else "it is another file than the pose sets name: its SHA-256 differs"
    talk.say(f"{path.name}: REFUSED, {what}")
    return False
