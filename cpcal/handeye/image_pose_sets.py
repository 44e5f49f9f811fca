"""The target's pose in the camera frame, from the pixels of one image alone: a certified box of all that explain them.

In image i the points are x = A (S (p - c) + u) + b, with a nominal pose (A, b) of the points' middle c. Unknown are the
turn S (9 entries, near I) and the shift u (3), mm, both along the target's axes. The rows of the pixels are linear in
them; S S' = I, S' S = I and S = cof S hold to within what float64 makes of the robot's rotations. No frames and no
robot pose enter, so what is proved holds whatever errors the robot has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction as F

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.box_contraction import ConstraintRows, FramesProof, Tell, contracted
from cpcal.handeye.classical_answer import image_poses
from cpcal.handeye.exact_rows import HandEyeStatement, ListedRows
from cpcal.handeye.frame_equations import T_F, T_X, rotation_equations
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.quadratic_rows import Layout, Quadratics
from cpcal.robot import rotation_matrix
from cpcal.solver.certificate.statement import Given, Stated
from cpcal.solver.interval import Box

TURN, SHIFT = range(9), range(9, 12)
POSE = Layout(
    (*(f"S{a + 1}{b + 1}" for a in range(3) for b in range(3)), *(f"u{a}" for a in "xyz")),
    np.array([(i, j) for i in TURN for j in range(i, 9)], dtype=np.intp),
)
LOOSE = 1e-11  # what products of float64 rotation matrices are off from rotations, at most, and what comes of it
_EQUATIONS = rotation_equations(TURN)
_UP = 1.0 + 1e-9


@dataclass(frozen=True)
class NominalPose:
    """Of the target in the camera frame in one image: A (9, row by row), and b, where the points' middle c is, mm."""

    turn: tuple[float, ...]
    place: tuple[float, ...]


@dataclass(frozen=True)
class ImagePoseSet:
    """PROVED: in this image S and u lie in [lo, hi] (12), for all frames of the asked box that explain it to eps.

    Without bounds: no pose does. `certificate`: the name of its file.
    """

    image: str
    nominal: NominalPose
    lo: tuple[float, ...]
    hi: tuple[float, ...]
    certificate: str

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The largest |S - I| (3, 3) and |u| (3,)."""
        lo, hi = np.array(self.lo), np.array(self.hi)
        turn = np.maximum(np.abs(lo[:9].reshape(3, 3) - np.eye(3)), np.abs(hi[:9].reshape(3, 3) - np.eye(3)))
        return turn, np.maximum(np.abs(lo[9:]), np.abs(hi[9:]))


def middle_of(study: HandEyeStudy, image: int) -> Floats:
    """(3,) c: the middle of the least box of the image's points, mm; exact in float64 where they are round numbers."""
    mine = study.points[study.image == image]
    return np.asarray(0.5 * (mine.min(axis=0) + mine.max(axis=0)))


def nominal_poses(study: HandEyeStudy) -> dict[int, NominalPose]:
    """From least squares on each image's pixels, of images that determine one."""
    kept, seen = image_poses(study)
    found = {}
    for k, position, quaternion in zip(kept, seen.position, seen.quaternion, strict=True):
        turn = rotation_matrix(quaternion)
        place = position + turn @ middle_of(study, k)
        found[k] = NominalPose(tuple(turn.ravel().tolist()), tuple(place.tolist()))
    return found


def pose_domain(study: HandEyeStudy, image: int, nominal: NominalPose, frames: Box) -> Box:
    """All turns, and as far as a target can be from its nominal place for frames in a box and readings of the pose."""
    far = _norm(np.maximum(np.abs(frames.lo), np.abs(frames.hi))[list(T_X)])
    far += _norm(np.maximum(np.abs(frames.lo), np.abs(frames.hi))[list(T_F)])
    far += _norm(study.poses.position[image]) + _norm(study.pose_half_width[image, :3])
    far += _norm(middle_of(study, image)) + _norm(np.array(nominal.place))
    reach = float(np.ceil(far * 1.001 + 1.0))
    lo = np.append(np.full(9, -1.0 - 2.0**-30), np.full(3, -reach))
    return Box(POSE.names, lo, -lo)


