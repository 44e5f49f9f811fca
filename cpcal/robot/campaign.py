"""Campaigns: a robot, the poses and leg readings measured on it, and how far each reading may be off; and studies.

Both are values: arrays are private copies and read-only. `cpcal.files` reads and writes them.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpcal.common.errors import Problem, Problems, shown, unusable
from cpcal.common.files import IDENTIFIER_REMEDY, NAME_MAX, NAME_REMEDY, TEXT_REMEDY, is_identifier, is_text
from cpcal.common.numbers import about
from cpcal.common.values import (
    LARGEST,
    TINY,
    ArrayLike,
    ArrayPair,
    Floats,
    Indices,
    Names,
    Texts,
    Value,
    as_floats,
    fill,
    freeze,
    frozen_array,
    frozen_mapping,
    norms,
)
from cpcal.robot.kinematics import Pose, leg_vectors, turn_between
from cpcal.robot.robot import KINDS, Robot, Uncertainty, good_numbers, known_robot
from cpcal.robot.units import ModelChoice, RotationForm


def stated_uncertainty(
    legs: int, sigmas: Mapping[str, ArrayLike | None], factor: float, uncertainty: Uncertainty | None
) -> Uncertainty | None:
    """The uncertainty that standard deviations state; one number stands for all axes, or all legs."""
    given = {kind: value for kind in KINDS if (value := sigmas[kind]) is not None}
    if not given:
        return uncertainty
    if uncertainty is not None:
        what = f"is given, and {next(iter(given))}_sigma too"
        raise unusable("campaign uncertainty", what, "give one of the two")
    if missing := [f"{kind}_sigma" for kind in KINDS if kind not in given]:
        what = f"{' and '.join(missing)} missing"
        raise unusable("campaign uncertainty", what, "give all three; 0 is exact")
    try:
        rows = {k: np.broadcast_to(as_floats(given[k]), n) for k, n in zip(KINDS, (3, 3, legs), strict=True)}
    except (TypeError, ValueError) as error:
        remedy = f"give one number, or 3, 3 and {legs}"
        raise unusable("campaign uncertainty", str(error)[:200], remedy) from None
    return Uncertainty(**rows, factor=factor)


# ------------------------------------------------------------------------------------------------------------------
# What is wrong with the values of a campaign, one problem after the other.

QUATERNION_TOLERANCE = 1e-6  # on | |q| - 1 |
SIMULATION = "cpcal simulate"  # in a provenance, what begins the `generator` of readings that nobody measured
ARRAYS = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")


def titled(name: str, provenance: Texts) -> str:
    """The name under which a page or a terminal shows what was found in data; simulated ones are called so."""
    return f"{'Simulated: ' * provenance.get('generator', '').startswith(SIMULATION)}{name}"


def table_problems(
    where: str,
    row: str,
    names: Mapping[str, Sequence[str]],
    arrays: Mapping[str, tuple[Floats, int]],
    widths: Mapping[str, tuple[Floats, int]],
) -> Iterator[Problem]:
    """What is wrong with a table of measurements, where it is called `where` and a row `row`: columns of names, which
    together are unique; arrays with so many columns, "quaternion" among them; and such that hold no negative number.
    Sizes first: only where they are right are the values looked at."""
    count, every = len(names["pose"]), {**arrays, **widths}
    remedy = f"give one row for each of the {count} measurements"
    wrong = [] if count else [Problem(where, "holds no measurements", "give at least one")]
    for kind, some in names.items():
        if len(some) != count:
            wrong.append(Problem(f"{where} {kind}", f"has {len(some)} names", remedy))
    for name, (array, width) in every.items():
        if array.shape != (count, width):
            what = f"has the shape {array.shape}, not {(count, width)}"
            wrong.append(Problem(f"{where} {name}", what, remedy))
    yield from wrong
    if wrong:
        return
    for kind, some in names.items():
        for bad in sorted({shown(name) for name in set(some) if not is_identifier(name)}):
            yield Problem(f"{where} {kind}", f"{bad} cannot be a name", IDENTIFIER_REMEDY)
    keys = ["/".join(map(str, key)) for key in zip(*names.values(), strict=True)]
    for key, times in Counter(keys).items() if len(set(keys)) < count else ():
        if times > 1:
            kinds = " and ".join([", ".join([*names][:-1]), [*names][-1]])
            yield Problem(f"{row} {key}", f"is given {times} times", f"give each {kinds} once")
    for name, (array, _) in every.items():
        allowed = good_numbers(array, 0.0 if name in widths else -LARGEST)
        what = f"is {'negative, ' * (name in widths)}NaN, infinite or above {LARGEST:g}"
        for k in np.flatnonzero(~allowed.all(axis=1)):
            yield Problem(f"{row} {keys[k]}", f"its {name} {what}", "correct it, or leave it out")
    quaternion = arrays["quaternion"][0]
    with np.errstate(all="ignore"):  # what is not finite was named above
        far = np.abs(norms(quaternion) - 1.0) > 0.5 * QUATERNION_TOLERANCE
    for k in np.flatnonzero(far):
        norm = math.hypot(*quaternion[k].tolist())
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            yield Problem(f"{row} {keys[k]}", *quaternion_problem(norm))


def provenance_problems(where: str, provenance: Texts) -> Iterator[Problem]:
    """What is wrong with the texts of a provenance."""
    for key, text in provenance.items():
        if not is_text(key, NAME_MAX):
            yield Problem(f"{where} provenance", f"{shown(key)} cannot be a name", NAME_REMEDY)
        if not is_text(text):
            yield Problem(f"{where} provenance {shown(key)}", f"is {shown(text)}", TEXT_REMEDY)


def quaternion_problem(norm: float) -> tuple[str, str]:
    """What is wrong with a quaternion of that norm, and the remedy."""
    if norm == 0.0:
        return ("the quaternion is zero, which is no rotation", "give qw,qx,qy,qz of norm 1 (no rotation: 1,0,0,0)")
    what = f"the quaternion has the norm {norm:.9g}, not 1 (to within {QUATERNION_TOLERANCE:g})"
    return what, "divide it by its norm, and check the order qw,qx,qy,qz"


class Readings(Value):
    """N rows of poses with names, and of what else was read there."""

    pose: Names
    position: Floats
    quaternion: Floats

    def __len__(self) -> int:
        """The number of rows, N."""
        return len(self.pose)

    @cached_property
    def poses(self) -> Pose:
        """N, as they are stated."""
        return Pose(self.position, self.quaternion)


@dataclass(frozen=True, eq=False)
class Campaign(Readings):
    """N measurements of a robot with n legs.

    Use `load_campaign`, `load_log`, `Campaign.from_arrays` or `simulate`; `Campaign.of` takes what is in
    cpcal's own units and frames already.

    pose, run        N names each; `pose/run` is unique
    position         (N, 3) mm, P in the base frame
    quaternion       (N, 4) unit, scalar first; `P + R(q) b` maps mobile to base
    length           (N, n) mm, the readings L
    position_radius  (N, 3) mm, rotation_radius (N, 3) rad, length_radius (N, n) mm: half-widths of
                     the reading sets of DESIGN section 1: |P - P_k| <= p, R = R(1, s) R(q_k),
                     |2 s_i| <= r_i, |L - L_k| <= lambda
    uncertainty      what campaign.toml declares for all rows; None: `exact = true`; rows may differ
    provenance       free text
    model            the leg model that is asked for (None: the plain one)

    Raises InputError, with every problem found, when the values make no campaign.
    """

    robot: Robot
    pose: Names
    run: Names
    position: Floats
    quaternion: Floats
    length: Floats
    position_radius: Floats
    rotation_radius: Floats
    length_radius: Floats
    uncertainty: Uncertainty | None = None
    provenance: Texts = field(default_factory=dict)
    model: ModelChoice | None = None
    # names and SHA-256 of the files that it was read from; set by the readers, not carried over by replace()
    files: tuple[tuple[str, str], ...] = field(default=(), init=False, compare=False)
    digest: str = field(default="", init=False, compare=False)  # SHA-256 of campaign.json, once that was asked for

    def __post_init__(self) -> None:
        freeze(self, *ARRAYS)
        fill(self, pose=tuple(self.pose), run=tuple(self.run), provenance=frozen_mapping(self.provenance))
        legs, stated, wrong = self.robot.legs, self.uncertainty, []
        columns = zip(ARRAYS, (3, 4, legs, 3, 3, legs), strict=True)
        every = [(name, (getattr(self, name), width)) for name, width in columns]
        if stated is not None and stated.length.shape != (legs,):
            what = f"has {len(stated.length)} numbers for {legs} legs"
            wrong.append(Problem("campaign uncertainty.length", what, "give one for each leg"))
        names = {"pose": self.pose, "run": self.run}
        of_table = table_problems("campaign", "measurement", names, dict(every[:3]), dict(every[3:]))
        Problems(itertools.chain(wrong, provenance_problems("campaign", self.provenance), of_table)).raise_any()

    @classmethod
    def of(
        cls,
        robot: Robot,
        position: ArrayLike,
        quaternion: ArrayLike,
        length: ArrayLike,
        *,
        pose: Sequence[str] | None = None,
        run: Sequence[str] | None = None,
        uncertainty: Uncertainty | None = None,
        exact: bool = False,
        position_radius: ArrayLike | None = None,
        rotation_radius: ArrayLike | None = None,
        length_radius: ArrayLike | None = None,
        provenance: Texts | None = None,
        model: ModelChoice | None = None,
    ) -> Campaign:
        """A campaign in memory. Half-widths left out come from `uncertainty`, or are zero with `exact=True`.

        One of the two, or all three half-widths, must be given: whether readings are exact changes every answer.
        position (N, 3) mm, quaternion (N, 4), length (N, n) mm; half-widths broadcast to these shapes.
        Poses left out are named p0, p1, ...; runs left out are all "1". Raises InputError.
        """
        widths = position_radius, rotation_radius, length_radius
        both = exact and uncertainty is not None
        if both or not (exact or uncertainty is not None or all(values is not None for values in widths)):
            what = "is given, and readings are called exact" if both else "is missing"
            remedy = (
                "give the standard deviations (position_sigma=, rotation_sigma=, length_sigma=), "
                "uncertainty=Uncertainty(...), all three half-widths, or exact=True"
            )
            raise unusable("campaign uncertainty", what, remedy)
        try:
            arrays = [as_floats(values) for values in (position, quaternion, length)]
            given = [None if values is None else as_floats(values) for values in widths]
        except (TypeError, ValueError) as error:
            raise unusable("campaign", str(error), "give arrays of numbers") from None
        count = len(arrays[0]) if arrays[0].ndim else 0
        declared = np.zeros(6 + robot.legs) if uncertainty is None else uncertainty.half_widths
        radii = []
        for own, stated, width in zip(given, np.split(declared, [3, 6]), (3, 3, robot.legs), strict=True):
            values = stated if own is None else own
            try:
                radii.append(np.broadcast_to(values, (count, width)))
            except ValueError:  # of another shape, which is said below
                radii.append(values)
        names = tuple(f"p{k}" for k in range(count)) if pose is None else tuple(pose)
        runs = ("1",) * count if run is None else tuple(run)
        tables = dict(zip(ARRAYS, (*arrays, *radii), strict=True))
        return cls(robot, names, runs, **tables, uncertainty=uncertainty, provenance=provenance or {}, model=model)

    @classmethod
    def from_arrays(
        cls,
        positions: ArrayLike,
        rotations: ArrayLike | Any,
        lengths: ArrayLike,
        *,
        robot: Robot | str,
        rotation: str = "quaternion-wxyz",
        position_sigma: ArrayLike | None = None,
        rotation_sigma: ArrayLike | None = None,
        length_sigma: ArrayLike | None = None,
        factor: float = 3.0,
        uncertainty: Uncertainty | None = None,
        exact: bool = False,
        pose: Sequence[str] | None = None,
        run: Sequence[str] | None = None,
        provenance: Texts | None = None,
        model: ModelChoice | None = None,
    ) -> Campaign:
        """A campaign of N measurements of n legs in memory, its rotations in the form that is named.

        positions      (N, 3) mm, P in the base frame
        rotations      (N, ...) in the form `rotation`: quaternion-wxyz or quaternion-xyzw (N, 4), matrix (N, 3, 3),
                       vector-rad or vector-deg (N, 3), euler-xyz-deg, euler-ZYX-rad, ... (N, 3), or a scipy Rotation.
                       `P + R b` maps mobile to base
        lengths        (N, n) mm, the readings
        robot          a Robot, or the name of one in the catalogue (`cpcal robot list`)
        ..._sigma      standard deviations: position (3,) mm, rotation (3,) rad, lengths (n,) mm, or one number for all.
                       Half-widths are `factor` times them. Or give an `uncertainty`, or say that readings are `exact`
        pose, run      N names; left out: p0, p1, ... and all "1"

        Raises InputError, with every problem found.
        """
        built = known_robot(robot).robot if isinstance(robot, str) else robot
        sigmas = {"position": position_sigma, "rotation": rotation_sigma, "length": length_sigma}
        return cls.of(
            built,
            positions,
            RotationForm.named(rotation).quaternions(rotations),
            lengths,
            pose=pose,
            run=run,
            uncertainty=stated_uncertainty(built.legs, sigmas, factor, uncertainty),
            exact=exact,
            provenance=provenance,
            model=model,
        )

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return self.robot.legs

    @cached_property
    def measurement_ids(self) -> Names:
        """`pose/run` of every measurement, in order."""
        return tuple(f"{pose}/{run}" for pose, run in zip(self.pose, self.run, strict=True))

    @property
    def simulated(self) -> bool:
        """Whether a simulation made the readings, as the provenance says; imports and means of them keep it."""
        return self.provenance.get("generator", "").startswith(SIMULATION)

    @property
    def title(self) -> str:
        """The robot's name; simulated data are called so."""
        return titled(self.robot.name, self.provenance)

    @property
    def exact(self) -> bool:
        """Whether every reading set is a single point."""
        return not (self.position_radius.any() or self.rotation_radius.any() or self.length_radius.any())

    def rows(self, chosen: ArrayLike) -> Campaign:
        """Some of its measurements, by number from 0 or as truth values (N,)."""
        rows = np.arange(len(self))[np.asarray(chosen)].tolist()
        pose, run = (tuple(names[k] for k in rows) for names in (self.pose, self.run))
        return replace(self, pose=pose, run=run, **{name: getattr(self, name)[rows] for name in ARRAYS})

    def sampled(self, most: int) -> Campaign:
        """At most so many of its measurements, spread evenly."""
        return self if len(self) <= most else self.rows(np.linspace(0, len(self) - 1, most).astype(np.intp))

    def __repr__(self) -> str:
        return f"<Campaign of {self.title!r}: {len(self)} measurements, {self.legs} legs>"


