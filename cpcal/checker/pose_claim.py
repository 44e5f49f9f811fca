"""Checks pose sets: from boxes of pixels, camera and target to a box of poses.

A claim names certificates. A *first* one begins with all poses, and holds those that show all of its dots. A later one
begins where others end, and holds all poses that show all dots of the claim but at most q of them; it leaves out dots
that no pose of the box where it begins shows, which are wrong for sure. Several first ones of different dots give a box
together: no more than q of them have a wrong dot.

docs/certificate-format.md, "Pose sets", is the specification.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .bounds import Bounds, between
from .certificate import Certificates
from .files import POSE_SET_SUFFIX, WORK, Budget, content, parsed
from .header import FORMAT
from .problem import Box, Problem
from .readers import ascending, choice, dyadic, many, maybe, record, shown, text, whole
from .refusal import Refused, Unusable
from .sight import Rows, Sight, ends, rounded, sight_of, turned

POSE_SET_FORMAT = "cpcal-pose-set/3"
_MOST_DOTS = 10_000
_MOST_CERTIFICATES = 64
# 133 dots take 7,000,000 units, 8,000,000 with 3 that may be wrong
_IMAGES, _IMAGE_WORK = 5, 15_000_000  # of a folder: more for each image beyond so many
_FIELD_WORK, _CAMERA_WORK = 4_000_000, 600_000  # of a camera's field, and more for each number of t
_FAILING_WORK = 60_000  # of a dot that is shown to be wrong

_CLAIM = record(
    {
        "format": text,
        "inputs": lambda value: value,
        "outliers": whole(_MOST_DOTS),
        "refuted": choice(True, False),
        "pose": many(dyadic, 7),
        "position_radius": maybe(many(dyadic, 3)),
        "rotation_radius": maybe(many(dyadic, 3)),
        "wrong": ascending(_MOST_DOTS),
        "after": many(text),
    }
)
_HEADER = record(
    {
        "format": choice(FORMAT),
        "pose_set": text,
        "dots": ascending(_MOST_DOTS),
        "outliers": whole(_MOST_DOTS),
        "wrong": ascending(_MOST_DOTS),
        "turn": many(dyadic, 4),
        "after": many(text),
    }
)


@dataclass(frozen=True)
class PoseSetChecked:
    """What is proved of one image: `radii` of position (mm) and rotation about `pose`; None: no pose is possible."""

    name: str
    dots: int = 0
    outliers: int = 0
    digest: str = ""  # of all that is assumed
    files: tuple[tuple[str, str], ...] = ()  # that it came from, with their SHA-256
    pose: tuple[F, ...] = ()
    radii: tuple[F, ...] | None = None
    certificates: tuple[str, ...] = ()
    refused: str | None = None


def check_pose_sets(folder: Path, *, work: int = 0) -> list[PoseSetChecked]:
    """What is proved of every image of a folder. Raises Unusable where there is nothing to check.

    `work`: what the check of all of them may cost; 0 for what so many images need.
    """
    claims = sorted(folder.glob("*" + POSE_SET_SUFFIX))
    if not claims:
        raise Unusable(f"{shown(folder.name)} holds no pose set (*{POSE_SET_SUFFIX})")
    budget = Budget(work or WORK + _IMAGE_WORK * max(0, len(claims) - _IMAGES))
    found = [check_pose_set(path, work=budget) for path in claims]
    named = {file for one in found for file in one.certificates}
    others = sorted({path.name for path in folder.glob("*.cert.jsonl")} - named)
    if others and not any(one.refused for one in found):
        found.append(PoseSetChecked(others[0], refused="no pose set names this certificate, which lies beside them"))
    return found


def check_pose_set(path: Path, *, work: int | Budget = WORK) -> PoseSetChecked:
    """What is proved by one claim and the certificates beside it. Raises Unusable where it cannot be read.

    `work`: what it may cost, or what is left for a folder.
    """
    name = path.name.removesuffix(POSE_SET_SUFFIX)
    try:
        return _checked(path, name, work if isinstance(work, Budget) else Budget(work))
    except Refused as error:
        return PoseSetChecked(name, refused=str(error))
    except (KeyError, TypeError, ValueError, IndexError, RecursionError, OverflowError, MemoryError):
        return PoseSetChecked(name, refused="holds a value of the wrong kind")


def _checked(path: Path, name: str, budget: Budget) -> PoseSetChecked:
    form, inputs, outliers, refuted, pose, position, turn, wrong, after = _CLAIM(parsed(content(path)))
    if form != POSE_SET_FORMAT:
        raise Refused(f"the format is not {POSE_SET_FORMAT}")
    sight = sight_of(inputs)
    if inputs["name"] != name:
        raise Refused("it speaks of another image than its file is named after")
    if refuted != (position is None) or refuted != (turn is None):
        raise Refused("radii are stated of what is refuted, or are missing")
    if not any(pose[3:]):
        raise Refused("a quaternion is zero")
    budget.spend(_FIELD_WORK + _CAMERA_WORK * sight.cameras.size)
    digest = digest_of(inputs)
    certificates = PoseCertificates(path.parent, digest, sight, outliers, budget)
    about, left = certificates.joined(after)
    if left is not None and wrong:
        certificates.show_wrong(wrong, about, left)
        left = None if len(wrong) > outliers else left
    if (left is None) != refuted:
        raise Refused("a pose is not excluded" if refuted else "it states radii where no pose is left")
    radii = None
    if left is not None:
        radii = (*position, *turn)
        _compare_radii(sight.radii(left, about, pose), radii)
    files = tuple((file["name"], file["sha256"]) for file in inputs["files"])
    return PoseSetChecked(name, len(sight.dots), outliers, digest, files, pose, radii, tuple(certificates.known))


def digest_of(inputs: dict[str, Any]) -> str:
    """SHA-256 of the canonical JSON: keys sorted, no white space."""
    canonical = json.dumps(inputs, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


def _compare_radii(proved: Sequence[Bounds], stated: Sequence[F]) -> None:
    """The stated radii are those that are proved, rounded up."""
    for found, value in zip(proved, stated, strict=True):
        radius = between(value, value)
        if found.hi > radius.lo:
            raise Refused("its certificates prove a wider box than it states")
        if radius.hi > found.hi + (found.hi >> 40) + 1:
            raise Refused("it states a wider box than its certificates prove")


@dataclass(frozen=True)
class Part:
    """A certificate: of which dots, about which quaternion, after which others; what is left, None for nothing."""

    dots: tuple[int, ...]
    turn: tuple[F, ...]
    after: tuple[str, ...]
    left: Box | None


def joined(parts: Sequence[Part], outliers: int) -> tuple[tuple[F, ...], Box | None]:
    """The box of all poses that show all dots but so many, and the quaternion that it is about. Raises Refused.

    Of first certificates without common dots, `outliers` at most have a wrong one: the pose is in the boxes of all
    others.
    """
    if len(parts) == 1 and parts[0].after:
        return parts[0].turn, parts[0].left
    used = [dot for part in parts for dot in part.dots]
    if not parts or len(set(used)) < len(used) or any(part.after or part.turn != parts[0].turn for part in parts):
        raise Refused("it rests on certificates that give no box together")
    boxes = [part.left for part in parts if part.left is not None]
    wrong = outliers - (len(parts) - len(boxes))
    if wrong < 0:
        return parts[0].turn, None
    if len(boxes) <= wrong:
        raise Refused("so many wrong dots could spoil all of its certificates")
    held = len(boxes) - wrong - 1
    lo = tuple(sorted(ends)[held] for ends in zip(*(box.lo for box in boxes), strict=True))
    hi = tuple(sorted(ends)[-1 - held] for ends in zip(*(box.hi for box in boxes), strict=True))
    return parts[0].turn, Box(lo, hi) if all(a <= b for a, b in zip(lo, hi, strict=True)) else None


def rows_of(sight: Sight, dots: Sequence[int], turn: Sequence[F], before: tuple[Sequence[F], Box] | None) -> Rows:
    """Of a certificate about a quaternion: a first one, or one that begins with a box about another quaternion."""
    if before is None:
        return Rows(sight, dots, turn, sight.anywhere(), placed=False)
    about, box = before
    held = ends(box)
    root = rounded([*turned(held[:9], about, turn), *held[9:12]], sight.cameras.size)
    return Rows(sight, dots, turn, root, placed=True)


class PoseCertificates(Certificates):
    """Those of a claim about at most so many wrong dots."""

    most = _MOST_CERTIFICATES

    def __init__(self, folder: Path, digest: str, sight: Sight, outliers: int, budget: Budget) -> None:
        super().__init__(folder, budget)
        self.digest, self.sight, self.outliers = digest, sight, outliers

    def joined(self, files: Iterable[str]) -> tuple[tuple[F, ...], Box | None]:
        return joined([self.part(file) for file in files], self.outliers)

    def part(self, file: str) -> Part:
        accepted, (_, _, dots, _, _, turn, after) = self.accepted(file)
        hull = accepted.claims.enclosure
        if not accepted.claims.infeasible and hull is None:
            raise Refused(f"{shown(file)}: it claims no enclosure", code="form", line=0)
        return Part(dots, turn, after, None if accepted.claims.infeasible or hull is None else Box(*hull))

    def show_wrong(self, dots: Sequence[int], turn: Sequence[F], box: Box) -> None:
        """Raises Refused for a dot that some pose of a box may show."""
        if dots and dots[-1] >= len(self.sight.dots):
            raise Refused("it names a dot that is not there")
        rows = rows_of(self.sight, dots, turn, (turn, box))
        for k in dots:
            self.budget.spend(_FAILING_WORK * (1 + self.sight.cameras.size))
            if not rows.fails(k):
                raise Refused(f"it is not proved that dot {k} is wrong", "proof")

    def formed(self, given: dict[str, Any]) -> tuple[list[Any], Problem, Box]:
        header = _HEADER(given)
        rows, wrong = self._rows(*header)
        return header, replace(rows.problem(self.budget.spend), wrong=wrong, tag=rows.dot_of), rows.root

    def _rows(
        self, _: str, digest: str, dots: Sequence[int], outliers: int, wrong: Sequence[int], turn: Sequence[F],
        after: Sequence[str],
    ) -> tuple[Rows, int]:  # fmt: skip
        if digest != self.digest:
            raise Refused("the certificate is about other pixels, another camera or another target", "run")
        if not dots or dots[-1] >= len(self.sight.dots) or set(dots) & set(wrong):
            raise Refused("it names no dots, a wrong one, or one that is not there")
        if not any(turn):
            raise Refused("a quaternion is zero")
        if not after:
            if outliers or wrong:
                raise Refused("a first certificate is of dots that are all right")
            return rows_of(self.sight, dots, turn, None), 0
        about, box = self.joined(after)
        if box is None:
            raise Refused("it follows what leaves nothing")
        if outliers != self.outliers - len(wrong):
            raise Refused("it allows for another number of wrong dots than the claim")
        self.show_wrong(wrong, about, box)
        return rows_of(self.sight, dots, turn, (about, box)), outliers
