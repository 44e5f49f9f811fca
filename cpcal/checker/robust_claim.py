"""Checks a robust claim: certificates that together prove a bound whichever q measurements are wrong.

docs/certificate-format.md, "Robust claims", is the specification.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .claims import Accepted
from .exact_campaign import NAME, ExactCampaign
from .files import ROBUST_NAME, WORK, Budget, content, parsed
from .leg import check_model
from .readers import finite, shown
from .refusal import Refused, Unusable
from .rule import meeting
from .run import STRANGE, Certificates, Json, compare, exact, nothing_beside, of_the_box, of_the_problem, reason_of

ROBUST_FORMAT = "cpcal-robust/2"


@dataclass(frozen=True)
class RobustChecked:
    """What is proved of one leg: `lo` and `hi` None where it is not certified. `refused`: why not."""

    leg: int
    outliers: int
    lo: F | None = None
    hi: F | None = None
    left_out: tuple[str, ...] = ()
    proofs: int = 0
    refused: str | None = None


def check_robust(folder: Path, *, work: int = WORK) -> list[RobustChecked]:
    """What is proved of every leg. Raises Unusable where there is nothing to check, Refused for the whole.

    `work`: what the check of all of it may cost.
    """
    if not folder.is_dir():
        raise Unusable(f"{shown(folder.name)} is no folder")
    try:
        text = content(folder / ROBUST_NAME)
        campaign = ExactCampaign(folder / NAME)
        result = parsed(text, lambda number: F(finite(number)))
        compare(_of_the_whole(result, campaign))
        certificates = Certificates(folder, campaign, work)
        found = [_checked(certificates, result, leg) for leg in result["legs"]]
        named = {str(file) for leg in result["legs"] for file in (*leg["proofs"], leg["point_certificate"])}
        unnamed = sorted({path.name for path in folder.glob("*.cert.jsonl")} - named)
        if unnamed and not any(leg.refused for leg in found):
            raise Refused(f"does not name the certificate {shown(unnamed[0])}, which lies beside it")
        return found
    except (Refused, *STRANGE) as error:
        if isinstance(error, Refused) and error.code == "campaign":
            raise
        raise Refused(f"{ROBUST_NAME} {reason_of(error)}", "run", 0) from None


def _of_the_whole(result: Json, campaign: ExactCampaign) -> Iterator[tuple[str, Any, Any]]:
    yield "format", result["format"], ROBUST_FORMAT
    check_model(result["model"]["name"])
    yield "campaign SHA-256", result["campaign"]["sha256"], campaign.sha256
    yield "name of the robot", result["campaign"]["robot"], campaign.robot
    yield "number of measurements", result["campaign"]["measurements"], len(campaign)
    numbers, outliers = [leg["leg"] for leg in result["legs"]], result["outliers"]
    every = list(range(1, campaign.legs + 1))
    yield "list of legs", numbers, sorted(set(result["options"]["legs"] or every) & set(every))
    yield "eps asked about", result["options"]["eps"], None
    yield "number of outliers", type(outliers) is int and 0 <= outliers < len(campaign), True
    yield "number of outliers", [leg["outliers"] for leg in result["legs"]], [outliers] * len(numbers)


def _checked(certificates: Certificates, result: Json, leg: Json) -> RobustChecked:
    campaign = certificates.campaign
    number, outliers = leg["leg"], result["outliers"]

    def accepted(file: Any) -> Accepted:
        found = certificates.accepted(file)
        compare(of_the_problem(result, leg, campaign, found, list(found.chosen)))
        compare(of_the_box(result, leg, found, None))
        return found

    try:
        if len(set(leg["proofs"])) < len(leg["proofs"]):
            raise Refused("names a proof twice")
        lo = _lower(leg, [accepted(file) for file in leg["proofs"]], outliers, certificates.budget)
        if leg["point_certificate"] is None:
            nothing_beside(leg, "eps_hi", "point", "left_out")
            return RobustChecked(number, outliers, lo, proofs=len(leg["proofs"]))
        left_out = {campaign.place.get(name, -1) for name in leg["left_out"]}
        if -1 in left_out or len(leg["left_out"]) > min(outliers, len(left_out)):
            raise Refused("leaves out a measurement that is none, one twice, or more than may be wrong")
        point, names = accepted(leg["point_certificate"]), tuple(map(str, leg["left_out"]))
        compare(_of_the_point(leg, point, [k for k in range(len(campaign)) if k not in left_out]))
        return RobustChecked(number, outliers, lo, exact(leg["eps_hi"]), names, len(leg["proofs"]))
    except (Unusable, Refused, *STRANGE) as error:
        return RobustChecked(number, outliers, refused=reason_of(error))


def _lower(leg: Json, proofs: list[Accepted], outliers: int, budget: Budget) -> F | None:
    """eps_lo, if the proofs bear it: whichever measurements are wrong, one of them does without these."""
    if not proofs:
        nothing_beside(leg, "eps_lo")
        return None
    if meeting([proof.used for proof in proofs], outliers, budget.spend):
        raise Refused("states a bound, but so many wrong measurements could spoil all of its proofs")
    bounds = [proof.claims.eps_lo for proof in proofs]
    if any(bound is None for bound in bounds):
        raise Refused("names a proof that claims no lower bound")
    lo = min(bound for bound in bounds if bound is not None)
    compare(iter([("eps_lo", exact(leg["eps_lo"]), lo)]))
    return lo


def _of_the_point(leg: Json, accepted: Accepted, kept: list[int]) -> Iterator[tuple[str, Any, Any]]:
    claims = accepted.claims
    yield "measurements of the point", kept, list(accepted.chosen)
    yield "point", claims.point is not None and claims.point.holds == accepted.chosen, True
    yield "eps_hi", exact(leg["eps_hi"]), claims.eps_hi
    at = () if claims.point is None else claims.point.at[:-1]
    yield "point", [exact(v) for v in leg["point"]], list(at)