# ------------------------------------------------------------------------------------------------------------------
# Studies: what the paper's experiment delivers (sections 2.2 to 3.3), before the frames are known.
#
# A camera sees a target on the mobile platform; neither the camera's place beside the base nor the target's place on
# the platform is known. One table of poses serves calibration, another one validation (docs/calibration.md).


@dataclass(frozen=True, eq=False)
class PoseTable(Readings):
    """N rows: the target frame seen in the camera frame, and the readings of n legs.

    pose, run   N names each: a configuration of the legs, and which of its repetitions
    position    (N, 3) mm; quaternion (N, 4) unit, scalar first: `x_camera = P + R(q) x_target`
    length      (N, n) mm, the readings L
    image       N names, or None where there is one row for each pose and run; the names of a row are unique
    shared      (N, 6) standard deviations, mm and rad (rotation vector in the camera frame), of that part of a pose's
                error which camera and target make: the same in all rows, so that no mean is free of it; None: no part

    Raises InputError, with every problem found, when the values make no table.
    """

    pose: Names
    run: Names
    position: Floats
    quaternion: Floats
    length: Floats
    image: Names | None = None
    shared: Floats | None = None

    def __post_init__(self) -> None:
        freeze(self, *ARRAYS[:3], *(() if self.shared is None else ("shared",)))
        names = {name: tuple(some) for name in ("pose", "run", "image") if (some := getattr(self, name)) is not None}
        fill(self, **names)
        legs = self.length.shape[1] if self.length.ndim == 2 else 1
        widths = zip(ARRAYS[:3], (3, 4, max(legs, 1)), strict=True)
        deviations = {} if self.shared is None else {"shared deviation": (self.shared, 6)}
        values = {name: (getattr(self, name), width) for name, width in widths}
        Problems(table_problems("table", "row", names, values, deviations)).raise_any()

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return int(self.length.shape[1])

    @property
    def row_ids(self) -> list[str]:
        """`pose/run` of every row, or `pose/run/image`."""
        columns = (self.pose, self.run) if self.image is None else (self.pose, self.run, self.image)
        return ["/".join(names) for names in zip(*columns, strict=True)]


