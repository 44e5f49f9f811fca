"""Runs of `cpcal handeye certify` and `cpcal handeye certify --wrong` checked again, against the study that they hold.

Every number of handeye.json and handeye-wrong.json is claimed by a certificate, or computed again here, or stands under
`information`. The checker decides whether a certificate proves what it claims of the constraints that it states. Here
these are compared, character by character, with what the study gives, and each certificate must begin where the one
before ended.
"""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np

from cpcal.checker import Accepted, Refused, Unusable, check
from cpcal.checker.files import Budget
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import stated
from cpcal.handeye.certify import AskedBox, judged, load_hand_eye_result, parameter_ranges, ranges_tolerance
from cpcal.handeye.chain import (
    POSE,
    Chain,
    Cut,
    ImagePoseSet,
    Links,
    nominal_turn,
    pose_domain,
    pose_row_meaning,
    pose_statements,
)
from cpcal.handeye.classical_answer import ClassicalAnswer, classical_answer
from cpcal.handeye.files import load_hand_eye
from cpcal.handeye.rows import (
    EQUATIONS,
    UNKNOWNS,
    ExactRows,
    PlacedFrames,
    Reading,
    above,
    exact_errors,
    largest,
    row_meaning,
    row_number,
    stated_line,
)
from cpcal.handeye.study import HandEyeStudy
from cpcal.handeye.wrong_images import RefutedGroup, load_wrong_images
from cpcal.robot import quaternion_from_matrix, rotation_vector
from cpcal.solver.certificate.exact_network import Stated, number
from cpcal.solver.certificate.recording import line
from cpcal.solver.interval import Box

RUN_WORK = 240_000_000  # of all certificates of a run
_APART = 1e-3  # of the deviations of a least-squares answer, or of the box: how far one computed again may be
_ROUNDING = np.tile([1e-9] * 3 + [1e-6] * 3, 2)  # rad and mm: the same where pixels fit without error
_LARGEST = 1e9  # of a nominal pose (mm) and of a cut's weights: beyond it float64 may overflow


class NotAsStated(Exception):
    """What is not as the run says."""