def _norm(vector: Floats) -> float:
    return float(np.sqrt(np.sum(vector**2)))


def pose_statements(study: HandEyeStudy, image: int, nominal: NominalPose, eps: float) -> tuple[Stated, ...]:
    """21 equations of the turn, then four rows of each point."""
    loose = F(LOOSE)
    found = []
    for k, terms in enumerate(_EQUATIONS):
        value = -F(terms.get((), 0.0))
        body: Given = tuple((m, F(c)) for m, c in terms.items() if m)
        found.append(Stated(f"turn {k}", False, body, (((), value - loose),), (((), value + loose),)))
    return (*found, *_pixel_statements(study, image, nominal, eps))


def _pixel_statements(study: HandEyeStudy, image: int, nominal: NominalPose, eps: float) -> Iterator[Stated]:
    camera, rays = study.camera, study.rays
    turn = [[F(v) for v in nominal.turn[3 * a : 3 * a + 3]] for a in range(3)]
    place = [F(v) for v in nominal.place]
    middle = [F(float(v)) for v in middle_of(study, image)]
    for n in np.flatnonzero(study.image == image).tolist():
        q = [F(float(v)) - c for v, c in zip(study.points[n], middle, strict=True)]
        width = F(eps) + F(float(study.half_width[n]))
        for axis in (0, 1):
            off = F(float(rays[n, axis])) - F(float(camera.center[axis]))
            focal = F(float(camera.focal[axis]))
            for below in (False, True):
                sign = -1 if below else 1
                first, third = sign * focal, -sign * off - width
                along = [first * turn[axis][b] + third * turn[2][b] for b in range(3)]
                body = [((9 + b,), along[b]) for b in range(3)]
                body += [((3 * b + d,), along[b] * q[d]) for b in range(3) for d in range(3) if q[d]]
                limit = -(first * place[axis] + third * place[2])
                name = f"{study.names[n]} {'uv'[axis]} {'below' if below else 'above'}"
                yield Stated(name, False, tuple(sorted(body)), None, (((), limit),))


def pose_row_meaning(constraint: int) -> int | None:
    """The point, among those of the image, that a constraint speaks of; None for an equation of the turn."""
    return None if constraint < len(_EQUATIONS) else (constraint - len(_EQUATIONS)) // 4


def stated_rows(items: tuple[Stated, ...], layout: Layout, about: str, rotations: tuple[int, ...]) -> ConstraintRows:
    """Constraints of which only those of rotations have products, as rows."""
    rows: list[dict[tuple[int, ...], float]] = []
    places = []
    for k, item in enumerate(items):
        body = {m: float(c) for m, c in item.body}
        for part, (bound, sign) in enumerate(((item.at_most, 1.0), (item.at_least, -1.0))):
            if bound is not None:
                rows.append({m: sign * c for m, c in body.items()} | {(): -sign * float(dict(bound).get((), F(0)))})
                places.append((k, part))
    statement = HandEyeStatement(ListedRows(items), about, layout.names)
    quadratics = Quadratics.of(layout, rows)

    def negligible(box: Box) -> bool:
        return bool(box.rad[list(rotations)].max() < 0.02)

    return ConstraintRows(statement, quadratics, np.array(places, dtype=np.intp), rotations, negligible)


def prove_pose(
    study: HandEyeStudy, image: int, nominal: NominalPose, eps: float, domain: Box, *, tell: Tell = lambda text: None
) -> FramesProof:
    """Contract the box of poses of one image until it is empty or gets no smaller, at a tolerance of eps px."""
    items = pose_statements(study, image, nominal, eps)
    rows = stated_rows(items, POSE, about_pose(study, image, eps), tuple(TURN))
    return contracted(rows, eps, domain, tell=tell)


def about_pose(study: HandEyeStudy, image: int, eps: float) -> str:
    """What certificates say of themselves."""
    return (
        f"cpcal hand-eye, {study.images[image]} alone: turn S and shift u (mm) of the target from its nominal pose; "
        f"every pixel within eps = {eps.hex()} px"
    )