@dataclass(frozen=True, eq=False)
class Truth(Value):
    """What only a simulation knows.

    seed        of everything random in it
    robot       the true parameters, in the base frame and the mobile frame
    camera      the base frame seen in the camera frame: `x_camera = P + R x_base`, mm
    target      the target frame seen in the mobile frame: `x_mobile = P + R x_target`, mm
    """

    seed: int
    robot: Robot
    camera: Pose
    target: Pose

    def __post_init__(self) -> None:
        for name in ("camera", "target"):
            pose: Pose = getattr(self, name)
            fill(self, **{name: Pose(frozen_array(pose.position), frozen_array(pose.quaternion))})


@dataclass(frozen=True, eq=False)
class Study(Value):
    """A robot's drawing and two tables of poses that a camera saw; use `load_study` or `simulate_study`.

    robot        nominal: joint centres in the base frame and in the mobile frame, mm
    calibration  the poses to fit to
    validation   the poses to judge the fit by
    truth        None where the study was measured
    provenance   free text

    Raises InputError when the tables do not have the robot's number of legs.
    """

    robot: Robot
    calibration: PoseTable
    validation: PoseTable
    truth: Truth | None = None
    provenance: Texts = field(default_factory=dict)

    def __post_init__(self) -> None:
        fill(self, provenance=frozen_mapping(self.provenance))
        problems = Problems(provenance_problems("study", self.provenance))
        for name in ("calibration", "validation"):
            found = getattr(self, name).legs
            if found != self.robot.legs:
                what = f"has readings of {found} legs, and the robot has {self.robot.legs}"
                problems.wrong(f"study {name}", what, "give one reading for each leg")
        if self.truth is not None and self.truth.robot.legs != self.robot.legs:
            problems.wrong("study truth", "has another number of legs", "give as many as the robot has")
        problems.raise_any()

    def __repr__(self) -> str:
        rows = f"{len(self.calibration)} + {len(self.validation)} rows"
        return f"<Study of {self.robot.name!r}: {rows}, {self.robot.legs} legs>"


