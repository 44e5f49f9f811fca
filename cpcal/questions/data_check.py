"""Is the data of a campaign good enough before a long run? What looks wrong, and what stays open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.fit import robust_scale
from cpcal.common.numbers import about
from cpcal.common.values import TINY, Floats, Names, Numbers, norms
from cpcal.models import PLAIN, LegModel, ModelResiduals, reading_moves
from cpcal.questions.result import Determination
from cpcal.robot import Campaign, LegEquations
from cpcal.robot.campaign import Given, copied_rows, single_pose
from cpcal.robot.mistakes import Spread, doubts, spread_of

# ------------------------------------------------------------------------------------------------------------------
# Which parameters the measurements of a leg leave open: the rank of its Jacobian, in floating point.

# Of the equations' change (root mean square), when each column of the Jacobian is scaled to one: a direction of the
# parameters that changes them less is not told from an error of 0.01 mm within some 10 mm.
_SEEN = 1e-3
_OPEN = 0.1  # of a parameter in such a direction, from which it is called undetermined


def determination(campaign: Campaign, leg: int, x: Floats, model: LegModel) -> Determination:
    """At parameters x (n,) of one leg and the centres of the reading sets."""
    jacobian = ModelResiduals(campaign, leg, model).jacobian(x)
    square = jacobian.T @ jacobian
    size = np.maximum(norms(jacobian.T), TINY)
    values, vectors = np.linalg.eigh(square / size / size[:, None])  # squares of singular values: seen to 1e-8
    seen = values > _SEEN**2
    hidden = norms(vectors[:, ~seen])
    lost = tuple(name for name, share in zip(model.parameters, hidden, strict=True) if share > _OPEN)
    return Determination(len(jacobian), len(size), int(seen.sum()), lost)


# ------------------------------------------------------------------------------------------------------------------
# Measurements that do not fit the others: residuals of a robust fit that are far beyond the rest. No proof.

_FAR = 10.0  # robust standard deviations; the largest of 10,000 normal numbers is at 4
_LEAST = 12  # measurements: fewer can be fitted one and all
_ROUNDING = 1e-9  # of the leg length: residuals below it are none
_NAMED = 5  # measurements in a list


def odd_rows(campaign: Campaign, x: Floats) -> list[str]:
    """One sentence for each measurement that is far off at parameters x (n, 7), worst first; the last counts the rest.

    Residuals are judged beside what each measurement's reading sets allow, and inside of it nothing is odd.
    """
    if len(campaign) < _LEAST:
        return []
    off = np.abs(LegEquations.of(campaign).values(x))
    allowed = np.stack([reading_moves(campaign, leg, own).sum(axis=1) for leg, own in enumerate(x, 1)], axis=1)
    share = off / np.where((allowed > 0.0).all(axis=0), allowed, 1.0)
    least = _ROUNDING * np.abs(campaign.length + x[:, 6]).max(axis=0)
    far = (share > [_FAR * robust_scale(leg) for leg in share.T]) & (off > allowed + least)
    worst = (off * far).max(axis=1)
    rows, said = np.flatnonzero(far.any(axis=1)), []
    for row in rows[np.argsort(-worst[rows])][:_NAMED]:
        wrong, off_by = ", ".join(map(str, np.flatnonzero(far[row]) + 1)), about(float(worst[row]))
        what = f"leg {wrong} reads {off_by} mm off what the others let expect"
        if far[row].sum() > 1:
            what = f"its pose does not fit the readings of legs {wrong} (off by up to {off_by} mm)"
        said.append(f"{campaign.measurement_ids[row]}: {what}.")
    return said + [f"{len(rows) - _NAMED} more measurements are as far off."] * (len(rows) > _NAMED)


_FITTED = 20_000  # measurements

_MORE = "Measure poses that differ more; what the robot cannot move stays open."


@dataclass(frozen=True, eq=False)
class DataCheck:
    """What `check_data` found. Estimates in floating point, no proofs.

    findings  sentences: what to look at, most important first; none: the data are fit to be certified
    nominal   (n,) mm, the median of each leg's |residual| at the nominal parameters
    spread    of the residuals of a fit, beside what is stated
    legs      which parameters of each leg the poses leave open; empty where a mistake, or a single pose, makes that
              meaningless
    """

    findings: Names
    nominal: Numbers
    spread: Spread
    legs: tuple[Determination, ...]

    @property
    def good(self) -> bool:
        """Whether nothing was found."""
        return not self.findings


def check_data(campaign: Campaign) -> DataCheck:
    """Check a campaign: mistakes of units, orders and frames; odd and copied rows; open parameters.

    Raises no error for bad data: what is wrong is in `findings`. Of a large campaign 2,000 measurements, spread
    evenly, are fitted, and 20,000 say what is open; odd and copied rows are sought among all.
    """
    seen, still = spread_of(campaign), single_pose(campaign)
    mistake, others = doubts(campaign, seen) if still is None else (still, [])
    findings = list(filter(None, (mistake, *others, copied_rows(campaign))))
    nominal = tuple(np.median(Given.of(campaign).off, axis=0).tolist())
    if mistake is not None:
        return DataCheck(tuple(findings), nominal, seen, ())
    sample, x = campaign.sampled(_FITTED), seen.fitted
    legs = tuple(determination(sample, leg, x[leg - 1], PLAIN) for leg in range(1, campaign.legs + 1))
    groups: dict[str, list[int]] = {}
    for leg, found in enumerate(legs, 1):
        groups.setdefault(found.sentence, []).append(leg)
    findings += odd_rows(campaign, x)
    findings += [
        f"Leg{'s' * (len(n) > 1)} {', '.join(map(str, n))}: {said} {_MORE}" for said, n in groups.items() if said
    ]
    return DataCheck(tuple(findings), nominal, seen, legs)
