"""A target in one image: the rows that its dots' boxes of pixels say of its pose, derived from what is assumed.

    X = P + D R(q) x,   x within its half-widths: a dot before the camera

D R(q) is the rotation of the target in the camera frame and P its position. With a pixel to the first order,
F = v + J (X / Z - x0) + k . t + e, |e| <= E, a box of pixels gives, times the depth,
`J (X, Y) + (v - J x0 - hi - E) Z + k . t Z <= 0`: degree two, and t, |t| <= 1, is shared by all dots.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction as F
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

from .bounds import (
    UNIT,
    ZERO,
    Bounds,
    Vector,
    between,
    bounds_of,
    box_of,
    half_turn,
    longest,
    matrix,
    multiple,
    number,
    numbers,
    rotation,
    sizes,
    total,
)
from .certificate import FORMAT, Certificates
from .files import POSE_SET_SUFFIX, WORK, Budget, Lines, content, parsed
from .frames import EQUATIONS, turn_equations
from .lens import NEAREST, Cameras
from .polynomial import Form, applied, forms, inner, minus, plus, transposed
from .polynomial import product as matrix_product
from .readers import (
    STRANGE,
    Fractions,
    Json,
    Names,
    Places,
    Refused,
    Unusable,
    anything,
    ascending,
    choice,
    dyadic,
    many,
    maybe,
    reason_of,
    record,
    shown,
    text,
    whole,
)
from .rule import Box, ModelRows, Problem

FARTHEST = number(1 << 20)  # mm
AXES, TURN, PLACE = range(3), range(9), range(9, 12)
SIDES = ("u+", "u-", "v+", "v-", "depth", "turn+", "turn-", "ball")
_FORM, _PLANE, _OUTWARD = 44, 36, 60  # bits behind the point: of a dot's place, of a plane, of boxes
_DOT_WORK, _CAMERA_WORK = 16_000, 6_000  # of a dot, and more for each number of t
_MOST_SPREAD = 100
_PAIR = many(dyadic, 2)
_INPUTS = record(
    {
        "name": text,
        "files": many(record({"name": text, "sha256": text})),
        "pixels": record(
            {
                "of": choice("images", "centers"),
                "numbers": many(whole(1 << 30)),
                "lo": many(_PAIR),
                "hi": many(_PAIR),
                "rays": many(_PAIR),
            }
        ),
        "camera": record({"numbers": many(dyadic, 9), "spread": many(many(dyadic), 9), "field": dyadic}),
        "target": record(
            {"radius": dyadic, "dots": many(_PAIR), "half_widths": many(many(dyadic, 3)), "scale": dyadic}
        ),
    }
)


@dataclass(frozen=True)
class Dot:
    """Its place with the half-widths of its box (mm, target frame), its box of pixels, and a direction near."""

    at: Vector
    widths: Vector
    pixels: Vector
    ray: tuple[F, F]


@dataclass(frozen=True)
class Sight:
    """All that is assumed."""

    dots: tuple[Dot, ...]
    of_images: bool
    cameras: Cameras
    radius: Bounds
    scale: Bounds

    def radii(self, box: Box, turn: Sequence[F], pose: Sequence[F]) -> list[Bounds]:
        """Of the poses of a box about a pose: |P - P0| (3), and |2 s| (3) of their rotations R(1, s) R(q0).

        Those of larger and smaller plates too: one that is 1 + tau times as large has the same image so much farther
        away, and turned alike. That moves P by tau P.
        """
        place, moved = numbers(pose[:3]), bounds_of(box)
        away = sizes(minus(moved[9:12], place))
        more = [self.scale * (p.size + m) for p, m in zip(place, away, strict=True)]
        swing = half_turn(matrix(turned(moved[:9], turn, pose[3:])))
        return [*plus(away, more), *(2 * v.size for v in swing)]


def sight_of(inputs: Any) -> Sight:
    """What is assumed, read and checked. Raises Refused."""
    _, _, pixels, camera, target = _INPUTS(inputs)
    of, named, lo, hi, rays = pixels
    radius, dots, widths, scale = target
    count = len(named)
    if {len(lo), len(hi), len(rays), len(dots), len(widths)} != {count} or len(set(named)) < count or not count:
        raise Refused("there is not one box of pixels, one direction, one place and one box of places for each dot")
    if any(a > b for one, other in zip(lo, hi, strict=True) for a, b in zip(one, other, strict=True)):
        raise Refused("a box of pixels is empty")
    if radius <= 0 or not 0 <= scale < 1 or any(w < 0 for one in widths for w in one):
        raise Refused("a radius, half-width or scale is out of range")
    values, spread, field = camera
    if len({len(row) for row in spread}) != 1 or len(spread[0]) > _MOST_SPREAD:
        raise Refused("the camera's spread is no matrix")
    boxes = ([between(*ends) for ends in zip(*one, strict=True)] for one in zip(lo, hi, strict=True))
    given = zip(dots, widths, boxes, rays, strict=True)
    listed = tuple(Dot(numbers([*dot, 0]), numbers(width), box, ray) for dot, width, box, ray in given)
    return Sight(listed, of == "images", _cameras(values, spread, field), number(radius), number(scale))


_cameras = lru_cache(maxsize=4)(Cameras)  # for many images of a folder: what is found out of its field is kept


def turned(entries: Vector, before: Sequence[F], after: Sequence[F]) -> list[Bounds]:
    """D about another quaternion: D R(before) R(after)'."""
    one, other = (rotation(numbers(q)) for q in (before, after))
    found = matrix_product(matrix(entries), matrix_product(one, transposed(other)))
    return [v.within(-1, 1) for row in found for v in row]


