"""A chain of certificates checked again: by the checker, and against the constraints that the run's own study gives.

The checker decides whether a certificate proves what it claims of the constraints that it states. Here these are
compared, character by character, with what the study gives, and each certificate must begin where the one before ended.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.checker import Accepted, check
from cpcal.handeye.exact_errors import PlacedFrames
from cpcal.handeye.exact_rows import ExactRows, row_meaning, row_number, stated_line
from cpcal.handeye.frame_equations import EQUATIONS, UNKNOWNS
from cpcal.handeye.frames_chain import Chain, nominal_turn
from cpcal.handeye.frames_proof import box_of
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.image_pose_sets import POSE, ImagePoseSet, pose_domain, pose_row_meaning, pose_statements
from cpcal.handeye.pose_links import Cut, Links
from cpcal.solver.certificate.statement import Stated, number
from cpcal.solver.certificate.writer import line
from cpcal.solver.interval import Box

_WORK = 500_000_000  # what the check of one certificate may cost, in multiplications


class NotAsStated(Exception):
    """What is not as the run says."""


@dataclass(frozen=True)
class ChainClaim:
    """What a chain proves: nothing explains the pixels, or all frames that do lie in the box [lo, hi].

    `last`: image and point of the pixel rows of its last step; `steps`: of all certificates.
    """

    infeasible: bool
    lo: tuple[F, ...]
    hi: tuple[F, ...]
    last: frozenset[tuple[str, str]]
    steps: int


@dataclass(frozen=True)
class _Checked:
    accepted: Accepted
    last: tuple[int, ...]  # constraints of the study that its last step speaks of


def claimed(run: Path, chain: Chain, study: HandEyeStudy, box: Box, eps: float, center: PlacedFrames) -> ChainClaim:
    """What is proved at eps of the frames in a box. Raises Refused, Unusable, NotAsStated."""
    steps, last = 0, frozenset[tuple[str, str]]()
    for one in chain.images:
        checked = _image(run, one, study, box, eps)
        steps += checked.accepted.steps
        if checked.accepted.claims.infeasible:
            if chain.links or chain.pixels or len(chain.images) > 1:
                raise NotAsStated(f"{one.certificate} leaves nothing for the certificates after it")
            return ChainClaim(True, (), (), frozenset(_of_pose(study, one.image, checked.last)), steps)
    hull: tuple[tuple[F, ...], tuple[F, ...]] | None = None
    infeasible = False
    steps_of = [(one.certificate, one) for one in chain.links] + [(name, None) for name in chain.pixels]
    for name, link in steps_of:
        if infeasible:
            raise NotAsStated(f"{name} comes after a certificate that leaves nothing")
        if hull is not None:
            box = _float_box(hull, name)
        if link is None:
            checked = _pixels(run / _plain(name), study, box, eps)
        else:
            checked = _links(run / _plain(name), chain.images, link.cuts, study, box, center)
        infeasible, hull = checked.accepted.claims.infeasible, checked.accepted.claims.enclosure
        steps += checked.accepted.steps
        last = frozenset() if link else frozenset(_of_pixels(study, checked.last))
        if not infeasible and hull is None:
            raise NotAsStated(f"{name} does not claim where the next certificate begins")
    if not infeasible and hull is None:
        raise NotAsStated("there are no certificates")
    return ChainClaim(infeasible, *(hull or ((), ())), last, steps)


def _plain(name: str) -> str:
    if not name or Path(name).name != name:
        raise NotAsStated(f"{name!r:.60} is no name of a certificate")
    return name


def _float_box(hull: tuple[tuple[F, ...], tuple[F, ...]], name: str) -> Box:
    lo, hi = ([float(v) for v in side] for side in hull)
    if (tuple(map(F, lo)), tuple(map(F, hi))) != hull:
        raise NotAsStated(f"the certificate before {name} claims a box that float64 does not hold")
    return box_of(lo, hi)


def _image(run: Path, one: ImagePoseSet, study: HandEyeStudy, frames: Box, eps: float) -> _Checked:
    if one.image not in study.images or len(one.nominal.turn) != 9 or len(one.nominal.place) != 3:
        raise NotAsStated(f"{one.certificate} is of no image of the study")
    image = study.images.index(one.image)
    items = pose_statements(study, image, one.nominal, eps)
    domain = pose_domain(study, image, one.nominal, frames)
    known = {item.name: k for k, item in enumerate(items)}
    checked = _checked(run / _plain(one.certificate), POSE.names, domain, known, lambda k: items[k])
    hull = checked.accepted.claims.enclosure
    if checked.accepted.claims.infeasible:
        if one.lo or one.hi:
            raise NotAsStated(f"{one.certificate} leaves no pose, and bounds are stated")
    elif hull is None or hull != (tuple(map(F, one.lo)), tuple(map(F, one.hi))):
        raise NotAsStated(f"{one.certificate} proves other bounds of the pose in {one.image}")
    return checked


def _links(
    path: Path,
    images: tuple[ImagePoseSet, ...],
    cuts: tuple[Cut, ...],
    study: HandEyeStudy,
    box: Box,
    center: PlacedFrames,
) -> _Checked:
    named = {one.image for one in images}
    if len(named) < len(images) or any(cut.image not in named or len(cut.weights) != 6 for cut in cuts):
        raise NotAsStated("an image stands twice in the chain, or a cut is of none")
    items = Links(study, images, nominal_turn(center), box).statements(cuts)
    known = {item.name: k for k, item in enumerate(items)}
    return _checked(path, UNKNOWNS, box, known, lambda k: items[k])


def _pixels(path: Path, study: HandEyeStudy, box: Box, eps: float) -> _Checked:
    return _checked(path, UNKNOWNS, box, _numbers(study), ExactRows(study, eps, box).stated)


def _checked(
    path: Path, unknowns: tuple[str, ...], domain: Box, known: Mapping[str, int], stated: Callable[[int], Stated]
) -> _Checked:
    """A certificate that is accepted, of constraints that are those known by name, and of that box."""
    accepted = check(path, work=_WORK)
    box = tuple(number(v) for v in domain.lo), tuple(number(v) for v in domain.hi)
    if tuple(tuple(number(v) for v in side) for side in (accepted.lo, accepted.hi)) != box:
        raise NotAsStated(f"{path.name} speaks of another box")
    if accepted.unknowns != unknowns:
        raise NotAsStated(f"{path.name} speaks of other unknowns")
    found = []
    with path.open(encoding="utf-8") as lines:
        next(lines)
        for text, _ in zip(lines, range(accepted.count), strict=False):
            k = known.get(str(json.loads(text)["name"]))
            if k is None or json.loads(text) != json.loads(line(stated_line(stated(k)))):
                raise NotAsStated(f"{path.name} states a constraint that is not the study's")
            found.append(k)
        *_, last = lines
    return _Checked(accepted, tuple(found[place] for _, place in json.loads(last).get("rows", [])))


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
