"""The rows of one of a study's tables: as measured, without outliers, and as means of the images of each run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpcal.calibration.averaging import kept
from cpcal.calibration.repeatability import Repeatability
from cpcal.calibration.screening import THRESHOLD, Screening, beyond, scores, screen
from cpcal.calibration.statistics import campaign_deviations, group_means, grouped, mean_rotations
from cpcal.common.arrays import Floats, Ints
from cpcal.robot import Campaign, PoseTable, Robot


@dataclass(frozen=True, eq=False)
class StudyRows:
    """Measurements of a table, joint centres of the robot in any frames.

    all         every row
    screening   outliers among them; None where no pose is repeated, so that nothing tells them
    good        the rows without them
    runs        one measurement for each pose and run: means of the good rows' images. Where no pose has a second run,
                images count as runs; all_runs: with the outliers
    run_names   the runs of those
    run_shared      (N, 6) of those, and all_shared of all rows: deviations of the errors that all images share, mm and
                    rad; None where there are none
    """

    all: Campaign
    screening: Screening | None
    good: Campaign
    runs: Campaign
    all_runs: Campaign
    run_names: tuple[str, ...]
    run_shared: Floats | None
    all_shared: Floats | None

    @property
    def screened(self) -> Screening:
        """The screening of a table that has one."""
        assert self.screening is not None  # a table without repeats has no statistics, and was refused
        return self.screening

    @property
    def repeats(self) -> Ints:
        """(K,) runs of each pose, in the order of their first rows."""
        return np.bincount(grouped(self.runs.pose, repeated=False)[0]).astype(np.int64)

    def of(self, robot: Robot) -> StudyRows:
        """The same measurements of a robot whose joint centres stand elsewhere."""
        parts = {name: replace(getattr(self, name), robot=robot) for name in ("all", "good", "runs", "all_runs")}
        return replace(self, **parts)

    def single_sigma(self, repeats: Repeatability) -> Floats:
        """(6 + n,) standard deviations of single rows, less what the robot itself adds, mm and rad."""
        rows = np.concatenate([campaign_deviations(self.good).sigma[:6], repeats.total[6:]])
        own = rows**2 - (repeats.total**2 - repeats.noise_sigma**2)
        return np.asarray(np.sqrt(np.maximum(own, repeats.noise_sigma**2)))


def study_rows(table: PoseTable, robot: Robot) -> StudyRows:
    """The rows of a table, screened for outliers where poses are repeated."""
    rows = as_campaign(table, robot)
    found = _screened(rows, table)
    keep = np.ones(len(rows), dtype=np.bool_) if found is None else found.keep
    good = kept(rows, keep)
    runs = np.array(table.run if _has_runs(table) else rows.run)
    means, names = _run_means(good, tuple(runs[keep].tolist()))
    every = means if keep.all() else _run_means(rows, tuple(runs.tolist()))[0]
    return StudyRows(
        all=rows,
        screening=found,
        good=good,
        runs=means,
        all_runs=every,
        run_names=names,
        run_shared=None if table.shared is None else _run_shared(table.shared[keep], good, tuple(runs[keep].tolist())),
        all_shared=table.shared,
    )


def _run_shared(shared: Floats, rows: Campaign, runs: tuple[str, ...]) -> Floats:
    """Root mean squares over the images of each run: a mean of images has all of what they share."""
    group, _ = grouped(list(zip(rows.pose, runs, strict=True)), repeated=False)
    return np.asarray(np.sqrt(group_means(shared**2, group, int(group.max()) + 1)))


def _screened(rows: Campaign, table: PoseTable) -> Screening | None:
    """Poses row by row; leg readings run by run, as all images of a run hold the same ones."""
    if len(set(table.pose)) == len(table):
        return None
    spread = campaign_deviations(rows)
    if table.image is None or not _has_runs(table):
        return screen(spread)
    means, _ = _run_means(rows, table.run)
    run = grouped(list(zip(table.pose, table.run, strict=True)), repeated=False)[0]
    legs = scores(campaign_deviations(means))[run, 6:]
    return beyond(spread, np.concatenate([scores(spread)[:, :6], legs], axis=1), THRESHOLD)


def _has_runs(table: PoseTable) -> bool:
    """Whether some pose has a second run."""
    return len(set(zip(table.pose, table.run, strict=True))) > len(set(table.pose))


def as_campaign(table: PoseTable, robot: Robot) -> Campaign:
    """The rows of a table as measurements of a robot whose joint centres are in the frames of camera and target."""
    runs = table.run if table.image is None else [f"{r}:{i}" for r, i in zip(table.run, table.image, strict=True)]
    return Campaign.of(
        robot, table.position, table.quaternion, table.length, pose=list(table.pose), run=list(runs), exact=True
    )


def _run_means(rows: Campaign, runs: tuple[str, ...]) -> tuple[Campaign, tuple[str, ...]]:
    keys = list(zip(rows.pose, runs, strict=True))
    group, _ = grouped(keys, repeated=False)
    first = np.unique(group, return_index=True)[1]
    if len(first) == len(rows):
        return rows, runs
    names = tuple(runs[k] for k in first)
    means = Campaign.of(
        rows.robot,
        group_means(rows.position, group, len(first)),
        mean_rotations(rows.quaternion, group, len(first)),
        group_means(rows.length, group, len(first)),
        pose=[rows.pose[k] for k in first],
        run=list(names),
        exact=True,
    )
    return means, names