# rows ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Seen:
    """Of a dot: X, Y and Z as whole numbers times 2^-44 by unknowns D and P, what each may be off;
    planes g (3) and k, whole numbers times 2^-36, by side."""

    forms: tuple[Form, ...]
    off: Bounds
    planes: tuple[tuple[Places, Places], ...]


class Rows(ModelRows):
    """The rows of some dots on a box of poses about a quaternion; `placed`: the bias of images' centres is bounded over
    that box, else over all poses."""

    sides = SIDES

    def __init__(self, sight: Sight, dots: Sequence[int], turn: Sequence[F], root: Box, placed: bool) -> None:
        self.sight, self.dots, self.root, self.placed = sight, tuple(dots), root, placed
        self._ends = bounds_of(root)
        self._turn = rotation(numbers(turn))
        held = matrix_product(matrix(self._ends[:9]), self._turn)
        self._held = [[v.within(-1, 1) for v in row] for row in held]  # the target's rotation before the camera
        self._seen: dict[int, _Seen] = {}
        self.size = 12 + sight.cameras.size
        self._t = forms(range(12, self.size))
        self.count = max(EQUATIONS, len(sight.dots))
        ball = [(SIDES[7], 0)] if sight.cameras.size else []
        turns = product(SIDES[5:7], range(EQUATIONS))
        self.tags = dict.fromkeys([*((s, k) for k in dots for s in SIDES[:5]), *turns, *ball])

    def dot_of(self, side: str, k: int) -> int | None:
        """The dot that a row is of."""
        return k if side in SIDES[:5] else None

    def work(self, side: str, k: int) -> int:
        return 0 if side in SIDES[5:] or k in self._seen else _DOT_WORK + _CAMERA_WORK * self.sight.cameras.size

    def form(self, side: str, k: int) -> Form:
        if side in SIDES[5:7]:
            return turn_equations(0)[k] * (1 if side == SIDES[5] else -1)
        if side == SIDES[7]:
            ball: Form = inner(self._t, self._t) - 1
            return ball
        seen = self.seen(k)
        if side == SIDES[4]:
            off = inner(self.sight.dots[k].widths, sizes(self._held[2]))
            nearest: Bounds = number(NEAREST) * self.sight.radius - off - seen.off
            return seen.forms[2] * -1 + nearest.floor(_FORM)
        return self._plane(k, seen, *seen.planes[SIDES.index(side)])

    def _plane(self, k: int, seen: _Seen, plane: Sequence[int], shared: Sequence[int]) -> Form:
        """g . X + Z k . t, less what it may be off: by rounding, and as the dot is off its place."""
        by_depth = inner([Form({}), *self._t], [0, *shared])
        found: Form = inner(seen.forms, plane) + seen.forms[2] * by_depth
        g, by_t = ([multiple(v, _PLANE) for v in part] for part in (plane, shared))
        shift = longest(by_t)
        lost = (total(sizes(g)) + shift) * seen.off
        widths = self.sight.dots[k].widths
        if any(w.hi for w in widths):
            length = inner(g, g).root.most
            for j, w in enumerate(widths):
                along = inner(g, [row[j] for row in self._held]).size
                lost = lost + w * (Bounds(0, min(along.hi, length.hi)) + shift * self._held[2][j].size)
        return found - lost.ceiling(_PLANE + _FORM)

    def seen(self, k: int) -> _Seen:
        if k not in self._seen:
            dot = self.sight.dots[k]
            v = applied(self._turn, dot.at)
            whole = [(c.middle + multiple(1, _FORM + 1)).floor(_FORM) for c in v]
            off = total((c - multiple(w, _FORM)).size for c, w in zip(v, whole, strict=True))
            seen = tuple(Form({(PLACE[i],): 1 << _FORM} | {(3 * i + b,): w for b, w in enumerate(whole)}) for i in AXES)
            pixels = self._moved(dot, v) if self.sight.of_images else dot.pixels
            self._seen[k] = _Seen(seen, off, self._planes(pixels, dot.ray))
        return self._seen[k]

    def _moved(self, dot: Dot, v: Vector) -> list[Bounds]:
        """The box of pixels of a dot's centre, of one of the centre of its image."""
        sight, cameras = self.sight, self.sight.cameras
        if not self.placed:
            return minus(dot.pixels, cameras.field_bias)
        at = plus(self._ends[9:12], applied(matrix(self._ends[:9]), v))
        at = [x.around(inner(dot.widths, sizes(row))) for x, row in zip(at, self._held, strict=True)]
        depth = Bounds(max(at[2].lo, (number(NEAREST) * sight.radius).lo), at[2].hi)
        x = [at[0] / depth, at[1] / depth]
        return minus(dot.pixels, cameras.bias(x, sight.radius / depth, [row[2] for row in self._held]))

    def _planes(self, pixels: Vector, ray: tuple[F, F]) -> tuple[tuple[Places, Places], ...]:
        """g . X + Z k . t <= 0 for all points X whose pixel is in the box, by side."""
        one, found = self.sight.cameras.linear(pixels, ray), []
        for k in range(2):
            slope, shared = ([v.middle.floor(_PLANE) for v in part] for part in (one.slope[k], one.by[k]))
            own, cut = ([multiple(v, _PLANE) for v in part] for part in (slope, shared))
            # what is cut off counts for |x - x0| <= rho and |t_j| <= 1
            lost = one.rest[k] + total(sizes(minus(one.slope[k], own))) * one.size + total(sizes(minus(one.by[k], cut)))
            middle = one.value[k] - inner(own, numbers(ray))
            above, below = middle - pixels[k].most - lost, pixels[k].least - middle - lost
            found.append(((*slope, above.floor(_PLANE)), tuple(shared)))
            found.append(((*(-s for s in slope), below.floor(_PLANE)), tuple(-b for b in shared)))
        return tuple(found)

    def fails(self, k: int) -> bool:
        """Whether a dot is outside of its box of pixels for every pose of the box."""
        for side in SIDES[:5]:
            low, unit = ZERO, _FORM if side == SIDES[4] else _FORM + _PLANE
            for m, c in self.row(side, k).items():
                part = multiple(c, unit)
                for i in m:
                    part = part * (self._ends[i] if len(m) < 2 else ZERO.around(self._ends[i].size))
                low = low + part
            if low.lo > 0:
                return True
        return False


