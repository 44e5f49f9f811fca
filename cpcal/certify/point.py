"""Certification of a given point, such as a least-squares fit (section 5.1.2 of the paper)."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.certify.asked_model import chosen_model
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.common.errors import InputError, Problem
from cpcal.files.folders import keep_beside
from cpcal.legs import PLAIN, LegModel, beyond_legs, built_in, leg_box, leg_network, leg_statement
from cpcal.results import VerifiedPoint
from cpcal.robot import Campaign
from cpcal.solver.certificate.readings import at_point, failing, holding
from cpcal.solver.certificate.recording import Recording, claims_verified
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.optimize import PointVerdicts, verify_point


@dataclass(frozen=True)
class PointResult:
    """What is proved of a point of one leg: `verified` counts, `holds` and `fails` name the measurements (pose/run)."""

    leg: int
    point: tuple[float, ...]
    verified: VerifiedPoint
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
    model: str | LegModel | None = None,
) -> PointResult:
    """For each measurement: does the point (ax, ay, az, bx, by, bz, l) in mm satisfy its equation to within `eps` mm?

    It does when THERE EXISTS a reading in the measurement's set with |g| <= eps; it fails when for no reading it does;
    both are proved. `model` is the leg model, as in `certify` (default: the campaign's, else plain); its extra
    parameters follow l in the point. `certificate` names a file for `cpcal verify`; what the exact check cannot repeat
    is then left out. User-defined models have none.
    Raises InputError.
    """
    x = np.asarray(point, np.float64)
    corrected, wrong = chosen_model(campaign, model, None)
    if not 1 <= leg <= campaign.legs:
        wrong.append(Problem("leg", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}"))
    if not (np.isfinite(eps) and eps >= 0.0):
        wrong.append(Problem("eps", f"{eps} is no tolerance", "give a number of mm, 0 or more"))
    if not wrong and (x.shape != (len(corrected.parameters),) or not np.isfinite(x).all()):
        what = f"a point of the {corrected.name} model is {len(corrected.parameters)} finite numbers"
        wrong.append(Problem("point", what, f"give {', '.join(corrected.parameters)}"))
    if certificate is not None and not built_in(corrected):
        wrong.append(Problem("certificate", f"{corrected.name!r}, a user-defined model, has none", "leave it out"))
    if not wrong:
        wrong += beyond_legs(campaign, leg, float(x[6]), eps, "eps")
    if wrong:
        raise InputError(wrong)
    good, bad = verified_rows(campaign, leg, x, eps, get_arithmetic(arithmetic), corrected)
    if certificate is not None:
        good, bad = _certified(campaign, leg, x, eps, good, bad, certificate, corrected)
    ids = campaign.measurement_ids
    counts = VerifiedPoint(eps, len(good), len(bad), len(campaign))
    return PointResult(leg, tuple(map(float, x)), counts, tuple(ids[k] for k in good), tuple(ids[k] for k in bad))


def verified_rows(
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
    return _numbers(verify_point(network, np.append(x, eps), engine))


def verified_center(leg: PreparedLeg) -> tuple[list[int], list[int]]:
    """The same of the center of a leg, at the eps that is asked about, or 0."""
    point = np.append(leg.center, leg.question.options.eps or 0.0)
    return _numbers(verify_point(leg.network, point, leg.question.engine, leg.problem.prover.reading))


def _numbers(found: PointVerdicts) -> tuple[list[int], list[int]]:
    return np.flatnonzero(found.holds).tolist(), np.flatnonzero(found.fails).tolist()


def _certified(
    campaign: Campaign,
    leg: int,
    x: npt.NDArray[np.float64],
    eps: float,
    good: list[int],
    bad: list[int],
    path: str | os.PathLike[str],
    model: LegModel,
) -> tuple[list[int], list[int]]:
    """Write the claims that the checker's own arithmetic repeats."""
    at_eps, statement = np.append(x, eps), leg_statement(campaign, leg, model=model.name)
    problem, at = statement.problem, at_point(at_eps.tolist())
    good = [k for k in good if holding(problem, at, k) is not None]
    bad = [k for k in bad if failing(problem, at, k) is not None]
    keep_beside(campaign, path)
    with Recording(statement, Box((*model.parameters, "eps"), at_eps, at_eps)) as recording:
        recording.write(path, claims_verified(at_eps, eps, good, bad))
    return good, bad
