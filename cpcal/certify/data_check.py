"""Is the data of a campaign good enough before a long run? What looks wrong, what stays open, what to expect."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from cpcal.certify.odd_rows import odd_rows, robust_parameters
from cpcal.certify.outlook import LegOutlook, outlook
from cpcal.common.numbers import about
from cpcal.robot import Campaign
from cpcal.robot.campaign_problems import ARRAYS
from cpcal.robot.given import Given
from cpcal.robot.mistakes import SHARE, likely_cause
from cpcal.robot.repeated_rows import copied_rows, single_pose
from cpcal.robot.suspicions import mixed_up, sizes_in_question

SUSPICIOUS = 0.01  # of the leg length: `certify` warns later, since whoever runs `check` asks for more
_FITTED = 20_000  # measurements

_MORE = "Measure poses that differ more; what the robot cannot move stays open."


class FindingKind(Enum):
    """What a finding is about."""

    MISTAKE = "mistake"
    ODD_ROW = "odd row"
    COPY = "copy"
    SAME_POSE = "same pose"
    OPEN = "open parameters"


@dataclass(frozen=True)
class Finding:
    """One thing to look at, in a sentence."""

    kind: FindingKind
    sentence: str


@dataclass(frozen=True, eq=False)
class DataCheck:
    """What `check_data` found. Estimates in floating point, no proofs.

    findings  what to look at, most important first; none: the data are fit to be certified
    nominal   (n,) mm, the median of each leg's |residual| at the nominal parameters
    legs      what to expect of each leg; empty where a mistake, or a single pose, makes that meaningless
    """

    findings: tuple[Finding, ...]
    nominal: tuple[float, ...]
    legs: tuple[LegOutlook, ...]

    @property
    def good(self) -> bool:
        """Whether nothing was found."""
        return not self.findings


def check_data(campaign: Campaign) -> DataCheck:
    """Check a campaign: mistakes of units, orders and frames; odd and copied rows; open parameters; ranges to expect.

    Raises no error for bad data: what is wrong is in `findings`. Of a large campaign 20,000 measurements, spread
    evenly, are fitted and say what to expect; odd and copied rows are sought among all.
    """
    given = Given.of(campaign)
    typical = given.typical
    mistake = mistake_in(given, typical)
    findings = [
        Finding(FindingKind.MISTAKE, sentence) for sentence in [mistake, *sizes_in_question(campaign)] if sentence
    ]
    still = single_pose(campaign)
    for kind, sentence in ((FindingKind.SAME_POSE, still), (FindingKind.COPY, copied_rows(campaign))):
        if sentence:
            findings.append(Finding(kind, sentence))
    nominal = np.median(given.share * given.nominal, axis=0)
    if mistake is not None or still is not None:
        return DataCheck(tuple(findings), tuple(nominal.tolist()), ())
    sample = _spread(campaign, _FITTED)
    x = robust_parameters(sample)
    legs = tuple(outlook(sample, leg, x[leg - 1]) for leg in range(1, campaign.legs + 1))
    findings += [Finding(FindingKind.ODD_ROW, sentence) for sentence in odd_rows(campaign, x)]
    findings += [Finding(FindingKind.OPEN, sentence) for sentence in _open(legs)]
    return DataCheck(tuple(findings), tuple(nominal.tolist()), legs)


def _spread(campaign: Campaign, most: int) -> Campaign:
    """At most so many of its measurements, spread evenly."""
    if len(campaign) <= most:
        return campaign
    rows = np.linspace(0, len(campaign) - 1, most).astype(np.intp)
    pose, run = (tuple(names[k] for k in rows.tolist()) for names in (campaign.pose, campaign.run))
    return replace(campaign, pose=pose, run=run, **{name: getattr(campaign, name)[rows] for name in ARRAYS})


def mistake_in(given: Given, typical: float) -> str | None:
    """The sentence on drawing and readings that disagree; small disagreements need a known cause."""
    if typical <= SUSPICIOUS:
        return None
    cause = likely_cause(given)
    return mixed_up(typical, cause) if cause is not None or typical > SHARE else None


def _open(legs: tuple[LegOutlook, ...]) -> list[str]:
    """A sentence for legs with the same determination."""
    groups: dict[str, list[int]] = {}
    for leg in legs:
        if leg.determination.sentence:
            groups.setdefault(leg.determination.sentence, []).append(leg.leg)
    return [f"Leg{'s' * (len(n) > 1)} {', '.join(map(str, n))}: {sentence} {_MORE}" for sentence, n in groups.items()]


def expected(leg: LegOutlook) -> tuple[str, ...]:
    """The ranges as text: "±1.2" mm, or "open"."""
    return tuple("open" if not np.isfinite(value) else f"±{about(float(value), 2)}" for value in leg.ranges)