# ------------------------------------------------------------------------------------------------------------------
# The calibration equations of legs. With v = P + R b - a (mm, base frame), leg by leg (the paper, eq. 15):
#
#     g(x, M) = ||v|| - (L + l)        mm
#
# A turn theta (rotation vector in the base frame, so R becomes R(theta) R) moves v by theta x R b.

_SHORTEST = 1e-300  # mm: the norm of a leg of length zero, where g has no derivative, instead of a division by zero


@dataclass(frozen=True, eq=False)
class LegEquations:
    """g(x) of n legs at N measurements, mm, for parameters x (n, 7) in mm: rows a_x a_y a_z b_x b_y b_z l.

    position (N, 3) mm; rotation (N, 3, 3); length (N, n) mm.
    """

    position: Floats
    rotation: Floats
    length: Floats

    @classmethod
    def of(cls, campaign: Campaign, legs: Sequence[int] | None = None) -> LegEquations:
        """Of the legs with these numbers, from 1 (left out: all), at the centres of the campaign's reading sets."""
        columns = [leg - 1 for leg in legs or range(1, campaign.legs + 1)]
        return cls(campaign.position, campaign.poses.rotation, campaign.length[:, columns])

    @cached_property
    def _columns(self) -> ArrayPair:
        """P (3, 1, N) and R (3, 3, 1, N): numpy is several times faster with long columns than with short rows."""
        place, turn = self.position.T[:, None], self.rotation.transpose(1, 2, 0)[:, :, None]
        return np.ascontiguousarray(place), np.ascontiguousarray(turn)

    def values(self, x: Floats) -> Floats:
        """g, (N, n)."""
        return np.ascontiguousarray(np.linalg.norm(self._vectors(x)[0], axis=0).T) - (self.length + x[:, 6])

    def by_parameters(self, x: Floats) -> Floats:
        """dg/dx, (N, n, 7): [-v/||v||, R' v/||v||, -1]."""
        (along, _), (_, turn) = self._directions(x), self._columns
        turned = (along[:, None] * turn).sum(axis=0)
        return np.ascontiguousarray(np.concatenate([-along, turned, -np.ones_like(along[:1])]).T)

    def weighted_by_parameters(self, weight: Floats, x: Floats) -> Floats:
        """d(W_k g_k)/dx of all measurements, (N n, 7 n), for weights W (N, n, n): rows by measurement, then leg."""
        product = weight[..., None] * self.by_parameters(x)[:, None]
        return product.reshape(self.length.size, x.size)

    def by_pose(self, x: Floats) -> Floats:
        """dg/d(P, theta), (N, n, 6): [v, R b x v] / ||v||; per mm and per rad. By the leg readings it is -1."""
        along, arm = (np.ascontiguousarray(part.T) for part in self._directions(x))
        return np.concatenate([along, np.cross(arm, along)], axis=-1)

    def _vectors(self, x: Floats) -> ArrayPair:
        """v and R b, each (3, n, N)."""
        (place, turn), b = self._columns, x[:, 3:6, None]
        # einsum adds in this order on most machines: the last bits of a fit move all that is found around it
        arm = turn[:, 0] * b[:, 0] + turn[:, 2] * b[:, 2] + turn[:, 1] * b[:, 1]
        return place + arm - x.T[:3, :, None], arm

    def _directions(self, x: Floats) -> ArrayPair:
        """v / ||v|| and R b, each (3, n, N)."""
        vector, arm = self._vectors(x)
        return vector / np.maximum(np.linalg.norm(vector, axis=0), _SHORTEST), arm


