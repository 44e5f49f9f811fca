"""The certified answer to a hand-eye study: eps* between two bounds, ranges of the frames, least squares judged."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction as F
from pathlib import Path
from typing import Annotated

import numpy as np

from cpcal.checker.bounds import between, matrix
from cpcal.checker.files import HAND_EYE_NAME
from cpcal.checker.frames import GIVEN, R_F, R_X, SIZE, T_F, T_X, holds, rotation, unit
from cpcal.checker.hand_eye import (
    BEYOND,
    HAND_EYE_FORMAT,
    HandEyeCertificates,
    errors,
    known_point,
    parameter_ranges,
    run_budget,
)
from cpcal.checker.polynomial import applied, plus
from cpcal.checker.readers import Refused, up
from cpcal.common.codec import Document, Informed, checked
from cpcal.common.errors import InputError, refuse, unusable
from cpcal.common.numbers import at_least, at_most
from cpcal.common.values import ArrayPair, Names, Numbers, Quaternion, Texts, Vector
from cpcal.common.version import __version__
from cpcal.models.frames import COARSE, PlacedFrames, Proof, Prover, Tell, exact
from cpcal.models.hand_eye import HandEyeStudy, Known, load_study_json
from cpcal.models.hand_eye_fit import (
    FEWEST,
    best_frames,
    classical_answer,
    least_error,
    least_errors,
    opencv_answers,
    stated_readings,
    trimmed_fit,
)
from cpcal.questions.result import Result
from cpcal.solver.interval.numbers import round_down, round_up

Reading = Numbers  # of a pose: d in mm and w in rad, see `cpcal.models.hand_eye`

# ------------------------------------------------------------------------------------------------------------------
# The answer to a hand-eye study, as plain values.

_STUDY, _AGAIN, _ASKED = map(checked, ("the study", "computed again, exactly", "the box of the certificates"))
_FILE = checked("a file of the run, which is accepted, and so are those that it rests on")
_LARGEST = checked(
    "the largest error at the point is computed again, exactly, and is `eps_hi`; the point in the box, readings within "
    "half-widths"
)
_LEAST_SQUARES = checked("least squares, computed again: a thousandth of the half-widths apart at most, and in them")
_CENTER = checked(
    "least squares, computed again without the images left out: a thousandth of its deviations, or of the box, apart "
    "at most; and the box of the certificates"
)
_GROUP = checked("no so many images as `outliers` meet all groups; the certificate speaks of no others")
_BLAMED = checked("images left out, each once, and in all of its groups; these as `lower`, at `eps`")

PARAMETERS = tuple(f"{frame} {name}" for frame in ("camera", "target") for name in ("x", "y", "z", "rx", "ry", "rz"))


REACH = 2000.0  # mm: the box around the classical positions


@dataclass(frozen=True)
class Within:
    """A box about frames: positions within `reach` mm on each axis, rotations within `angle` degrees (None: any).

    `known`: what you know, such as ("camera.z", -10.0, 10.0): a position in mm of the camera in the hand (eye in hand)
    or base frame, or of the "target" in the other one, or a tilt in degrees, between the z axes of the two. It takes
    the place of reach and angle, and is not proved.

    Raises InputError for a reach or an angle that is none, and for known values that are none.
    """

    reach: Annotated[float, _ASKED] = REACH
    angle: Annotated[float | None, _ASKED] = None
    known: Annotated[Known, _ASKED] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.reach < 1e6 or (self.angle is not None and not 0.0 < self.angle <= 180.0):
            what = f"has an angle of {self.angle} degrees and a reach of {self.reach} mm"
            remedy = "give degrees up to 180 and mm above 0, such as 60,1000; or any,2000 for any rotation"
            raise unusable("the box", what, remedy)
        for name, low, high in self.known:
            least, most = (-1e6, 1e6) if unit(name) == "mm" else (0.0, 180.0)
            if name not in GIVEN or not least <= low < high <= most or [one for one, *_ in self.known].count(name) > 1:
                what = f"has {name} from {low} to {high} {unit(name)}"
                remedy = f"give each of {', '.join(GIVEN)} once, the least value first, tilts from 0 to 180 degrees"
                raise unusable("the box", what, remedy)

    @staticmethod
    def parsed(text: str, known: str = "") -> Within:
        """Of `DEGREES,MM`, or `any,MM`, and of known values, `camera.z=LOW:HIGH,...`. Raises InputError."""
        given = []
        for part in filter(None, known.split(",")):
            name, _, ends = part.partition("=")
            try:
                low, high = map(float, ends.split(":"))
            except ValueError:
                remedy = "give mm, or degrees of tilts, such as camera.z=-10:10,target.tilt=0:5"
                raise unusable("option --known", f"is {known!r:.60}", remedy) from None
            given.append((name.strip(), low, high))
        try:
            angle, reach = (part.strip() for part in text.split(","))
            return Within(float(reach), None if angle == "any" else float(angle), tuple(given))
        except ValueError:
            remedy = "give degrees and mm, such as 60,1000; or any,2000 for any rotation"
            raise unusable("option --within", f"is {text!r:.60}", remedy) from None


@dataclass(frozen=True, kw_only=True)
class AskedBox(Within):
    """The box of frames that everything speaks of, about the least-squares answer."""

    center: Annotated[PlacedFrames, _CENTER]

    @property
    def positions(self) -> Known:
        """What is known, and the ends of all other positions."""
        given, far = [name for name, *_ in self.known], self.reach * (1.0 - 1e-9)
        places = (*self.center.camera_position, None, *self.center.target_position, None)
        ends = ((name, at - far, at + far) for name, at in zip(GIVEN, places, strict=True) if at is not None)
        return *self.known, *(end for end in ends if end[0] not in given)


_POINT = checked("computed again from `lo`, `hi`, `point` and the certificate's `hand`, exactly")
_ENDS = checked("computed again from `lo`, `hi` and `point`, exactly")
_CLAIM = checked("the claim of `ranges.certificate`")


@dataclass(frozen=True)
class KnownPoint:
    """PROVED: frames of the ranges put the point `at` (mm, in the camera frame) at most `place` mm from where the point
    of the result does, in the hand frame (eye in hand) or the base frame; the camera is turned from there by at most
    `turn` degrees, 180 where nothing is known."""

    at: Annotated[Vector, checked("what was asked")]
    place: Annotated[float, _POINT]
    turn: Annotated[float, _POINT]


@dataclass(frozen=True)
class FrameRanges:
    """PROVED: frames in the box that explain every pixel to within `eps` px of the result have these parameters.

    In the order of PARAMETERS: positions in mm, and the rotation vector in degrees by which a frame is turned from that
    of the point (in base or hand coordinates); 180 either way where nothing is known. `lo`, `hi` (30): of the unknowns.
    Without numbers there are no such frames. `known`: what that says of a point before the camera. `certificate`: the
    file that claims it.
    """

    low: Annotated[Numbers, _ENDS]
    high: Annotated[Numbers, _ENDS]
    lo: Annotated[Numbers, _CLAIM]
    hi: Annotated[Numbers, _CLAIM]
    known: KnownPoint | None
    certificate: Annotated[str, _FILE]

    def __post_init__(self) -> None:
        sizes = len(self.low), len(self.high), len(self.lo), len(self.hi)
        full = (len(PARAMETERS), len(PARAMETERS), SIZE, SIZE)
        if sizes != ((0, 0, 0, 0) if self.known is None else full):
            raise ValueError(f"ranges are not of {len(PARAMETERS)} parameters and {SIZE} unknowns, and of a point")

    @property
    def empty(self) -> bool:
        return not self.lo

    def hold(self, camera: OtherAnswer) -> bool:
        """Whether the ranges hold a camera, exactly. Where not, no frames with it explain every pixel to `eps`."""
        rows, norm = rotation(tuple(map(F, camera.quaternion)))
        turn, place = [F(v, norm) for row in rows for v in row], [F(v) for v in camera.position]
        return all(self.lo[i] <= v <= self.hi[i] for i, v in zip((*R_X, *T_X), (*turn, *place), strict=True))


@dataclass(frozen=True)
class OtherAnswer:
    """The camera in the hand (eye in hand) or base frame, mm, by a method of OpenCV. Nothing of it is proved."""

    method: str
    position: Vector
    quaternion: Quaternion


@dataclass(frozen=True)
class ImageVerdict:
    """The least-squares answer in one image: its largest excess in px, exactly, rounded up; `ok`: to within `eps`.

    None where points lie behind the camera, in an image that is left out. At the answer's own reading of an uncertain
    pose: another reading may do better.
    """

    image: Annotated[str, _STUDY]
    largest: Annotated[float | None, _AGAIN]
    ok: Annotated[bool, _AGAIN]


@dataclass(frozen=True)
class Classical:
    """The least-squares answer, `asked.center`, judged; `largest`: its largest excess in the images that are not left
    out, exactly, rounded up.

    `readings`: of the robot's poses, image by image, where these are uncertain.
    """

    readings: Annotated[tuple[Reading, ...], _LEAST_SQUARES]
    largest: Annotated[float, _AGAIN]
    images: tuple[ImageVerdict, ...]


@dataclass(frozen=True)
class RefutedGroup:
    """PROVED: no frames in the box explain these images to within the tolerance of what the group is for."""

    images: Annotated[Names, _GROUP]
    certificate: Annotated[str, _FILE]


@dataclass(frozen=True)
class HandEyeResult:
    """eps* lies in [eps_lo, eps_hi] px, when at most `outliers` images may be wrong.

    PROVED: whichever so many are left out, no frames in the box explain every pixel of the others to within `eps_lo`,
    where that is above 0 (`lower`); `point` explains every one but those of the images `left_out` to within `eps_hi`
    (exact arithmetic), at the `readings` of uncertain poses, image by image. `support`: image and point of each pixel
    row with a weight in the last steps of `lower`. Each image of `blamed` is wrong if right ones fit to `eps`; the
    others of `left_out` may be right. `ranges` are sought where no image may be wrong.

    `tolerance`: px, that was asked for; `eps`: what ranges and verdicts speak of. `gap`: relative, that was asked for.
    `others`: OpenCV's answers beside `ranges`, where it is installed and has such methods.
    Of the least-squares answer `rms` (px per axis), `sigma` (in the order of E and F of `ClassicalAnswer.covariance`)
    and `remarks`. `provenance`: the study's. `programs`: linear ones that were solved. `timed`: the time limit ended
    a search.
    """

    setup: Annotated[str, _STUDY]
    images: Annotated[int, _STUDY]
    points: Annotated[int, _STUDY]
    asked: AskedBox
    outliers: Annotated[int, checked("so many are left out, and each claim has a group more")]
    left_out: Annotated[Names, checked("images of the study; all others are explained by the point")]
    eps_lo: Annotated[float, checked("that of the certificates of `lower`; 0 without these")]
    eps_hi: Annotated[float, _LARGEST]
    point: Annotated[PlacedFrames, _LARGEST]
    readings: Annotated[tuple[Reading, ...], _LARGEST]
    lower: tuple[RefutedGroup, ...]
    support: Annotated[tuple[tuple[str, str], ...], checked("the last steps of the certificates of `lower`")]
    tolerance: Annotated[float | None, checked("`eps`")]
    eps: Annotated[
        float, checked("`tolerance`, or 1.1 or 1.01 `eps_hi` without one; certificates of ranges and `blamed`")
    ]
    ranges: FrameRanges | None
    classical: Classical
    blamed: Annotated[tuple[tuple[str, tuple[RefutedGroup, ...]], ...], _BLAMED]
    others: Informed[tuple[OtherAnswer, ...]]
    provenance: Informed[Texts]
    version: Informed[str]
    gap: Informed[float]
    rms: Informed[float]
    sigma: Informed[Numbers]
    remarks: Informed[Names]
    programs: Informed[int]
    timed: Informed[bool]
    seconds: Informed[float]

    @property
    def complete(self) -> bool:
        """Whether the bracket is as narrow as asked."""
        return self.eps_hi - self.eps_lo <= self.gap * max(self.eps_hi, 1e-6)

    @property
    def passes(self) -> bool | None:
        """Whether some frames explain every pixel to the tolerance; None where that is open, or was not asked."""
        if self.tolerance is None:
            return None
        if self.eps_hi <= self.tolerance:
            return True
        refuted = self.ranges is not None and self.ranges.empty
        return False if refuted or self.eps_lo >= self.tolerance > 0.0 else None


_DOCUMENT = Document(HandEyeResult, HAND_EYE_NAME, HAND_EYE_FORMAT, "run cpcal handeye certify again")
save_hand_eye_result, load_hand_eye_result = _DOCUMENT.save, _DOCUMENT.load


# ------------------------------------------------------------------------------------------------------------------
# The certified answer: eps* between two bounds, ranges of the parameters, verdicts of the classical answer.
#
# S(eps) = { (X, F) in the box : for every point a pixel within its half-width is met to within eps on both axes }
# eps*   = min { eps : S(eps) is not empty }
#
# Up to q images may be wrong: a slipped board, a wrong robot pose. Let q + 1 groups of images have no image in common.
# If q images are wrong, some group holds none of them. So
#
# - eps_lo: when no frames explain any one of the groups to eps_lo, none explain all images but some q to it.
# - an image k is wrong (at a tolerance) when no frames explain any one of q + 1 groups together with k to the
#   tolerance: were k right, each of these groups would hold a wrong image, which makes q + 1.
#
# With q = 0 there is one group: all images.

GAP = 1e-6
LOWER, RANGES, WRONG = "lower", "ranges", "wrong"  # with which the names of certificates begin
_FARTHEST = 1e6  # mm: of a point before the camera
_NOTHING = 1e-12  # px: what rounding leaves of pixels that fit exactly
_SHARES = (0.0, 1e-4, 1e-2, 0.1)  # below eps_hi: tolerances that are tried for the lower end
_NEAR = (0.0, 1e-6, 1e-4, 1e-2)  # the same below the least error of a single image
_BETWEEN = (0.95, 0.7, 0.4)  # of the way from there to eps_hi: what all images may refute
_GROUP_SHARES = (0.999, 0.97, 0.9, 0.7)  # of the least error of the groups: what is tried to prove
_NEAR_LIMIT = 40  # units of work a byte of certificates, twice what most take (9 to 18 were seen)

_Refuted = list[tuple[RefutedGroup, Proof]]


def certify_hand_eye(
    study: HandEyeStudy,
    *,
    outliers: int = 0,
    within: Within | None = None,
    tolerance: float | None = None,
    gap: float = GAP,
    certificates: Path | None = None,
    time_limit: float = math.inf,
    at: Sequence[float] | None = None,
    seed: int = 0,
    tell: Tell = lambda text: None,
) -> HandEyeResult:
    """Bracket eps* of a study, and the ranges of its parameters; or prove which images are wrong.

    outliers      how many images may be wrong, nobody knows which; then no ranges are sought
    within        the box; default any rotation, positions within 2 m of the classical answer on each axis
    tolerance     px: are there frames that explain every pixel to it, and in which ranges; which images are wrong at
                  it? Default: 1.1 times the upper end of the bracket, 1.01 where that leaves
                  a turn open
    gap           relative width of the bracket that is asked for
    certificates  a folder that exists, for `lower.cert.jsonl`, `ranges.cert.jsonl` and those that these rest on
    time_limit    seconds for each of the proofs; what is proved until then is stated
    at            mm, in the camera frame: how well a point there is known; default on its axis, as far away as the
                  target was on average
    seed          of the places and the images that fits begin with

    Raises InputError for a point that is none, for studies without a classical answer, for one whose points lie outside
    of the box or, where values are known, behind the camera, and for fewer than four images a group.
    """
    began, every = time.monotonic(), range(len(study.images))
    wrong, most = tolerance is not None and not 0.0 <= tolerance < math.inf, max(len(every) // FEWEST - 2, 0)
    nowhere = at is not None and (len(at) != 3 or not np.abs(at).max() < _FARTHEST)
    more = f"these images do for at most {most}: each further one takes {FEWEST} images more"
    refuse(
        (wrong, "tolerance", f"is {tolerance}", "give pixels, from 0"),
        (nowhere, "point before the camera", f"is {at}", "give x, y, z in the camera frame, mm"),
        (not 0 <= outliers <= most, "outliers", f"is {outliers} of {len(every)} images", more),
    )
    searched = within or Within()
    study = replace(study, known=searched.known)
    random = np.random.default_rng(seed)
    left = trimmed_fit(study, outliers, random) if outliers else []
    kept = [k for k in every if k not in left]
    part = study.part(np.array(kept)) if left else study
    classical = classical_answer(part)
    best = best_frames(part, classical, random)
    asked = AskedBox(searched.reach, searched.angle, searched.known, center=PlacedFrames.of(classical.frames))
    point, angle = PlacedFrames.of(best.frames, study.given), None if asked.angle is None else F(asked.angle)
    box = asked.center.numbers, F(asked.reach), angle, [(name, F(low), F(high)) for name, low, high in asked.known]
    if not holds(point.numbers, *box):  # a direction that the motions hardly determine may lead out of it
        near = replace(part, known=asked.positions)
        best = best_frames(near, classical, random)
        point = PlacedFrames.of(best.frames, near.given)
    if not holds(point.numbers, *box):
        raise unusable("option --within", "leaves out the best frames found", "give a larger box")
    readings, own = (stated_readings(study, kept, of.readings) for of in (best, classical))
    groups = [list(every[k :: outliers + 1]) for k in range(outliers + 1)]
    with_one = {k: [sorted([*kept[n :: outliers + 1], k]) for n in range(outliers + 1)] for k in left}
    least = min(least_error(study, group) for group in groups) if outliers else 0.0
    worst = max(least_errors(study, classical.alone.images, best)) if study.uncertain and not outliers else None
    others = {} if outliers else opencv_answers(part, classical.alone)
    least_with = {k: min(least_error(study, group) for group in some) for k, some in with_one.items()}

    # from here on exact numbers
    prover = Prover(study, asked.center.numbers, asked.reach, asked.angle, best.frames, tell)
    at_point, at_center = (
        errors(prover.exact, placed.numbers, tuple(map(exact, given)))
        for placed, given in ((point, readings), (asked.center, own))
    )
    behind = [study.images[k] for k in kept if at_center[k] is None]
    if behind:
        what = f"puts points of {behind[0]} behind the camera"
        raise unusable("the least-squares answer", what, "check the setup, and the poses")
    eps_hi = max(up(at_point[k] or F(0)) for k in kept)  # the fit keeps all points in front
    tell(f"some frames explain every pixel of {len(kept)} images to {at_most(eps_hi, 7)} px")
    eps, nearer = (share * eps_hi if tolerance is None else tolerance for share in BEYOND)
    wide, end = None, time.monotonic() + time_limit
    if not outliers:
        wide = prover.over(RANGES, every, eps, end)
        if wide.open and not study.uncertain:
            eps = nearer
            wide = prover.over(f"{RANGES}-turns", every, eps, end, wide, COARSE)
    end = time.monotonic() + time_limit
    eps_lo, lower = _lower_end(prover, groups, wide, least, worst, eps_hi, gap, end)
    blamed: dict[int, _Refuted] = {}
    for k, some in with_one.items():
        if least_with[k] > eps:
            reasons = _refuted(prover, f"{WRONG}-{k + 1}", some, eps, math.inf)
            blamed |= {} if reasons is None else {k: reasons}
    verdicts = tuple(
        ImageVerdict(name, None if error is None else up(error), error is not None and error <= F(eps))
        for name, error in zip(study.images, at_center, strict=True)
    )
    support = dict.fromkeys(k for _, proof in lower for side, k in proof.last if side[0] in "uv")
    proofs = [] if wide is None else [wide]
    proofs += [proof for found in (lower, *blamed.values()) for _, proof in found]
    for proof in proofs:
        proof.write(certificates)
    return HandEyeResult(
        setup=study.setup,
        images=len(study.images),
        points=len(study.image),
        asked=asked,
        outliers=outliers,
        left_out=tuple(study.images[k] for k in left),
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        point=point,
        readings=readings,
        lower=tuple(group for group, _ in lower),
        support=tuple((study.images[study.image[k]], study.names[k]) for k in support),
        tolerance=tolerance,
        eps=eps,
        ranges=None if wide is None else _ranges(wide, point, prover.hand, at),
        classical=Classical(own, max(verdicts[k].largest or 0.0 for k in kept), verdicts),
        others=tuple(
            OtherAnswer(name, tuple(camera.position.tolist()), tuple(camera.quaternion.tolist()))
            for name, camera in others.items()
        ),
        blamed=tuple((study.images[k], tuple(group for group, _ in found)) for k, found in blamed.items()),
        provenance=study.provenance,
        version=__version__,
        gap=gap,
        rms=classical.rms,
        sigma=tuple(np.sqrt(np.diagonal(classical.covariance)).tolist()),
        remarks=(*classical.remarks, *([] if certificates is None else _refusal(prover, certificates))),
        programs=sum(proof.programs for proof in proofs),
        timed=any(proof.timed for proof in proofs),
        seconds=time.monotonic() - began,
    )


def _lower_end(
    prover: Prover,
    groups: Sequence[Sequence[int]],
    wide: Proof | None,
    least: float,
    worst: tuple[float, int] | None,
    eps_hi: float,
    gap: float,
    end: float,
) -> tuple[float, _Refuted]:
    """eps_lo and its proofs, a group each; of all images they begin with what `wide` leaves, or with the box.

    `least`: about the least error of the groups; `worst`: of uncertain poses that of the image that fits worst by
    itself, and its number.
    """
    most, found = eps_hi * (1.0 - 0.9 * gap), (0.0, _Refuted())
    if wide is None:
        tried = [(share * least, groups) for share in _GROUP_SHARES]
    elif eps_hi <= _NOTHING:
        tried = []
    elif worst is None:
        tried = [(most * (1.0 - share), groups) for share in _SHARES]
    else:  # that image, then all together
        least = min(most, worst[0])
        tried = [(least * (1.0 - share), [[worst[1]]]) for share in _NEAR]
        tried += [(least + share * (most - least), groups) for share in _BETWEEN if most > least * 1.001]
    if wide is not None and wide.refuted:
        found = wide.eps, [(RefutedGroup(prover.study.images, wide.certificate or ""), wide)]
    for eps, some in tried:
        if eps > found[0] and time.monotonic() <= end:
            proofs = _refuted(prover, LOWER, some, eps, end, wide)
            found = found if proofs is None else (eps, proofs)
    return found


def _refuted(
    prover: Prover, name: str, groups: Sequence[Sequence[int]], eps: float, end: float, wide: Proof | None = None
) -> _Refuted | None:
    """Proofs that no frames explain any of the groups to within eps; None where one is not proved."""
    found = _Refuted()
    for n, group in enumerate(groups, 1):
        file, images = name if len(groups) == 1 else f"{name}-{n}", tuple(prover.study.images[k] for k in group)
        what = f"{len(group)} images" if len(group) > 1 else f"{images[0]} alone"
        prover.tell(f"is there anything below {at_least(eps, 7)} px in {what}?")
        proof = prover.over(file, group, eps, end, wide)
        if not proof.refuted:
            return None
        found.append((RefutedGroup(images, proof.certificate or ""), proof))
    return found


def _refusal(prover: Prover, folder: Path) -> list[str]:
    """In a sentence, why `cpcal verify` will refuse the certificates; they are checked only where it may."""
    try:
        budget = run_budget(len(prover.exact.image))
        run = HandEyeCertificates(folder, prover.exact, prover.digest, budget)
        if _NEAR_LIMIT * sum((folder / name).stat().st_size for name in run.names) > budget.left:
            for name in sorted(run.names):
                run.accepted(name)
    except Refused as refused:
        return [f"`cpcal verify` will refuse this run: {refused.reason}."]
    return []


def _ranges(wide: Proof, point: PlacedFrames, hand: Sequence[F], at: Sequence[float] | None) -> FrameRanges:
    file = wide.certificate or ""
    if wide.left is None:
        return FrameRanges((), (), (), (), None, file)
    if at is None:  # w is where the target's centre was on average, in the hand or base frame
        away = float(point.frames.e_rotation[2] @ np.array(hand, float) + point.frames.e_translation[2])
        at = (0.0, 0.0, float(round(away)))
    x, y, z = map(float, at)
    box = exact(wide.left.lo), exact(wide.left.hi)
    low, high = map(tuple, parameter_ranges(*box, point.numbers))
    known = KnownPoint((x, y, z), *known_point(*box, hand, exact(at), point.numbers))
    lo, hi = (tuple(map(float, side)) for side in box)
    return FrameRanges(low, high, lo, hi, known, file)


# ------------------------------------------------------------------------------------------------------------------
# Runs of `cpcal handeye certify` checked again: what no proof can say.
#
# The checker accepts what is proved. That the centre of the box is the least-squares answer is no matter of proof: that
# answer is computed again here.

_APART = 1e-3  # of the deviations of a least-squares answer, or of the box: how far one computed again may be
_ROUNDING = 1e-6  # mm and rad: the same where pixels fit without error


def verify_center(run: Path) -> tuple[bool, str]:
    """Whether the box's centre is the least-squares answer, and a sentence. Raises InputError."""
    study, found = load_study_json(run, undistorted=True), load_hand_eye_result(run)
    said = "centre: the least-squares answer" + (f" without {', '.join(found.left_out)}" if found.left_out else "")
    refused = _not_least_squares(study, found)
    return not refused, f"centre: REFUSED, {refused}" if refused else said


