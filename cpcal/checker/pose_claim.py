"""Checks pose sets: from boxes of pixels, camera and target to a box of poses, by chains of certificates.

docs/certificate-format.md, "Pose sets", is the specification.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .bounds import Bounds, Vector, between, half_turn, minus, number, product, rotation, total, transposed
from .certificate import check_lines
from .claims import Accepted
from .files import POSE_SET_SUFFIX, WORK, Budget, Lines, content, opened, parsed
from .header import stated_problem
from .lens import View
from .pose_rows import Stated, fixed_constraints, motion_row, pose_row
from .pose_sight import FARTHEST, Sight, sight_of
from .problem import Box, Constraint, Problem
from .readers import choice, dyadic, entry, many, maybe, record, shown, text, whole
from .refusal import Refused, Unusable
from .robust_claim import meeting

POSE_SET_FORMAT = "cpcal-pose-set/2"
_MOST_DOTS = 10_000
_MOST_CHAINS = 64
_MOST_STAGES = 16  # of a chain
_IMAGE_WORK = 30_000_000  # of a folder's image: four times what 133 dots take, for some that may be wrong
_ROW_WORK, _CAMERA_WORK = 26_000, 12_000  # of a row, and more for each number of t

_ROW = entry(whole(_MOST_DOTS), whole(5), dyadic, dyadic)
_STAGE = record({"certificate": text, "power": whole(1000, -1000), "rows": many(_ROW)})
_CLAIM = record(
    {
        "format": text,
        "inputs": lambda value: value,
        "outliers": whole(_MOST_DOTS),
        "refuted": choice(True, False),
        "pose": many(dyadic, 7),
        "position_radius": maybe(many(dyadic, 3)),
        "rotation_radius": maybe(many(dyadic, 3)),
        "chains": many(many(_STAGE)),
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
    budget = Budget(work or max(WORK, _IMAGE_WORK * len(claims)))
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
    form, inputs, outliers, refuted, pose, position, turn, chains = _CLAIM(parsed(content(path)))
    if form != POSE_SET_FORMAT:
        raise Refused(f"the format is not {POSE_SET_FORMAT}")
    digest = hashlib.sha256(
        json.dumps(inputs, sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode("ascii")
    ).hexdigest()
    sight = sight_of(inputs)
    if inputs["name"] != name:
        raise Refused("it speaks of another image than its file is named after")
    if refuted != (position is None) or refuted != (turn is None):
        raise Refused("radii are stated of what is refuted, or are missing")
    if len(chains) > _MOST_CHAINS or any(len(stages) > _MOST_STAGES for stages in chains):
        raise Refused(f"it has more than {_MOST_CHAINS} chains, or one of more than {_MOST_STAGES}", "limit")
    chain = _Chain(path.parent, f"cpcal pose set {digest}", sight, [number(v) for v in pose], budget)
    boxes = [chain.left(stages) for stages in chains]
    if not chains or meeting([used for used, _ in boxes], outliers, chain.budget.spend):
        raise Refused("so many wrong dots could spoil all of its chains of certificates")
    for _, left in boxes:
        if left is not None and refuted:
            raise Refused("a pose is not excluded")
    if not refuted:
        _compare_radii([_radii(left, chain) for _, left in boxes if left is not None], (*position, *turn))
    files = tuple((file["name"], file["sha256"]) for file in inputs["files"])
    radii = None if refuted else (*position, *turn)
    named = tuple(file for stages in chains for file, *_ in stages)
    return PoseSetChecked(name, len(sight.dots), outliers, digest, files, pose, radii, named)


def _compare_radii(proved: list[Vector], stated: tuple[F, ...]) -> None:
    """The stated radii are the widest that some chain proves, rounded up."""
    for i, value in enumerate(stated):
        widest, radius = max((radii[i].hi for radii in proved), default=0), between(value, value)
        if widest > radius.lo:
            raise Refused("its certificates prove a wider box than it states")
        if radius.hi > widest + (widest >> 40) + 1:
            raise Refused("it states a wider box than its certificates prove")


def _radii(left: list[Bounds], chain: _Chain) -> Vector:
    """Of the poses of a box of (W, s), those of larger and smaller plates too."""
    moved = [w.size / stretch(left[3:]).least for w in left[:3]]
    turned = [s.size.times(2) for s in left[3:]]
    moved = [m + more for m, more in zip(moved, chain.sight.by_scale(chain.pose, moved, turned), strict=True)]
    return [*moved, *turned]


def stretch(s: Vector) -> Bounds:
    """1 + s.s"""
    return number(1) + total(part.square for part in s)


class _Chain:
    """Checks chains of certificates about one pose."""

    def __init__(self, folder: Path, about: str, sight: Sight, pose: list[Bounds], budget: Budget) -> None:
        self.folder, self.about, self.sight, self.pose = folder, about, sight, pose
        self.budget, self._named = budget, set[str]()

    def left(self, stages: tuple[Any, ...]) -> tuple[frozenset[int], list[Bounds] | None]:
        """The dots that a chain needs, and what it leaves of (W, s); None: nothing."""
        used, box, first = set[int](), None, True
        for file, power, rows in stages:
            if not first and box is None:
                raise Refused("a certificate follows one that leaves nothing")
            accepted = self._certificate(file, power, rows, None if first else box)
            used.update(dot for dot, *_ in rows)
            box, first = self._after(accepted, first), False
        if first:
            raise Refused("a chain has no certificate")
        return frozenset(used), box

    def _certificate(self, file: str, power: int, rows: Any, before: list[Bounds] | None) -> Accepted:
        """One that is accepted, and speaks of what is assumed. `before`: (W, s) that it must begin with."""
        if "/" in file or "\\" in file or file.startswith("."):
            raise Refused(f"names no certificate of its folder: {shown(file)}")
        if file in self._named:
            raise Refused(f"names the certificate {shown(file)} twice")
        self._named.add(file)
        kept: list[Constraint] = []

        def formed(header: dict[str, Any]) -> tuple[Problem, Box]:
            problem, root, items = stated_problem(header, lines)
            if header["about"] != self.about:
                raise Refused("the certificate is about other pixels, another camera or another target", "run")
            kept.extend(items)
            return problem, root

        try:
            with opened(self.folder / file) as stream:
                lines = Lines(stream, self.budget)
                accepted = check_lines(lines, formed)
            lines.spend(len(rows) * (_ROW_WORK + _CAMERA_WORK * self.sight.cameras.size))
            self._follows(Stated(accepted, kept), power, rows, before)
        except (Refused, Unusable) as error:
            code = error.code if isinstance(error, Refused) else "run"
            raise Refused(f"{shown(file)}: {error}", code, 0) from None
        return accepted

    def _follows(self, stated: Stated, power: int, rows: Any, before: list[Bounds] | None) -> None:
        """Whether all constraints follow from what is assumed, on the box where they are used."""
        sight, root = self.sight, stated.root
        motions = before is None
        size = 9 if motions else 6 + sight.cameras.size
        if len(root) != size or len(rows) > len(stated.rows) or stated.objective:
            raise Refused("it has other unknowns or constraints than a pose set has", "run")
        if before is None:
            assumed = [Bounds(-FARTHEST.hi, FARTHEST.hi)] * 3 + [number(0).around(number(1))] * 6
        else:
            assumed = [*before, *([number(0).around(number(1))] * sight.cameras.size)]
        if any(a.lo < b.lo or a.hi > b.hi for a, b in zip(assumed, root, strict=True)):
            raise Refused("it begins with less than there is", "proof")
        given = stated.rows[: len(rows)]
        place, kept = None if before is None else sight.about(self.pose, root), dict[Any, View]()
        for polynomial, (dot, side, x, y) in zip(given, rows, strict=True):
            if dot >= len(sight.dots):
                raise Refused("a row is of a dot that is not there")
            view = sight.view(dot, (x, y), place, kept)
            if place is None:
                implied = motion_row(sight, polynomial, dot, side, view, root)
            else:
                implied = pose_row(sight, place, polynomial, dot, side, view, power)
            if not implied:
                raise Refused(f"row {side} of dot {dot} does not follow from what is assumed", "proof")
        fixed_constraints(stated, len(rows), motions, sight.cameras)

    def _after(self, accepted: Accepted, first: bool) -> list[Bounds] | None:
        """What a certificate leaves, in (W, s)."""
        if accepted.claims.infeasible:
            return None
        hull = accepted.claims.enclosure
        if hull is None:
            raise Refused("a certificate claims no enclosure")
        box = [between(lo, hi) for lo, hi in zip(*hull, strict=True)]
        if not first:
            return box[:6]
        turned, position = self.sight.mobile_in_base(box)
        s = half_turn(product(turned, transposed(rotation(self.pose[3:]))))
        moved = minus(position, self.pose[:3])
        return [*(m * stretch(s) for m in moved), *s]
