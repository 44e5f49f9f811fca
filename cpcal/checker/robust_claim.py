"""Checks a robust claim: certificates that together prove a bound whichever q measurements are wrong.

docs/certificate-format.md, "Robust claims", is the specification.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction as F
from typing import Any

from .claims import Accepted
from .exact_campaign import ExactCampaign
from .files import Budget
from .readers import shown
from .refusal import Refused, Unusable
from .rule import meeting
from .run import (
    STRANGE,
    Certificates,
    Json,
    LegChecked,
    RobustChecked,
    compare,
    exact,
    nothing_beside,
    of_the_box,
    of_the_problem,
    reason_of,
    same,
)


def check_leg(campaign: ExactCampaign, certificates: Certificates, result: Json, leg: Json) -> LegChecked:
    bracket = leg["bracket"]
    number, outliers = leg["leg"], result["options"]["outliers"]

    def accepted(file: Any) -> Accepted:
        found = certificates.accepted(file)
        compare(of_the_problem(result, leg, campaign, found, list(found.chosen)))
        compare(of_the_box(result, leg, found, None))
        return found

    try:
        same("eps asked about", result["options"]["eps"], None)
        same("certificate of all measurements", bracket["certificate"], None)
        same("ranges or support", (leg["ranges"], leg["support"]["proof"]), (None, None))
        nothing_beside(bracket, "status", "enclosure")
        proofs, hi = bracket["proofs"], None
        names: tuple[str, ...] = ()
        if len(set(proofs)) < len(proofs):
            raise Refused("names a proof twice")
        lo = _lower(bracket, [accepted(file) for file in proofs], outliers, certificates.budget)
        if bracket["point_certificate"] is None:
            nothing_beside(bracket, "hi", "point", "left_out")
        else:
            left_out = {campaign.place.get(name, -1) for name in bracket["left_out"]}
            if -1 in left_out or len(bracket["left_out"]) > min(outliers, len(left_out)):
                raise Refused("leaves out a measurement that is none, one twice, or more than may be wrong")
            point, names = accepted(bracket["point_certificate"]), tuple(map(str, bracket["left_out"]))
            compare(_of_the_point(bracket, point, [k for k in range(len(campaign)) if k not in left_out]))
            hi = exact(bracket["hi"])
        if not proofs and bracket["point_certificate"] is None:
            nothing_beside(bracket, "center")
        return LegChecked(number, None, robust=RobustChecked(outliers, lo, hi, names, len(proofs)))
    except (Unusable, Refused, *STRANGE) as error:
        named = bracket["point_certificate"] if isinstance(bracket, dict) else None
        return LegChecked(number, shown(named), refused=reason_of(error))


def _lower(bracket: Json, proofs: list[Accepted], outliers: int, budget: Budget) -> F | None:
    """eps_lo, if the proofs bear it: whichever measurements are wrong, one of them does without these."""
    if not proofs:
        nothing_beside(bracket, "lo")
        return None
    if meeting([proof.used for proof in proofs], outliers, budget.spend):
        raise Refused("states a bound, but so many wrong measurements could spoil all of its proofs")
    bounds = [proof.claims.eps_lo for proof in proofs]
    if any(bound is None for bound in bounds):
        raise Refused("names a proof that claims no lower bound")
    lo = min(bound for bound in bounds if bound is not None)
    compare(iter([("eps_lo", exact(bracket["lo"]), lo)]))
    return lo


def _of_the_point(bracket: Json, accepted: Accepted, kept: list[int]) -> Iterator[tuple[str, Any, Any]]:
    claims = accepted.claims
    yield "measurements of the point", kept, list(accepted.chosen)
    yield "point", claims.point is not None and claims.point.holds == accepted.chosen, True
    yield "eps_hi", exact(bracket["hi"]), claims.eps_hi
    at = () if claims.point is None else claims.point.at[:-1]
    yield "point", [exact(v) for v in bracket["point"]], list(at)