def _not_least_squares(study: HandEyeStudy, found: HandEyeResult) -> str:
    """Why the box's centre is not the least-squares answer of the images that the point explains; empty if it is."""
    kept = [k for k, name in enumerate(study.images) if name not in found.left_out]
    try:
        with np.errstate(all="ignore"):
            answer = classical_answer(replace(study, known=found.asked.known).part(np.array(kept)))
    except InputError as error:  # what a study must be for its answer to be computed again
        return str(error.problems[0])
    except np.linalg.LinAlgError:
        return "no least squares are found of such numbers"
    turn, place = np.sqrt(np.diagonal(answer.covariance)).reshape(2, 2, 3).max(axis=(0, 2))
    near = F(_APART * min(place, found.asked.reach) + _ROUNDING), F(np.degrees(_APART * min(turn, 1.0) + _ROUNDING))
    if not holds(PlacedFrames.of(answer.frames).numbers, found.asked.center.numbers, *near):
        return "it is not the least-squares answer"
    readings, own = found.classical.readings, stated_readings(study, kept, answer.readings)
    if [len(row) for row in readings] == [6] * len(own):
        off = np.abs(np.array(readings) - np.array(own)) <= _APART * study.pose_half_width if own else np.array(True)
        if off.all():
            return ""
    return "the readings of the poses are not those of least squares"


