"""Statistics of repeated measurements: centred distributions and their spread (the paper, tables 2, 3, figures 3, 4).

A configuration (a commanded pose) is measured r times; a reading's deviation is from its configuration's mean. With N
readings in K configurations the standard deviation is sqrt(sum of squares / (N - K)): one degree of freedom is spent on
each mean. What all readings of a configuration have in common (a bias, a backlash always taken up from one side) is
in the mean and cannot be seen here.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, Ints
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import frozen_array
from cpcal.robot import Campaign, quaternion_conjugate, quaternion_product, rotation_vector

POSE_CHANNELS = ("x", "y", "z", "rx", "ry", "rz")  # mm and rad


@dataclass(frozen=True, eq=False)
class Deviations:
    """N readings of C channels, each less its configuration's mean.

    names     of the K configurations, in the order of their first reading
    group     (N,) which configuration each reading belongs to, from 0
    row_names N texts that identify the readings
    channels  C names
    values    (N, C) deviations, in each channel's unit
    """

    names: tuple[str, ...]
    group: Ints
    row_names: tuple[str, ...]
    channels: tuple[str, ...]
    values: Floats

    @cached_property
    def repeats(self) -> Ints:
        """(K,) readings of each configuration."""
        return np.bincount(self.group, minlength=len(self.names)).astype(np.int64)

    @property
    def freedom(self) -> int:
        """N - K."""
        return len(self.group) - len(self.names)

    @cached_property
    def sigma(self) -> Floats:
        """(C,) standard deviations of one reading, pooled over the configurations, divisor N - K."""
        return np.asarray(np.sqrt(np.sum(self.values**2, axis=0) / self.freedom))

    @cached_property
    def errors(self) -> Floats:
        """(N', C) deviations times sqrt(r / (r - 1)), of configurations with r >= 2.

        A deviation from the mean of r readings has (r - 1) / r of a reading's variance; these have all of it, and stand
        for the errors of single readings in what follows (they are nearly independent when r is large).
        """
        r = self.repeats[self.group]
        several = r > 1
        return np.asarray(self.values[several] * np.sqrt(r[several] / (r[several] - 1.0))[:, None])

    def without(self, rows: Sequence[int]) -> Deviations:
        """With these readings left out, and means and deviations formed again."""
        keep = np.setdiff1d(np.arange(len(self.group)), np.asarray(rows, dtype=np.int64))
        names = [self.names[k] for k in self.group[keep]]
        return deviations(names, self.values[keep], self.channels, [self.row_names[k] for k in keep])


def deviations(
    configuration: Sequence[Hashable],
    values: npt.ArrayLike,
    channels: Sequence[str] | None = None,
    row_names: Sequence[str] | None = None,
) -> Deviations:
    """Of a table of N readings: the configuration of each, and values (N, C) of C channels in any units.

    For rotations use `campaign_deviations`, which averages them as rotations. Raises InputError when the table is no
    table of finite numbers, or nothing is repeated.
    """
    try:
        table = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError([Problem("readings", str(error), "give numbers, (N, C)")]) from None
    if table.ndim != 2 or len(table) != len(configuration) or not table.size:
        what = f"have the shape {table.shape} for {len(configuration)} configurations"
        raise InputError([Problem("readings", what, "give one row for each reading, (N, C)")])
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise InputError([Problem("readings", f"row {bad[0]} holds a NaN or an infinity", "give finite numbers")])
    titles = tuple(f"c{k}" for k in range(table.shape[1])) if channels is None else tuple(channels)
    labels = tuple(f"row {k}" for k in range(len(table))) if row_names is None else tuple(row_names)
    if len(titles) != table.shape[1] or len(labels) != len(table):
        raise InputError([Problem("readings", "names do not fit the table", "name each channel and each row once")])
    group, names = grouped(configuration)
    centred = table - group_means(table, group, len(names))[group]
    return Deviations(names, group, labels, titles, frozen_array(centred))


def campaign_deviations(campaign: Campaign) -> Deviations:
    """Of a campaign whose poses were measured in several runs: position (mm), rotation (rad) and leg readings (mm).

    Channels x y z rx ry rz L1 ... Ln. A rotation deviates from its configuration's mean rotation by the vector t with
    R = R(t) R_mean, in the base frame, as in the reading sets.
    """
    group, names = grouped(campaign.pose)
    mean = mean_rotations(campaign.quaternion, group, len(names))[group]
    turned = rotation_vector(quaternion_product(campaign.quaternion, quaternion_conjugate(mean)))
    channels = (*POSE_CHANNELS, *(f"L{leg}" for leg in range(1, campaign.legs + 1)))
    table = np.concatenate([campaign.position, turned, campaign.length], axis=1)
    return deviations(campaign.pose, table, channels, campaign.measurement_ids)


def mean_rotations(quaternion: Floats, group: Ints, count: int) -> Floats:
    """(count, 4) unit quaternions, scalar >= 0: of each group, that with the least sum of squared chords to all.

    The main eigenvector of sum q q' (Markley, Cheng, Crassidis and Oshman 2007), for which q and -q are the same.
    """
    outer = np.zeros((count, 4, 4))
    np.add.at(outer, group, quaternion[:, :, None] * quaternion[:, None, :])
    mean = np.linalg.eigh(outer)[1][:, :, -1]
    return np.asarray(np.where(mean[:, :1] < 0, -mean, mean))


def grouped(configuration: Sequence[Hashable], *, repeated: bool = True) -> tuple[Ints, tuple[str, ...]]:
    """The number of each row's configuration, and the configurations' names.

    Raises InputError if none is repeated, where that is asked for.
    """
    number: dict[Hashable, int] = {}
    group = np.array([number.setdefault(name, len(number)) for name in configuration], dtype=np.int64)
    if repeated and len(number) == len(group):
        what = f"holds each of its {len(group)} configurations once"
        remedy = "measure configurations several times: pose repeats, run differs"
        raise InputError([Problem("table of repeats", what, remedy)])
    return group, tuple(str(name) for name in number)


def group_means(table: Floats, group: Ints, count: int) -> Floats:
    """(count, C) means of each group's rows."""
    total = np.zeros((count, table.shape[1]))
    np.add.at(total, group, table)
    return np.asarray(total / np.bincount(group, minlength=count)[:, None])