def verify_hand_eye(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """For each statement of the run of `cpcal handeye certify` in `folder`: whether it is accepted, and a sentence.

    Raises InputError where files cannot be read.
    """
    return _HandEyeRun(Path(folder)).statements()


def verify_wrong_images(folder: str | os.PathLike[str]) -> list[tuple[bool, str]]:
    """The same for a run of `cpcal handeye certify --wrong`. Raises InputError where files cannot be read."""
    return _WrongImagesRun(Path(folder)).statements()


class _Run:
    """What both kinds have: a study, a box about a least-squares answer, a point, certificates."""

    def __init__(self, run: Path) -> None:
        self.run, self.study = run, load_hand_eye(run)
        self.budget = Budget(RUN_WORK)  # of all certificates
        self.named: set[str] = set()  # certificates: one may be named once, or a small run could take long to check

    def checks(self) -> tuple[Callable[[], str], ...]:
        raise NotImplementedError

    def statements(self) -> list[tuple[bool, str]]:
        """For each check whether it is passed, and its sentence. Raises InputError."""
        found = []
        for one in self.checks():
            try:
                found.append((True, one()))
            except (NotAsStated, Refused) as reason:
                found.append((False, f"{one.__name__.replace('_', ' ')}: REFUSED, {reason}"))
            except InputError as error:  # what a study must be for its answer to be computed again
                found.append((False, f"{one.__name__.replace('_', ' ')}: REFUSED, {error.problems[0]}"))
            except Unusable as reason:
                raise InputError([Problem(str(self.run), str(reason), "run cpcal handeye certify again")]) from None
        return found

    def fitted(self) -> HandEyeStudy:
        """The images whose least-squares answer is the box's centre, and that the point explains."""
        return self.study

    @cached_property
    def answer(self) -> ClassicalAnswer:
        """Computed again."""
        return classical_answer(self.fitted())

    def checked_box(self, asked: AskedBox, what: str) -> str:
        """A sentence on the box. Raises NotAsStated."""
        answer = self.answer
        off, there = asked.center.frames, answer.frames
        apart = np.concatenate([
            rotation_vector(quaternion_from_matrix(off.e_rotation @ there.e_rotation.T)),
            off.e_translation - there.e_translation,
            rotation_vector(quaternion_from_matrix(off.f_rotation @ there.f_rotation.T)),
            off.f_translation - there.f_translation,
        ])  # fmt: skip
        room = np.minimum(np.sqrt(np.diagonal(answer.covariance)), np.tile(np.repeat([1.0, asked.reach], 3), 2))
        if not (np.abs(apart) <= _APART * room + _ROUNDING).all():
            raise NotAsStated(f"its centre is not the least-squares answer{what}")
        turned = "any rotation" if asked.angle is None else f"rotations within {stated(asked.angle)} degrees"
        return f"box: {turned}, positions within {stated(asked.reach)} mm of the least-squares answer{what}"

    def check_point(self, asked: AskedBox, point: PlacedFrames, readings: tuple[Reading, ...], eps_hi: float) -> None:
        """Raises NotAsStated for frames outside of the box, or whose largest error is not eps_hi."""
        study = self.fitted()
        check_readings(study, readings)
        worst = largest(exact_errors(study, point, readings))
        if worst is None:
            raise NotAsStated("the point puts the target behind the camera")
        if above(worst) != eps_hi:
            raise NotAsStated("eps_hi is not the largest error of a pixel at the point")
        if not asked.holds(point):
            raise NotAsStated("the point is not in the box")

    def claimed(self, chain: Chain, study: HandEyeStudy, box: Box, eps: float, center: PlacedFrames) -> ChainClaim:
        """What a chain that begins with a box proves at eps. Raises Refused, Unusable, NotAsStated."""
        for name in chain.certificates:
            if not name or "\0" in name or Path(name).name != name or name in self.named:
                raise NotAsStated(f"{name!r:.60} is no name of a certificate, or named twice")
            self.named.add(name)
        return _claimed(self.run, chain, study, box, eps, center, self.budget)


def check_readings(study: HandEyeStudy, readings: tuple[Reading, ...]) -> None:
    """Raises NotAsStated for readings of poses beyond their half-widths."""
    width = study.pose_half_width
    if not width.any():
        if readings:
            raise NotAsStated("readings are stated of poses that are exact")
    elif len(readings) != len(width) or any(len(one) != width.shape[1] for one in readings):
        raise NotAsStated("the readings are not those of the study's poses")
    elif not (np.abs(np.array(readings)) <= width).all():
        raise NotAsStated("a reading of a pose is beyond its half-width")


class _HandEyeRun(_Run):
    def __init__(self, run: Path) -> None:
        super().__init__(run)
        self.result = load_hand_eye_result(run)
        self.proved: ChainClaim | None = None  # of the ranges, once they are accepted

    def checks(self) -> tuple[Callable[[], str], ...]:
        return self.box, self.ranges, self.lower_end, self.upper_end, self.least_squares

    def box(self) -> str:
        study, result = self.study, self.result
        if (len(study.images), len(study.image), study.setup) != (result.images, result.points, result.setup):
            raise NotAsStated("the study is another one")
        return self.checked_box(result.asked, "")

    def ranges(self) -> str:
        ranges, asked = self.result.ranges, self.result.asked
        if not ranges.chain.certificates:
            raise NotAsStated("they are stated, and no certificate is there")
        if ranges.eps != ranges_tolerance(self.result.eps_hi, self.result.tolerance):
            raise NotAsStated("they are at another tolerance")
        claim = self.claimed(ranges.chain, self.study, asked.box, ranges.eps, asked.center)
        if ranges.empty:
            if not claim.infeasible:
                raise NotAsStated("the certificate does not claim that there are no frames")
        elif claim.infeasible or (claim.lo, claim.hi) != (tuple(map(F, ranges.lo)), tuple(map(F, ranges.hi))):
            raise NotAsStated("the box of the unknowns is not the one that is proved")
        elif parameter_ranges(ranges.lo, ranges.hi, self.result.point) != (ranges.low, ranges.high):
            raise NotAsStated("the ranges do not follow from the box of the unknowns")
        self.proved = claim
        if ranges.empty:
            return f"ranges: PROVED, no frames explain every pixel to {ranges.eps!r} px"
        return f"ranges: PROVED for all frames that explain every pixel to {ranges.eps!r} px ({claim.steps} steps)"

    def lower_end(self) -> str:
        result, ranges = self.result, self.result.ranges
        if not result.lower.certificates:
            if result.eps_lo != 0.0 or result.support:
                raise NotAsStated("eps_lo is stated, and no certificate is there")
            return "lower end: NOT CERTIFIED, eps >= 0"
        begins = result.asked.box
        if not ranges.empty:
            if self.proved is None:
                raise NotAsStated("it begins with ranges that are not proved")
            if result.eps_lo > ranges.eps:
                raise NotAsStated("it begins with ranges at a smaller tolerance")
            begins = _float_box((self.proved.lo, self.proved.hi), "the lower end")
        claim = self.claimed(result.lower, self.study, begins, result.eps_lo, result.asked.center)
        if not claim.infeasible:
            raise NotAsStated("the certificate does not claim that there are no frames")
        if result.support != claim.last:
            raise NotAsStated("the support is not that of the last step")
        return f"lower end: PROVED, no frames explain every pixel to {result.eps_lo!r} px ({claim.steps} steps)"

    def upper_end(self) -> str:
        result = self.result
        self.check_point(result.asked, result.point, result.readings, result.eps_hi)
        return f"upper end: PROVED, the point explains every pixel to {result.eps_hi!r} px"

    def least_squares(self) -> str:
        study, asked, said, eps = self.study, self.result.asked, self.result.classical, self.result.ranges.eps
        check_readings(study, said.readings)
        apart = np.abs(np.array(said.readings or 0.0) - self.answer.readings)
        if not (apart <= _APART * study.pose_half_width).all():
            raise NotAsStated("its readings of the poses are others")
        found = judged(study, asked.center, said.readings, eps)
        if tuple(verdict.image for verdict in said.images) != study.images:
            raise NotAsStated("it does not speak of the study's images")
        for verdict, exact in zip(said.images, found.images, strict=True):
            if verdict != exact:
                raise NotAsStated(f"it is other in {verdict.image}")
        if said.largest != found.largest:
            raise NotAsStated("its largest error is another one")
        failing = sum(not verdict.ok for verdict in said.images)
        return f"least squares: PROVED, over {eps!r} px in {failing} of {len(study.images)} images"


class _WrongImagesRun(_Run):
    def __init__(self, run: Path) -> None:
        super().__init__(run)
        self.found = load_wrong_images(run)

    def checks(self) -> tuple[Callable[[], str], ...]:
        return self.box, self.lower_end, self.upper_end, self.wrong_images

    def fitted(self) -> HandEyeStudy:
        """Those that are not left out. Raises NotAsStated."""
        left, images = self.found.left_out, self.study.images
        if not 0 < len(left) == len(set(left)) == self.found.outliers or not set(left) < set(images):
            raise NotAsStated("other images are left out than may be")
        return self.study.part(np.array([k for k, name in enumerate(images) if name not in left]))

    def box(self) -> str:
        return self.checked_box(self.found.asked, f" without {', '.join(self.found.left_out)}")

    def lower_end(self) -> str:
        found = self.found
        if not found.groups and found.eps_lo == 0.0:
            return "lower end: NOT CERTIFIED, eps >= 0"
        self.refuted(found.groups, found.eps_lo, None)
        return (
            f"lower end: PROVED, whichever {found.outliers} images are wrong, no frames explain all others to "
            f"{found.eps_lo!r} px ({len(found.groups)} groups)"
        )

    def upper_end(self) -> str:
        found = self.found
        self.check_point(found.asked, found.point, found.readings, found.eps_hi)
        return f"upper end: PROVED, all but {', '.join(found.left_out)} are explained to {found.eps_hi!r} px"

    def wrong_images(self) -> str:
        found = self.found
        if not found.blamed:
            return "wrong images: none is named"
        named = [image for image, _ in found.blamed]
        if len(set(named)) < len(named) or not set(named) <= set(found.left_out):
            raise NotAsStated("an image is named that is not left out, or twice")
        eps = found.tolerance
        for image, reasons in found.blamed:
            self.refuted(reasons, eps, image)
        return f"wrong images: PROVED if at most {found.outliers} are, at {eps!r} px: {', '.join(named)}"

    def refuted(self, groups: Sequence[RefutedGroup], eps: float, beside: str | None) -> None:
        """Raises NotAsStated, Refused, Unusable unless there are enough groups that no frames explain to eps.

        They may have no image in common but the one `beside` them, which all of them have.
        """
        if len(groups) <= self.found.outliers:
            raise NotAsStated("there are not enough groups of images")
        names = [name for group in groups for name in group.images if name != beside]
        if len(set(names)) < len(names):
            raise NotAsStated("two groups have an image in common")
        for group in groups:
            if not set(group.images) <= set(self.study.images) or group.images.count(beside or "") != bool(beside):
                raise NotAsStated("a group is of other images")
            if group.eps != eps:
                raise NotAsStated("a group is at another tolerance")
            part = self.study.part(np.array([self.study.images.index(name) for name in group.images]))
            asked = self.found.asked
            if not self.claimed(group.chain, part, asked.box, eps, asked.center).infeasible:
                raise NotAsStated("a certificate does not claim that there are no frames")


# chains of certificates --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChainClaim:
    """What a chain proves: nothing explains the pixels, or all frames that do lie in the box [lo, hi].

    `last`: image and point of the pixel rows of its last step, each once; `steps`: of all certificates.
    """

    infeasible: bool
    lo: tuple[F, ...]
    hi: tuple[F, ...]
    last: tuple[tuple[str, str], ...]
    steps: int


@dataclass(frozen=True)
class _Checked:
    accepted: Accepted
    constraints: tuple[int, ...]  # of the study that it states
    last: tuple[int, ...]  # those that its last step speaks of


def _claimed(
    run: Path, chain: Chain, study: HandEyeStudy, box: Box, eps: float, center: PlacedFrames, budget: Budget
) -> ChainClaim:
    steps, last = 0, tuple[tuple[str, str], ...]()
    for one in chain.images:
        checked = _image(run, budget, one, study, box, eps)
        steps += checked.accepted.steps
        if checked.accepted.claims.infeasible:
            if chain.links or chain.pixels or len(chain.images) > 1:
                raise NotAsStated(f"{one.certificate} leaves nothing for the certificates after it")
            return ChainClaim(True, (), (), tuple(dict.fromkeys(_of_pose(study, one.image, checked.last))), steps)
    hull: tuple[tuple[F, ...], tuple[F, ...]] | None = None
    infeasible = False
    steps_of = [(one.certificate, one) for one in chain.links] + [(name, None) for name in chain.pixels]
    for name, link in steps_of:
        if infeasible:
            raise NotAsStated(f"{name} comes after a certificate that leaves nothing")
        if hull is not None:
            box = _float_box(hull, name)
        if link is None:
            checked = _pixels(run / name, budget, study, box, eps)
        else:
            checked = _links(run / name, budget, chain.images, link.cuts, study, box, center)
        infeasible, hull = checked.accepted.claims.infeasible, checked.accepted.claims.enclosure
        steps += checked.accepted.steps
        last = () if link else tuple(dict.fromkeys(_of_pixels(study, checked.last)))
        if not infeasible and hull is None:
            raise NotAsStated(f"{name} does not claim where the next certificate begins")
    if not infeasible and hull is None:
        raise NotAsStated("there are no certificates")
    return ChainClaim(infeasible, *(hull or ((), ())), last, steps)


def _float_box(hull: tuple[tuple[F, ...], tuple[F, ...]], name: str) -> Box:
    lo, hi = ([float(v) for v in side] for side in hull)
    if (tuple(map(F, lo)), tuple(map(F, hi))) != hull:
        raise NotAsStated(f"the certificate before {name} claims a box that float64 does not hold")
    return Box(UNKNOWNS, lo, hi)


def _image(run: Path, budget: Budget, one: ImagePoseSet, study: HandEyeStudy, frames: Box, eps: float) -> _Checked:
    if one.image not in study.images or len(one.nominal.turn) != 9 or len(one.nominal.place) != 3:
        raise NotAsStated(f"{one.certificate} is of no image of the study")
    if not max(map(abs, (*one.nominal.turn, *one.nominal.place))) < _LARGEST:
        raise NotAsStated(f"{one.certificate} has a nominal pose that is too large")
    image = study.images.index(one.image)
    items = pose_statements(study, image, one.nominal, eps)
    domain = pose_domain(study, image, one.nominal, frames)
    known = {item.name: k for k, item in enumerate(items)}
    checked = _checked(run / one.certificate, budget, POSE.names, domain, known, lambda k: items[k])
    hull = checked.accepted.claims.enclosure
    if checked.accepted.claims.infeasible:
        if one.lo or one.hi:
            raise NotAsStated(f"{one.certificate} leaves no pose, and bounds are stated")
    elif hull is None or hull != (tuple(map(F, one.lo)), tuple(map(F, one.hi))):
        raise NotAsStated(f"{one.certificate} proves other bounds of the pose in {one.image}")
    return checked


def _links(
    path: Path,
    budget: Budget,
    images: tuple[ImagePoseSet, ...],
    cuts: tuple[Cut, ...],
    study: HandEyeStudy,
    box: Box,
    center: PlacedFrames,
) -> _Checked:
    named = {one.image for one in images}
    if len(named) < len(images) or any(cut.image not in named or len(cut.weights) != 6 for cut in cuts):
        raise NotAsStated("an image stands twice in the chain, or a cut is of none")
    if not all(0.0 < max(map(abs, cut.weights)) < _LARGEST for cut in cuts):
        raise NotAsStated("a cut has weights that are too large, or none")
    if len({cut.name for cut in cuts}) < len(cuts):
        raise NotAsStated("a cut is stated twice")
    items = Links(study, images, nominal_turn(center), box).statements(cuts)
    known = {item.name: k for k, item in enumerate(items)}
    found = _checked(path, budget, UNKNOWNS, box, known, lambda k: items[k])
    if not {known[cut.name] for cut in cuts} <= set(found.constraints):
        raise NotAsStated(f"{path.name} does not use a cut that is stated")
    return found


def _pixels(path: Path, budget: Budget, study: HandEyeStudy, box: Box, eps: float) -> _Checked:
    if study.pose_half_width.any():
        raise NotAsStated(f"{path.name} speaks of pixels as if the robot's poses were exact")
    return _checked(path, budget, UNKNOWNS, box, _numbers(study), ExactRows(study, eps).stated)


def _checked(
    path: Path,
    budget: Budget,
    unknowns: tuple[str, ...],
    domain: Box,
    known: Mapping[str, int],
    stated: Callable[[int], Stated],
) -> _Checked:
    """A certificate that is accepted, of constraints that are those known by name, and of that box."""
    accepted = check(path, work=budget)
    box = tuple(number(v) for v in domain.lo), tuple(number(v) for v in domain.hi)
    if tuple(tuple(number(v) for v in side) for side in (accepted.lo, accepted.hi)) != box:
        raise NotAsStated(f"{path.name} speaks of another box")
    if accepted.unknowns != unknowns:
        raise NotAsStated(f"{path.name} speaks of other unknowns")
    found = []
    with path.open(encoding="utf-8") as lines:
        next(lines)
        for text in islice(lines, accepted.count):
            k = known.get(str(json.loads(text)["name"]))
            if k is None or json.loads(text) != json.loads(line(stated_line(stated(k)))):
                raise NotAsStated(f"{path.name} states a constraint that is not the study's")
            found.append(k)
        (last,) = deque(lines, 1)  # a step, or the claims where there is none
    return _Checked(accepted, tuple(found), tuple(found[row[1]] for row in json.loads(last).get("rows", [])))


def _of_pixels(study: HandEyeStudy, constraints: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    for k in constraints:
        meaning = row_meaning(k, len(study.image))
        if meaning is not None:
            yield study.images[study.image[meaning[0]]], study.names[meaning[0]]


def _of_pose(study: HandEyeStudy, image: str, constraints: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    mine = np.flatnonzero(study.image == study.images.index(image))
    for k in constraints:
        point = pose_row_meaning(k)
        if point is not None:
            yield image, study.names[mine[point]]


def _numbers(study: HandEyeStudy) -> dict[str, int]:
    """The number of each constraint by its name."""
    count = len(study.image)
    names = {f"rotation {k}": k for k in range(len(EQUATIONS))}
    for point in range(count):
        label = f"{study.images[study.image[point]]}/{study.names[point]}"
        for axis in (0, 1):
            for below in (False, True):
                name = f"{label} {'uv'[axis]} {'below' if below else 'above'}"
                names[name] = row_number(point, axis, below, count)
    return names
