"""Certification of a given point, such as a least-squares fit (section 5.1.2 of the paper)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from fractions import Fraction as F

import numpy as np
import numpy.typing as npt

from cpcal.calibration import PLAIN, LegModel, leg_box, leg_network, leg_statement
from cpcal.errors import InputError, Problem
from cpcal.interval import Arithmetic, get_arithmetic
from cpcal.judged import Judged
from cpcal.optimize import judge
from cpcal.prove import Recording, claims_judged
from cpcal.robot import Campaign


@dataclass(frozen=True)
class PointResult:
    """What is proved of a point of one leg: `judged` counts, `holds` and `fails` name the measurements (pose/run)."""

    leg: int
    point: tuple[float, ...]
    judged: Judged
    holds: tuple[str, ...]
    fails: tuple[str, ...]


def certify_point(
    campaign: Campaign,
    leg: int,
    point: npt.ArrayLike,
    *,
    eps: float = 0.0,
    arithmetic: str = "float64",
    certificate: str | os.PathLike[str] | None = None,
) -> PointResult:
    """For each measurement: does the point (ax, ay, az, bx, by, bz, l) in mm satisfy its equation to within `eps` mm?

    It does when THERE EXISTS a reading in the measurement's set with |g| <= eps; it fails when for no reading it does;
    both are proved. The model is the plain one. `certificate` names a file for `cpcal verify`; what the exact check
    cannot repeat is then left out.
    Raises InputError.
    """
    x = np.asarray(point, np.float64)
    if not 1 <= leg <= campaign.legs:
        raise InputError([Problem("leg", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}")])
    if x.shape != (7,) or not np.isfinite(x).all() or not (np.isfinite(eps) and eps >= 0.0):
        what = "a point is seven finite numbers, and eps a finite one from 0"
        raise InputError([Problem("point", what, "give (ax, ay, az, bx, by, bz, l) and eps in mm")])
    good, bad = judged_rows(campaign, leg, x, eps, get_arithmetic(arithmetic))
    if certificate is not None:
        good, bad = _certified(campaign, leg, x, eps, good, bad, certificate)
    ids = campaign.measurement_ids
    counts = Judged(eps, len(good), len(bad), len(campaign))
    return PointResult(leg, tuple(map(float, x)), counts, tuple(ids[k] for k in good), tuple(ids[k] for k in bad))


def judged_rows(
    campaign: Campaign,
    leg: int,
    x: npt.NDArray[np.float64],
    eps: float,
    engine: Arithmetic,
    model: LegModel = PLAIN,
) -> tuple[list[int], list[int]]:
    """Numbers (from 0) of the measurements that the point (n,) of the model is proved to satisfy, and to fail."""
    box = leg_box(x, 0.0, model).with_bounds(x, x)
    network = leg_network(campaign, leg, box, engine=engine, eps=(eps, eps), model=model)
    found = judge(network, np.append(x, eps), engine)
    return np.flatnonzero(found.holds).tolist(), np.flatnonzero(found.fails).tolist()


def _certified(
    campaign: Campaign,
    leg: int,
    x: npt.NDArray[np.float64],
    eps: float,
    good: list[int],
    bad: list[int],
    path: str | os.PathLike[str],
) -> tuple[list[int], list[int]]:
    """Write the claims that the checker's own arithmetic repeats."""
    statement, at = leg_statement(campaign, leg), tuple(F(float(v)) for v in [*x, eps])
    good = [k for k in good if statement.problem.holds(k, at)]
    bad = [k for k in bad if statement.problem.fails(k, at)]
    domain = leg_network(campaign, leg, leg_box(x, 0.0), engine=get_arithmetic("float64"), eps=(eps, eps)).domain
    with Recording(statement, domain) as recording:
        recording.write(path, claims_judged(np.append(x, eps), eps, good, bad))
    return good, bad
