"""`cpcal verify` of a folder, where the checker alone does not do: what is computed again with arrays, and tables."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction as F
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpcal.checker import Refused, RobustChecked, Unusable
from cpcal.checker.platform import check_accuracy
from cpcal.cli.verify import Legs, Statement, of_folder, result_of, runs_in, told
from cpcal.common.errors import InputError, PluginError, Problem, Problems
from cpcal.common.numbers import about, at_least, at_most
from cpcal.common.values import Floats
from cpcal.files import load_campaign_json
from cpcal.files.run_folder import REPORT_NAME, unfinished
from cpcal.files.tables import JSON_MAX, json_object, small_file, unguarded
from cpcal.models import LegModel, Parameter, leg_model
from cpcal.questions import (
    INFORMATION,
    RESULT_NAME,
    LegResult,
    Result,
    Uncertified,
    information,
)
from cpcal.questions.accuracy import ACCURACY_NAME, load_accuracy
from cpcal.questions.data_check import determination
from cpcal.report.words import notices
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict

if TYPE_CHECKING:
    from cpcal.checker.sight import PoseSetChecked

_AGAIN = {  # what to do about a run in which no leg is certified
    Uncertified.INTERRUPTED: "again, without a limit that ends it too early",
    Uncertified.UNWRITTEN: "again, into a folder that has room",
    Uncertified.UNCHECKABLE: "fewer measurements at a time",
}


# a run ----------------------------------------------------------------------------------------------------------------


def of_run(run: Path, checked: Callable[[], Legs]) -> Iterator[Statement]:
    """What is accepted of a run; `checked` gives its legs. Raises InputError."""
    if unfinished(run):
        yield True, "Another run into this folder is at work, or was killed: these are the answers before it."
    result = result_of(run)
    legs = result if isinstance(result, str) else checked()
    if isinstance(legs, str) or isinstance(result, str):
        yield False, f"{RESULT_NAME}: REFUSED, {legs}"
        return
    campaign = load_campaign_json(run)
    for sentence in stated_otherwise(campaign, result):
        yield False, f"{RESULT_NAME}: REFUSED, {sentence}"
    if (missing := notices(result, campaign.legs)) is not None:
        yield True, missing
    for leg, found in zip(legs, result.legs, strict=True):
        if leg.refused is not None:
            yield False, f"leg {leg.leg}: REFUSED, {leg.refused}"
        elif leg.robust is not None and leg.robust.certified:
            yield True, f"leg {leg.leg}, at most {leg.robust.outliers} wrong: {'; '.join(_outliers(leg.robust))}"
        elif leg.accepted is None:
            yield True, f"leg {leg.leg}: NOT CERTIFIED, {found.not_certified}"
        ranges = None if found.ranges is None else found.ranges.certificate
        support = None if found.support.proof is None else found.support.proof.certificate
        for name, accepted in ((leg.certificate, leg.accepted), (support, leg.support), (ranges, leg.ranges)):
            if accepted is not None and name is not None:
                yield from told(name, accepted)
        if found.ranges is not None and ranges is None:
            yield True, f"leg {leg.leg}: its ranges are NOT CERTIFIED"
        yield from ((True, f"leg {leg.leg}: {sentence}") for sentence in information(result.options, found))
    yield True, INFORMATION
    if (run / REPORT_NAME).exists():
        yield True, f"{REPORT_NAME} is not read here: `cpcal report` checks a run and writes its page again."
    if not any(leg.accepted or leg.refused or (leg.robust and leg.robust.certified) for leg in legs):
        remedy = next((_AGAIN[found.not_certified] for found in result.legs if found.not_certified in _AGAIN), "again")
        raise InputError([Problem(str(run), "holds no leg that is certified", f"certify {remedy}")])


def _outliers(leg: RobustChecked) -> Iterator[str]:
    """What is proved of a leg of whose measurements some may be wrong."""
    if leg.lo is not None:
        yield f"PROVED, eps >= {at_least(leg.lo, 7)} mm by {leg.proofs} certificates"
    if leg.hi is not None:
        yield f"PROVED, eps <= {at_most(leg.hi, 7)} mm, leaving out {', '.join(leg.left_out) or 'none'}"


def stated_otherwise(campaign: Campaign, result: Result) -> Iterator[str]:
    """Sentences on what the campaign and the model do not give as the result states it.

    The verdict on a leg depends on it. A model that is not known here cannot be compared.
    """
    model = _known(result.model.name)
    if model is None:
        return
    if _units(result.model.extra) != _units(model.extra):
        yield "states another leg model than the one of that name"
        return
    for leg in result.legs:
        if leg.leg > campaign.legs:
            yield f"names leg {leg.leg}, which the campaign has not"
        elif leg.determination != (
            None if result.options.outliers else _determined(campaign, leg.leg, _at(leg), model, result.options.delta)
        ):
            yield f"states other parameters of leg {leg.leg} as undetermined than the campaign leaves open"
        elif result.options.center == "nominal" and leg.bracket.center != tuple(campaign.robot.parameters[leg.leg - 1]):
            yield f"states another center of the box of leg {leg.leg} than the nominal parameters"


def _at(leg: LegResult) -> Floats:
    return np.array(leg.center if leg.bracket.point is None else leg.bracket.point)


def _known(name: str) -> LegModel | None:
    try:
        return leg_model(name)
    except (InputError, PluginError):
        return None


def _units(extra: tuple[Parameter, ...]) -> list[tuple[str, str]]:
    return [(p.name, p.unit) for p in extra]


def _determined(campaign: Campaign, leg: int, at: Floats, model: LegModel, delta: float) -> object:
    if delta == 0.0:
        return None
    try:
        with np.errstate(all="ignore"):
            return determination(campaign, leg, at, model)
    except np.linalg.LinAlgError:
        return "of a point that is too far away"


# accuracy.json --------------------------------------------------------------------------------------------------------


def of_accuracy(folder: Path) -> Iterator[Statement]:
    """What is accepted of a folder that `cpcal accuracy` wrote. Raises InputError."""
    try:
        load_accuracy(folder)
        yield from check_accuracy(folder)
    except Unusable as reason:
        raise InputError([Problem(str(folder), str(reason), "run cpcal accuracy again")]) from None
    except (InputError, Refused) as reason:
        said = reason.problems[0].what if isinstance(reason, InputError) else reason
        yield False, f"{ACCURACY_NAME}: REFUSED, {str(said).removeprefix(f'{ACCURACY_NAME} ')}"


# a folder of runs: of many campaigns, or of one in several models -----------------------------------------------------


def of_runs(folder: Path) -> Iterator[Statement]:
    """Each run of a folder, and the table of many campaigns. Raises InputError."""
    from cpcal.report.comparison_page import (  # what this kind of folder needs; the others start sooner
        SUMMARY_TABLE,
        row_of,
        summary_table,
    )

    rows, table = [], folder / SUMMARY_TABLE
    for run in runs_in(folder):
        yield True, f"{run.name}:"
        yield from of_folder(run)
        found = result_of(run)
        rows += [] if isinstance(found, str) or not found.legs else [row_of(run.name, found)]
    if table.exists() and table.read_bytes() != summary_table(rows).encode():
        yield False, f"{SUMMARY_TABLE}: REFUSED, it is not the table of these runs"


# ------------------------------------------------------------------------------------------------------------------
# `cpcal verify` of pose sets, from their pixels on.

TABLE = "sets.csv"
NUMBERS = ("x", "y", "z", "qw", "qx", "qy", "qz", "dx", "dy", "dz", "drx", "dry", "drz")  # of it


def of_pose_sets(target: Path, sources: Sequence[Path]) -> Iterator[Statement]:
    """What is accepted of one claim or a folder of them. Raises InputError where there is nothing to check."""
    from cpcal.checker.sight import check_pose_set, check_pose_sets  # the other kinds start sooner without

    try:
        found = check_pose_sets(target) if target.is_dir() else [check_pose_set(target)]
    except Unusable as reason:
        raise InputError([Problem(str(target), str(reason), "name what `cpcal image sets` wrote")]) from None
    yield from ((one.refused is None, f"{one.name}: {_set_proved(one)}") for one in found)
    good = all(one.refused is None for one in found)
    if (target / TABLE).is_file() and (wrong := _table_problem(target / TABLE, found)):
        good = False
        yield False, f"{TABLE}: REFUSED, {wrong}"
    if good:
        yield from ((True, sentence) for sentence in assumptions(target))
    yield from (_same_source(path, found) for path in sources)


def _table_problem(path: Path, found: Sequence[PoseSetChecked]) -> str:
    """What the table of a folder states that its claims do not; "" where both agree, number by number."""
    from cpcal.models.sight import stem_of

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


def assumptions(target: Path) -> list[str]:
    """What the claims of a folder, or one claim, assume of camera, plate and pixels."""
    from cpcal.models.sight import SUFFIX

    files = sorted(target.glob(f"*{SUFFIX}")) if target.is_dir() else [target]
    said = sorted({_assumed(json_object(file, "name a claim", "name a claim")) for file in files})
    return [f"Assumed, not proved: {sentence}" for sentence in said]


def _assumed(claim: dict[str, Any]) -> str:
    """Floats that the claim holds, in print: they are given, and nothing is rounded to a side."""
    from cpcal.vision.camera import CAMERA_NUMBERS

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


def _set_proved(one: PoseSetChecked) -> str:
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


def _same_source(path: Path, found: Sequence[PoseSetChecked]) -> Statement:
    """Whether a file is the one that all pose sets name, byte for byte."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError([Problem(str(path), f"cannot be read: {error.strerror}", "name a file")]) from None
    stated = {sha for one in found for name, sha in one.files if name == path.name}
    if stated == {digest}:
        return True, f"{path.name}: the file that the pose sets name, by its SHA-256"
    what = "no pose set names it" if not stated else "it is another file than the pose sets name: its SHA-256 differs"
    return False, f"{path.name}: REFUSED, {what}"
