"""Campaigns and studies that are changed: other sensors, fewer measurements."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cpcal.questions import LegBracket, LegResult, Recommended, Work
from cpcal.robot import Pose, PoseTable, Study, Truth, compose, inverse, pose_jacobian
from cpcal.simulate.campaigns import streams


def put(*place, to):
    """A change of JSON: what stands at a place becomes `to`, or what `to` makes of it."""

    def change(data):
        for key in place[:-1]:
            data = data[key]
        data[place[-1]] = to(data[place[-1]]) if callable(to) else to

    return change


def with_gain(campaign, gain):
    """The same robot read by sensors that show L / (1 + gain)."""
    return replace(campaign, length=campaign.length / (1.0 + gain))


def some(campaign, rows):
    """Some of the measurements."""
    arrays = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")
    names = {name: tuple(np.array(getattr(campaign, name))[rows]) for name in ("pose", "run")}
    return replace(campaign, **names, **{name: getattr(campaign, name)[rows] for name in arrays})


def of_poses(study, names):
    """A study of which only these configurations are left to calibrate with."""
    table = study.calibration
    rows = [k for k, name in enumerate(table.pose) if name in names]
    values = {name: getattr(table, name) for name in table.__dataclass_fields__}
    chosen = {name: None if v is None else np.array(v)[rows] for name, v in values.items()}
    return replace(study, calibration=PoseTable(**chosen))


_OF_BRACKET = {"verdict", "point", "center", "enclosure", "certificate"}
_OF_WORK = {"nodes", "programs", "seconds", "pending", "floor", "trials"}


def leg_with(leg, /, **changes):
    """A leg's result (None: a new one) with fields of its groups changed: eps_lo, point, support, nodes and so on."""
    lo_hi = {name.removeprefix("eps_"): changes.pop(name) for name in ("eps_lo", "eps_hi") if name in changes}
    bracket = {name: changes.pop(name) for name in _OF_BRACKET & changes.keys()} | lo_hi
    work = {name: changes.pop(name) for name in _OF_WORK & changes.keys()}
    if leg is None:
        point = tuple(np.zeros(len(bracket["enclosure"].names)).tolist())
        best = {"recommended": Recommended(point, "least squares", np.inf)}
        return LegResult(bracket=LegBracket(**bracket), work=Work(**work), **(best | changes))
    return replace(leg, bracket=replace(leg.bracket, **bracket), work=replace(leg.work, **work), **changes)


# What spoils a simulated study between truth and table; none of it is known to the calibration.


def mobile_in_base(truth: Truth, table: PoseTable) -> Pose:
    """The poses of the mobile frame in the base frame that the table's poses mean."""
    return compose(compose(inverse(truth.camera), table.poses), inverse(truth.target))


def with_robot_scatter(study: Study, sigma: float, *, seed: int = 0) -> Study:
    """The legs come back to within `sigma` mm only (standard deviation); camera and sensors both see where to."""
    truth = study.truth
    assert truth is not None

    def moved(table: PoseTable, stream: np.random.Generator) -> PoseTable:
        runs = {key: k for k, key in enumerate(dict.fromkeys(zip(table.pose, table.run, strict=True)))}
        draw = stream.standard_normal((len(runs), table.legs))  # the same for all images of a run
        longer = sigma * draw[[runs[key] for key in zip(table.pose, table.run, strict=True)]]
        poses = mobile_in_base(truth, table)
        poses = poses.moved(np.linalg.solve(pose_jacobian(truth.robot, poses), longer[..., None])[..., 0])
        seen = compose(compose(truth.camera, poses), truth.target)
        return replace(table, position=seen.position, quaternion=seen.quaternion, length=table.length + longer)

    return _each(study, moved, seed)


def with_drift(study: Study, size: float, *, leg: int = 1) -> Study:
    """The sensor of a leg (from 1) drifts by `size` mm from the first run to the last, evenly."""

    def drifted(table: PoseTable, _: np.random.Generator) -> PoseTable:
        runs = {name: k for k, name in enumerate(dict.fromkeys(table.run))}
        share = np.array([runs[name] for name in table.run]) / max(len(runs) - 1, 1)
        length = table.length.copy()
        length[:, leg - 1] += size * share
        return replace(table, length=length)

    return _each(study, drifted, 0)


def with_outliers(study: Study, share: float, size: float, *, seed: int = 0) -> Study:
    """A share of the rows has one reading, of a leg or of a position, that is off by `size` mm, up or down."""

    def spoiled(table: PoseTable, stream: np.random.Generator) -> PoseTable:
        position, length = table.position.copy(), table.length.copy()
        for row in np.flatnonzero(stream.random(len(table)) < share):
            column, sign = int(stream.integers(3 + table.legs)), float(stream.choice([-1.0, 1.0]))
            values, k = (position, column) if column < 3 else (length, column - 3)
            values[row, k] += sign * size
        return replace(table, position=position, length=length)

    return _each(study, spoiled, seed)


def _each(study: Study, change: Callable[[PoseTable, np.random.Generator], PoseTable], seed: int) -> Study:
    """Both tables, each with a stream of its own."""
    first, second = streams(seed, 2)
    return replace(study, calibration=change(study.calibration, first), validation=change(study.validation, second))