# ------------------------------------------------------------------------------------------------------------------
# Measurements that repeat others: copied rows, and campaigns that show one pose only.

_STILL = 1e-3  # of the leg length, and rad: poses this close are one pose for any purpose of calibration
_NAMED = 3  # pairs in a sentence


def copied_rows(campaign: Campaign) -> str | None:
    """A sentence on rows that hold the same numbers as an earlier one; sensors never read the same twice."""
    table = np.hstack([campaign.position, campaign.quaternion, campaign.length])
    whole = table.view(f"V{table.itemsize * table.shape[1]}")[:, 0]  # a row as one value: its bytes
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    earlier = first[which]
    copies = np.flatnonzero(earlier != np.arange(len(table)))
    if not len(copies):
        return None
    ids = campaign.measurement_ids
    named = ", ".join(f"{ids[row]} as {ids[earlier[row]]}" for row in copies[:_NAMED])
    more = " and others" if len(copies) > _NAMED else ""
    some = "1 measurement holds" if len(copies) == 1 else f"{len(copies)} measurements hold"
    return f"{some} the same numbers as an earlier one ({named}{more}): take copies out, they count as evidence."


def single_pose(campaign: Campaign) -> str | None:
    """A sentence on a campaign whose poses are all the same."""
    if len(campaign) < 2:
        return None
    size = float(np.median(np.abs(campaign.length + campaign.robot.offset)))
    moved = float(np.abs(campaign.position - campaign.position[0]).max())
    angle = float(np.abs(turn_between(campaign.quaternion, campaign.quaternion[0])).max())
    if moved > _STILL * size or angle > _STILL:
        return None
    return (
        f"All {len(campaign)} measurements show the same pose (to within {about(moved, 2)} mm and "
        f"{about(np.degrees(angle), 2)} degrees): measure poses all over the workspace."
    )