# ------------------------------------------------------------------------------------------------------------------
# Legs that were certified in the frames of camera and target, in the frames of base and platform.
#
# A campaign that `cpcal calibrate` makes of a robot's study is in the frames of camera and target. Its legs are
#
#     | P + R b - a | = L + l        a: base joint in the camera frame, b: mobile joint in the target frame
#
# so the bracket of eps* of a leg needs no frames, and stays what it is however little is known of them. What the frames
# are for is the joints: X a in the base frame, and F b in the mobile frame. Both are bounded here over all frames that
# the ranges of a hand-eye run hold, in exact arithmetic.

JOINTS = ("base x", "base y", "base z", "mobile x", "mobile y", "mobile z")


def legs_in_frames(run: Result, frames: HandEyeResult) -> dict[int, ArrayPair]:
    """PROVED by a run of `cpcal certify` and one of `cpcal handeye certify` together: lower and upper ends of the
    joints of each leg, mm, in the order of JOINTS, for all frames and all parameters in the ranges of the runs.

    Raises InputError where the camera is not beside the robot, or frames or a leg have no ranges.
    """
    ranges, without = frames.ranges, [leg.leg for leg in run.legs if leg.ranges is None]
    beside, none = frames.setup == "eye-to-hand", ranges is None or ranges.empty
    why = "some images may be wrong" if ranges is None else "nothing explains their pixels"
    refuse(
        (not beside, "frames", f"are of a study {frames.setup}", "give one with the camera beside the robot"),
        (none, "frames", f"have no ranges: {why}", "give a larger tolerance, and leave out --wrong"),
        (without, "legs", f"{without} have no ranges", "certify again, with --tolerance"),
    )
    assert ranges is not None
    unknowns = [between(F(lo), F(hi)) for lo, hi in zip(ranges.lo, ranges.hi, strict=True)]
    found = {}
    for leg in run.legs:
        assert leg.ranges is not None
        box = [between(F(lo), F(hi)) for lo, hi in zip(leg.ranges.box.lo, leg.ranges.box.hi, strict=True)]
        joints = []
        for turn, shift, at in ((R_X, T_X, box[:3]), (R_F, T_F, box[3:6])):  # R x + t
            moved = applied(matrix([unknowns[i] for i in turn]), at)
            joints += plus(moved, [unknowns[i] for i in shift])
        low, high = zip(*((round_down(one.ends[0]), round_up(one.ends[1])) for one in joints), strict=True)
        found[leg.leg] = np.array(low), np.array(high)
    return found
