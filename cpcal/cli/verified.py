"""`cpcal verify` of a folder, where the checker alone does not do: what is computed again with arrays, and tables."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction as F
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpcal.checker import Refused
from cpcal.checker.run import LegChecked, RobustChecked
from cpcal.cli.claims import NothingCertifiedError, Statement, told
from cpcal.common.documents import JSON_MAX, json_object, unguarded
from cpcal.common.errors import InputError, PluginError, Problem
from cpcal.common.files import small_file
from cpcal.common.numbers import about, at_least, at_most
from cpcal.common.values import Json
from cpcal.files import load_campaign_json
from cpcal.models import leg_model
from cpcal.questions import INFORMATION, RESULT_NAME, Result, Uncertified, load_result, verdict_of
from cpcal.questions.data_check import determination
from cpcal.report.words import notices, overall
from cpcal.robot import Campaign
from cpcal.robot.units import AXES, POSE
from cpcal.solver.contract import Verdict

if TYPE_CHECKING:
    from cpcal.checker.sight import PoseSetChecked

_AGAIN = {  # what to do about a run in which no leg is certified
    Uncertified.INTERRUPTED: "again, without a limit that ends it too early",
    Uncertified.UNWRITTEN: "again, into a folder that has room",
    Uncertified.UNCHECKABLE: "fewer measurements at a time",
}


# ------------------------------------------------------------------------------------------------------------------
# A run of legs.


def of_run(run: Path, checked: Callable[[], list[LegChecked]], *, verbose: bool) -> Iterator[Statement]:
    """What is accepted of a run; `checked` gives its legs; `verbose`: what nobody proves, too.

    Raises InputError, Refused.
    """
    result, legs = read(load_result, run), checked()
    campaign = load_campaign_json(run, checked=True)
    for sentence in _stated_otherwise(campaign, result):
        yield False, f"{RESULT_NAME}: REFUSED, {sentence}"
    if missing := notices(result, campaign.legs):
        yield True, missing
    for leg, found in zip(legs, result.legs, strict=True):
        if leg.refused is not None:
            yield False, f"leg {leg.leg}: REFUSED, {leg.refused}"
        elif leg.robust is not None:
            yield True, f"leg {leg.leg}, at most {leg.robust.outliers} wrong: {'; '.join(_outliers(leg.robust))}"
        elif found.bracket.certificate is None:
            yield True, f"leg {leg.leg}: NOT CERTIFIED, {found.not_certified}"
        yield from (told(name, accepted) for name, accepted in leg.proofs)
        if found.ranges is not None and found.ranges.certificate is None:
            yield True, f"leg {leg.leg}: its ranges are NOT CERTIFIED"
    if verbose:
        yield True, INFORMATION
    if not any(leg.refused or leg.robust for leg in legs) and all(f.bracket.certificate is None for f in result.legs):
        remedy = next((_AGAIN[found.not_certified] for found in result.legs if found.not_certified in _AGAIN), "again")
        raise NothingCertifiedError([Problem(str(run), "holds no leg that is certified", f"certify {remedy}")])


def verdict_words(run: Path) -> str:
    """The verdict on the robot, and the legs that it is of."""
    result = load_result(run)
    if (every := overall(result)) is None:
        return "no tolerance was given, so nothing passes or fails"
    open_ = ", ".join(str(leg.leg) for leg in result.legs if not leg.certified)
    those = [str(leg.leg) for leg in result.legs if verdict_of(result, leg).kind == every.kind]
    legs = "" if every.word == "PASS" else f" (leg {', '.join(those)})" * bool(those)
    return f"verdict: {every.word}{legs}" + f", not certified for leg {open_}" * bool(open_)


def read(load: Callable[[Path], Any], folder: Path) -> Any:
    """Raises Refused: a file that is garbled states nothing."""
    try:
        return load(folder)
    except InputError as error:
        raise Refused("; ".join(problem.what for problem in error.problems), "run", 0) from None


def _outliers(leg: RobustChecked) -> Iterator[str]:
    """What is proved of a leg of whose measurements some may be wrong."""
    if leg.lo is not None:
        yield f"PROVED, eps >= {at_least(leg.lo, 7)} mm by {leg.proofs} certificates"
    if leg.hi is not None:
        yield f"PROVED, eps <= {at_most(leg.hi, 7)} mm, leaving out {', '.join(leg.left_out) or 'none'}"


def _stated_otherwise(campaign: Campaign, result: Result) -> Iterator[str]:
    """Sentences on what the campaign and the model do not give as the result states it.

    The verdict on a leg depends on it. A model that is not known here cannot be compared.
    """
    try:
        model = leg_model(result.model.name)
    except (InputError, PluginError):
        return
    if [(p.name, p.unit) for p in result.model.extra] != [(p.name, p.unit) for p in model.extra]:
        yield "states another leg model than the one of that name"
        return
    for leg in result.legs:
        if leg.leg > campaign.legs:
            yield f"names leg {leg.leg}, which the campaign has not"
            continue
        found: object = None  # what the campaign leaves open at the proved point, or the center
        if result.options.delta != 0.0:
            kept = campaign
            if leg.bracket.left_out:
                kept = campaign.rows(np.isin(campaign.measurement_ids, leg.bracket.left_out, invert=True))
            try:
                with np.errstate(all="ignore"):
                    found = determination(kept, leg.leg, np.array(leg.bracket.point or leg.center), model)
            except np.linalg.LinAlgError:
                found = "of a point that is too far away"
        if leg.determination != found:
            yield f"states other parameters of leg {leg.leg} as undetermined than the campaign leaves open"
        elif result.options.center == "nominal" and leg.bracket.center != tuple(campaign.robot.parameters[leg.leg - 1]):
            yield f"states another center of the box of leg {leg.leg} than the nominal parameters"


# ------------------------------------------------------------------------------------------------------------------
# Pose sets, from their pixels on.

TABLE = "sets.csv"
NUMBERS = (*POSE, *(f"d{axis}" for axis in AXES))  # of it


def of_pose_sets(target: Path) -> Iterator[Statement]:
    """What is accepted of one claim or a folder of them. Raises Unusable where there is nothing to check."""
    from cpcal.checker.sight import check_pose_set, check_pose_sets  # the other kinds start sooner without

    found = check_pose_sets(target) if target.is_dir() else [check_pose_set(target)]
    said = [(one.refused is None, f"{one.name}: {_set_proved(one)}") for one in found]
    if (target / TABLE).is_file() and (wrong := _table_problem(target / TABLE, found)):
        said.append((False, f"{TABLE}: REFUSED, {wrong}"))
    yield from said
    if all(accepted for accepted, _ in said):
        yield from ((True, sentence) for sentence in assumptions(target))


def _table_problem(path: Path, found: Sequence[PoseSetChecked]) -> str:
    """What the table of a folder states that its claims do not; "" where both agree, number by number."""
    from cpcal.models.sight import stem_of

    content = small_file(path, "", most=JSON_MAX)
    claims = {}
    for one in found:
        if one.radii is not None:
            claims[one.name] = Verdict.PROVED.value, [*one.pose, *one.radii]
        elif one.refused is None:
            claims[one.name] = Verdict.REFUTED.value, []
    try:
        for row in csv.DictReader(content.decode().splitlines(), strict=True):
            numbers = [F(float(row[column])) for column in NUMBERS if row[column]]
            if (row["verdict"], numbers) != claims.pop(stem_of(unguarded(row["file"])), ("unknown", [])):
                return f"{row['file']}: its verdict and numbers are not those of a claim that is proved"
    except (ValueError, KeyError, TypeError, OverflowError, csv.Error) as error:
        return f"is no table of pose sets: {error!s:.100}"
    return f"it leaves out {min(claims)}" if claims else ""


def assumptions(target: Path) -> list[str]:
    """What the claims of a folder, or one claim, assume of camera, plate and pixels."""
    from cpcal.models.sight import SUFFIX

    files = sorted(target.glob(f"*{SUFFIX}")) if target.is_dir() else [target]
    said = sorted({_assumed(json_object(file, "name a claim", "name a claim")) for file in files})
    return [f"Assumed, not proved: {sentence}" for sentence in said]


def _assumed(claim: Json) -> str:
    """Floats that the claim holds, in print: they are given, and nothing is rounded to a side."""
    from cpcal.vision.camera import CAMERA_NUMBERS

    pixels, camera, target = (claim["inputs"][key] for key in ("pixels", "camera", "target"))
    exact = np.vectorize(float.fromhex, otypes=[np.float64])
    reach = about(float((exact(pixels["hi"]) - exact(pixels["lo"])).max()) / 2.0)
    seen = "the centre of each dot's image" if pixels["of"] == "images" else "the image of each dot's centre"
    but = f", but of at most {claim['outliers']} dots" * bool(claim["outliers"])
    spread = exact(camera["spread"])
    if spread.size:
        each = np.linalg.norm(spread, axis=1)
        far = ", ".join(f"{name} {about(value, 2)}" for name, value in zip(CAMERA_NUMBERS, each.tolist(), strict=True))
        lens = f"the camera's numbers are in an ellipsoid of half-widths {far}"
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
