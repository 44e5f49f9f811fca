"""Given points of a leg, such as least-squares fits, measurement by measurement (the paper, section 5.1.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpcal.checker import Accepted
from cpcal.common.errors import Problems, refuse, unusable
from cpcal.common.files import StrPath
from cpcal.common.values import ArrayLike, Names, Numbers, all_finite, floats
from cpcal.files import campaign_sha256
from cpcal.files.folders import keep_beside
from cpcal.files.run_folder import FITTED, answers_into
from cpcal.models import PLAIN, LegModel, beyond_legs, built_in, leg_box, leg_network, leg_statement
from cpcal.questions import CalibrationRecord
from cpcal.questions.question import chosen_model
from cpcal.questions.result import VerifiedPoint, check_campaign
from cpcal.robot import Campaign
from cpcal.solver.certificate.float_rows import at_point, failing, holding
from cpcal.solver.certificate.prover import claims
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.interval import Box
from cpcal.solver.optimize.witness import verify_point


@dataclass(frozen=True)
class VerifiedFit:
    """A point of one leg, and how many measurements it is proved to satisfy, and to fail."""

    leg: int
    point: Numbers
    verified: VerifiedPoint


@dataclass(frozen=True)
class PointResult(VerifiedFit):
    """What is proved of a point of one leg: `holds` and `fails` name the measurements (pose/run)."""

    holds: Names
    fails: Names


def certify_point(
    campaign: Campaign,
    leg: int,
    point: ArrayLike,
    *,
    eps: float = 0.0,
    certificate: StrPath | None = None,
    model: str | LegModel | None = None,
) -> PointResult:
    """For each measurement: does the point (ax, ay, az, bx, by, bz, l) in mm satisfy its equation to within `eps` mm?

    It does when THERE EXISTS a reading in the measurement's set with |g| <= eps; it fails when for no reading it does;
    both are proved. `model` is the leg model, as in `certify` (default: the campaign's, else plain); its extra
    parameters follow l in the point. `certificate` names a file for `cpcal verify`; what the exact check cannot repeat
    is then left out. User-defined models have none.
    Raises InputError.
    """
    x = floats(point)
    legs = f"choose from 1 to {campaign.legs}"
    problems = Problems()
    with problems.kept():
        corrected = chosen_model(campaign, model)
    with problems.kept():
        refuse(
            (not 1 <= leg <= campaign.legs, "leg", f"there is no leg {leg}", legs),
            (not 0.0 <= eps < np.inf, "eps", f"{eps} is no tolerance", "give a number of mm, 0 or more"),
        )
    problems.raise_any()
    names = corrected.parameters
    misfit, what = x.shape != (len(names),) or not all_finite(x), f"{len(names)} finite numbers"
    custom = certificate is not None and not built_in(corrected)
    refuse(
        (misfit, "point", f"a point of the {corrected.name} model is {what}", f"give {', '.join(names)}"),
        (custom, "certificate", f"{corrected.name!r}, a user-defined model, has none", "leave it out"),
    )
    Problems(beyond_legs(campaign, leg, float(x[6]), eps, "eps")).raise_any()
    box = leg_box(x, 0.0, corrected).with_bounds(x, x)
    proved = verify_point(leg_network(campaign, leg, box, eps=(eps, eps), model=corrected), np.append(x, eps))
    good, bad = (np.flatnonzero(rows).tolist() for rows in (proved.holds, proved.fails))
    if certificate is not None:
        at_eps, statement = np.append(x, eps), leg_statement(campaign, leg, model=corrected.name)
        problem, at = statement.problem, at_point(at_eps.tolist())
        good = [k for k in good if holding(problem, at, k) is not None]
        bad = [k for k in bad if failing(problem, at, k) is not None]
        keep_beside(campaign, certificate)
        with Recording(statement, Box((*corrected.parameters, "eps"), at_eps, at_eps)) as recording:
            recording.write(certificate, claims(eps, point=at_eps, holds=good, fails=bad))
    ids = campaign.measurement_ids
    counts = VerifiedPoint(eps, len(good), len(bad), len(campaign))
    return PointResult(leg, tuple(map(float, x)), counts, tuple(ids[k] for k in good), tuple(ids[k] for k in bad))


# ------------------------------------------------------------------------------------------------------------------
# x_c and x_c_sigma as solutions: how many measurements refute each, leg by leg.
#
# A folder of fits holds campaign.json and a certificate for each leg of each fit. It states nothing else: what is known
# of the fits is what the checker accepts.

Fits = Mapping[str, list[VerifiedFit]]  # legs in ascending order, of "x_c" and of "x_c_sigma"
_FITS = ("x_c", "x_c_sigma")


def certify_fits(
    campaign: Campaign, record: CalibrationRecord, folder: StrPath, *, legs: Sequence[int] | None = None
) -> Fits:
    """Verify both fits of the record by `certify_point` at eps = 0, with certificates in `folder`.

    They are fits of the plain model. Raises InputError when the record is of another campaign, or the folder cannot be
    written.
    """
    check_campaign(campaign, {"calibration record": record.campaign_sha256}, "calibrate again")
    found: Fits = {name: [] for name in _FITS}
    with answers_into(folder, FITTED) as draft:
        for name, fits in found.items():
            for leg in sorted(legs or range(1, campaign.legs + 1)):
                path, values = draft / f"{name}.leg{leg}.cert.jsonl", getattr(record, name).values
                point = certify_point(campaign, leg, values[leg - 1], certificate=path, model=PLAIN.name)
                fits.append(VerifiedFit(leg, point.point, point.verified))
    return found


def fits_of(folder: Path, campaign: Campaign, legs: Sequence[int], accepted: Mapping[str, Accepted | str]) -> Fits:
    """What the certificates of a folder prove of these legs; a text says why one is refused. Raises InputError."""
    found: Fits = {name: [] for name in _FITS}
    sha256, expected = campaign_sha256(campaign), [(name, leg) for name in _FITS for leg in sorted(legs)]
    files = {f"{name}.leg{leg}.cert.jsonl": (name, leg) for name, leg in expected}
    for file in [*files, *(accepted.keys() - files.keys())]:
        one, what = accepted.get(file, "it is missing"), ""
        name, leg = files.get(file, ("", 0))
        if isinstance(one, str):
            what = one
        elif (one.leg, one.model, one.campaign) != (leg, PLAIN.name, sha256) or (point := one.claims.point) is None:
            what = "it proves nothing of a fit that is called so"
        elif len(one.chosen) < one.count:
            what = "it leaves measurements out"
        else:
            *at, eps = map(float, point.at)
            counts = VerifiedPoint(eps, len(point.holds), len(point.fails), one.count)
            found[name].append(VerifiedFit(leg, tuple(at), counts))
        if what:
            raise unusable(str(folder / file), f"is refused: {what}", "certify the fits again")
    return found