# ------------------------------------------------------------------------------------------------------------------
# What a campaign states, as the search for mistakes sees it: a drawing, poses and readings that should agree.


@dataclass(frozen=True, eq=False)
class Given:
    """A robot, N poses and the readings (N, n) mm of its legs. All may be wrong."""

    robot: Robot
    pose: Pose
    length: Floats

    @classmethod
    def of(cls, campaign: Campaign) -> Given:
        return cls(campaign.robot, campaign.poses, campaign.length)

    def rows(self, chosen: Indices) -> Given:
        return replace(self, pose=self.pose.rows(chosen), length=self.length[chosen])

    def posed(self, position: Floats, quaternion: Floats) -> Given:
        return replace(self, pose=Pose(position, quaternion))

    def read(self, length: Floats) -> Given:
        return replace(self, length=length)

    def drawn(self, parameters: Floats) -> Given:
        """With another drawing, (n, 7) mm; absurd numbers are cut, so that any can be tried."""
        cut = np.clip(parameters, -LARGEST, LARGEST)
        return replace(self, robot=Robot.from_parameters(self.robot.name, cut))

    @property
    def nominal(self) -> Floats:
        """(N, n) mm, the leg lengths that the drawing and the poses give."""
        return norms(leg_vectors(self.robot, self.pose))

    @property
    def off(self) -> Floats:
        """(N, n) mm: |nominal residual|."""
        return np.abs(self.nominal - self.robot.offset - self.length)

    def share(self, quantile: float = 0.5) -> float:
        """|nominal residual| / nominal leg length that so many of the measurements do not exceed, of the worst leg: a
        few odd rows do not move it."""
        shares = self.off / np.maximum(self.nominal, TINY)
        return float(np.quantile(shares, quantile, axis=0).max())