# pose sets: docs/certificate-format.md has the specification ---------------------------------------------------------
#
# A claim names certificates. A *first* one begins with all poses, and holds those that show all of its dots. A later
# one begins where others end, and holds all poses that show all dots of the claim but at most q of them; it leaves out
# dots that no pose of the box where it begins shows: these are wrong for sure. Several first ones of different dots
# give a box together: no more than q of them have a wrong dot.

POSE_SET_FORMAT = "cpcal-pose-set/5"
_MOST_DOTS = 10_000
_MOST_CERTIFICATES = 64
# 133 dots take 7,000,000 units; with an uncertain camera and plate 20,000,000, and 42,000,000 if two may be wrong
_IMAGE_WORK = 45_000_000  # of a folder: more for each image beyond the first
_FIELD_WORK, _LENS_WORK = 4_000_000, 600_000  # of a camera's field, and more for each number of t
_FAILING_WORK = 60_000  # of a dot that is shown to be wrong

_CLAIM = record(
    {
        "format": choice(POSE_SET_FORMAT),
        "inputs": anything,
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
    pose: Fractions = ()
    radii: Fractions | None = None
    certificates: Names = ()
    refused: str | None = None


def check_pose_sets(folder: Path, *, work: int = 0) -> list[PoseSetChecked]:
    """What is proved of every image of a folder. Raises Unusable where there is nothing to check.

    `work`: what the check of all of them may cost; 0 for what so many images need.
    """
    claims = sorted(folder.glob("*" + POSE_SET_SUFFIX))
    if not claims:
        raise Unusable(f"{shown(folder.name)} holds no pose set (*{POSE_SET_SUFFIX})")
    budget = Budget(work or WORK + _IMAGE_WORK * (len(claims) - 1))
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
    except (Refused, *STRANGE) as error:
        return PoseSetChecked(name, refused=reason_of(error))


def _checked(path: Path, name: str, budget: Budget) -> PoseSetChecked:
    _, inputs, outliers, refuted, pose, position, turn, wrong, after = _CLAIM(parsed(content(path)))
    sight = sight_of(inputs)
    if inputs["name"] != name:
        raise Refused("it speaks of another image than its file is named after")
    if refuted != (position is None) or refuted != (turn is None):
        raise Refused("radii are stated of what is refuted, or are missing")
    if not any(pose[3:]):
        raise Refused("a quaternion is zero")
    budget.spend(_FIELD_WORK + _LENS_WORK * sight.cameras.size)
    digest = digest_of(inputs)
    certificates = PoseCertificates(path.parent, digest, sight, outliers, budget)
    about, left = joined([certificates.part(file) for file in after], outliers)
    if left is not None and wrong:
        certificates.show_wrong(wrong, about, left)
        left = None if len(wrong) > outliers else left
    if (left is None) != refuted:
        raise Refused("a pose is not excluded" if refuted else "it states radii where no pose is left")
    radii = None
    if left is not None:
        radii = (*position, *turn)
        for proved, value in zip(sight.radii(left, about, pose), numbers(radii), strict=True):
            if proved.hi > value.lo:
                raise Refused("its certificates prove a wider box than it states")
            if value.hi > proved.hi + (proved.hi >> 40) + 1:
                raise Refused("it states a wider box than its certificates prove")
    files = tuple((file["name"], file["sha256"]) for file in inputs["files"])
    return PoseSetChecked(name, len(sight.dots), outliers, digest, files, pose, radii, tuple(certificates.known))


def digest_of(inputs: Json) -> str:
    """SHA-256 of the canonical JSON: keys sorted, no white space."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True, separators=(",", ":")).encode("ascii")).hexdigest()


@dataclass(frozen=True)
class Part:
    """A certificate: of which dots, about which quaternion, after which others; what is left, None for nothing."""

    dots: Places
    turn: Fractions
    after: Names
    left: Box | None


def joined(parts: Sequence[Part], outliers: int) -> tuple[Fractions, Box | None]:
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
    parts = [*[UNIT] * 9, *[ZERO.around(FARTHEST)] * 3]
    if before is not None:
        about, held = before[0], bounds_of(before[1])
        parts = [*turned(held[:9], about, turn), *held[9:12]]
    root = box_of([*parts, *[UNIT] * sight.cameras.size], _OUTWARD)  # t behind them
    return Rows(sight, dots, turn, root, placed=before is not None)


class PoseCertificates(Certificates):
    """Those of a claim about at most so many wrong dots."""

    most = _MOST_CERTIFICATES

    def __init__(self, folder: Path, digest: str, sight: Sight, outliers: int, budget: Budget) -> None:
        super().__init__(folder, budget)
        self.digest, self.sight, self.outliers = digest, sight, outliers

    def part(self, file: str) -> Part:
        accepted = self.accepted(file)
        (_, _, dots, _, _, turn, after), hull = _HEADER(accepted.header), accepted.claims.enclosure
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

    def form(self, header: Json, lines: Lines) -> tuple[Problem, Box]:
        _, digest, dots, outliers, wrong, turn, after = _HEADER(header)
        if digest != self.digest:
            raise Refused("the certificate is about other pixels, another camera or another target", "run")
        if not dots or dots[-1] >= len(self.sight.dots) or set(dots) & set(wrong):
            raise Refused("it names no dots, a wrong one, or one that is not there")
        if not any(turn):
            raise Refused("a quaternion is zero")
        before = None
        if after:
            about, box = joined([self.part(file) for file in after], self.outliers)
            if box is None:
                raise Refused("it follows what leaves nothing")
            if outliers != self.outliers - len(wrong):
                raise Refused("it allows for another number of wrong dots than the claim")
            self.show_wrong(wrong, about, box)
            before = about, box
        elif outliers or wrong:
            raise Refused("a first certificate is of dots that are all right")
        rows = rows_of(self.sight, dots, turn, before)
        return replace(rows.problem(self.budget.spend), wrong=outliers, tag=rows.dot_of), rows.root
