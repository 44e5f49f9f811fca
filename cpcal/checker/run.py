"""Checks a run: every number that its result.json states is claimed by an accepted certificate, or not certified."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction as F
from functools import partial
from pathlib import Path
from typing import Any

from .certificate import Accepted, check
from .files import A_FILE, WORK, Budget, content, leg_work, parsed
from .leg import EXTRA, NAME, PARAMETERS, ExactCampaign, check_model
from .readers import Refused, Unusable, finite, shown
from .rule import meeting

RESULT_NAME, INFORMATION = "result.json", "information"
RESULT_FORMAT = "cpcal-result/9"
_CLOSED = F(1, 10**9)  # a bracket this narrow is closed, whatever the relative gap
_NETWORK = ("a[0]", "a[1]", "a[2]", "b[0]", "b[1]", "b[2]", "l")  # in a certificate that states its constraints
STRANGE = (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError, OverflowError, MemoryError)
Json = dict[str, Any]


@dataclass(frozen=True)
class LegChecked:
    """What is proved of one leg. Neither accepted nor refused: the run says that the leg is not certified."""

    leg: int
    certificate: str | None
    accepted: Accepted | None = None
    refused: str | None = None
    support: Accepted | None = None  # that the leg's support alone proves a lower bound
    ranges: Accepted | None = None  # of the parameters at a tolerance
    robust: RobustChecked | None = None  # with outliers: then nothing of the above


@dataclass(frozen=True)
class RobustChecked:
    """What is proved of a leg of whose measurements some may be wrong; None where it is not certified."""

    outliers: int
    lo: F | None
    hi: F | None
    left_out: tuple[str, ...]
    proofs: int

    @property
    def certified(self) -> bool:
        return self.lo is not None or self.hi is not None


def check_run(folder: Path, *, work: int = 0) -> list[LegChecked]:
    """What is proved of every leg of the run.

    Raises Unusable where there is nothing to check, Refused where the run as a whole is not what it says.
    `work`: what the check may cost (0: `leg_work`); each leg has the same part, so that no leg depends on another.
    """
    return [check_leg() for check_leg in leg_checks(folder, work=work)]


def leg_checks(folder: Path, *, work: int = 0) -> list[Callable[[], LegChecked]]:
    """The run as a whole is checked; what is given checks each of its legs. Raises as `check_run`."""
    if not folder.is_dir():
        raise Unusable(f"{shown(folder.name)} is no folder")
    try:
        text = content(folder / RESULT_NAME)
        campaign = ExactCampaign(folder / NAME)
        result = parsed(text, finite)
        same("format", result["format"], RESULT_FORMAT)
        compare(_of_the_run(result, campaign))
        legs: list[Json] = result["legs"]
        others = [of for leg in legs for of in (leg["ranges"], leg["support"]["proof"]) if of is not None]
        brackets = [leg["bracket"] for leg in legs]
        named = {str(of["certificate"]) for of in (*brackets, *others)}
        named |= {str(name) for of in brackets for name in (*of["proofs"], of["point_certificate"])}
        names_all(folder, named)
        work = work // max(len(legs), 1) or leg_work(len(legs), len(campaign))
        certificates = Certificates(folder, campaign, work)
        return [partial(_checked, campaign, replace(certificates), result, leg) for leg in legs]
    except (Refused, *STRANGE) as error:
        if isinstance(error, Refused) and error.code == "campaign":
            raise
        raise Refused(f"{RESULT_NAME} {reason_of(error)}", "run", 0) from None


def _of_the_run(result: Json, campaign: ExactCampaign) -> Iterator[tuple[str, Any, Any]]:
    """What is stated of the run as a whole, and what it must be."""
    numbers = [leg["leg"] for leg in result["legs"]]
    check_model(result["model"]["name"])
    yield from of_the_campaign(result["campaign"], campaign)
    every, outliers = list(range(1, campaign.legs + 1)), result["options"]["outliers"]
    yield "number of outliers", type(outliers) is int and 0 <= outliers < len(campaign), True
    asked = result["options"]["legs"] or every
    partly = result[INFORMATION]["interrupted"] is True
    yield "list of legs", numbers, [n for n in asked if n in every and (n in numbers or not partly)]
    yield "list of legs", [type(n) for n in numbers], [int] * len(set(numbers))


def of_the_campaign(stated: Json, campaign: ExactCampaign) -> Iterator[tuple[str, Any, Any]]:
    """What a result states of the campaign beside it, and what it must be."""
    yield "campaign SHA-256", stated["sha256"], campaign.sha256
    yield "number of measurements", stated["measurements"], len(campaign)
    yield "name of the robot", stated["robot"], campaign.robot


def names_all(folder: Path, named: Collection[str]) -> None:
    """Raises Refused for a certificate in a folder that nothing names."""
    unnamed = {path.name for path in folder.glob("*.cert.jsonl")}.difference(named)
    if unnamed:
        raise Refused(f"does not name the certificate {shown(min(unnamed))}, which lies beside it")


def certificates_of(folder: Path, *, work: int = 0) -> Certificates:
    """Those of a folder without result.json, about one campaign or about constraints that they state themselves.

    They share one budget, as the legs of a run do. Raises Refused for a campaign.json that is none.
    """
    if not (folder / NAME).exists():
        return Certificates(folder, folder / NAME, work or WORK)
    campaign = ExactCampaign(folder / NAME)
    return Certificates(folder, campaign, work or campaign.legs * leg_work(campaign.legs, len(campaign)))


@dataclass
class Certificates:
    """Those of a folder: each is checked once, and all together cost no more than `work`."""

    folder: Path
    campaign: ExactCampaign | Path
    work: int

    def __post_init__(self) -> None:
        self.budget = Budget(self.work)
        self.names = {path.name for path in self.folder.glob("*.cert.jsonl")}
        self._known: dict[str, Accepted] = {}

    def accepted(self, file: Any) -> Accepted:
        if file not in self.names:
            raise Refused(f"names no certificate of its folder: {shown(file)}")
        if file not in self._known:
            self.budget.spend(A_FILE)
            self._known[file] = check(self.folder / file, self.campaign, work=self.budget)
        return self._known[file]


def _checked(campaign: ExactCampaign, certificates: Certificates, result: Json, leg: Json) -> LegChecked:
    if result["options"]["outliers"]:
        return check_leg(campaign, certificates, result, leg)
    bracket = leg["bracket"]
    number, name, every = leg["leg"], bracket["certificate"], list(range(len(campaign)))

    def accepted(file: Any, chosen: list[int]) -> Accepted:
        found = certificates.accepted(file)
        compare(of_the_problem(result, leg, campaign, found, chosen))
        return found

    try:
        support = [campaign.place.get(name, -1) for name in leg["support"][INFORMATION]["ids"]]
        same("support", len(set(support) - {-1}), len(support))
        stated, proof, ranges, few, found = leg["ranges"], leg["support"]["proof"], None, None, None
        same("proofs", (bracket["proofs"], bracket["point_certificate"]), ([], None))
        if stated is not None and stated["certificate"] is not None:
            ranges = accepted(stated["certificate"], every)
            compare(_of_the_ranges(result, leg, stated, ranges))
        if name is None:
            nothing_beside(bracket, "status", "lo", "hi", "point", "center", "enclosure", "left_out")
        else:
            found = accepted(name, every)
            compare(of_the_box(result, leg, found, result["options"]["eps"]))
            compare(_of_the_leg(result, leg, campaign, found))
        if proof is not None:
            few = accepted(proof["certificate"], sorted(support))
            compare(_of_the_support(result, leg, proof, campaign, few))
        return LegChecked(number, name, found, support=few, ranges=ranges)
    except (Unusable, Refused, *STRANGE) as error:
        return LegChecked(number, shown(name), refused=reason_of(error))


def of_the_problem(
    result: Json, leg: Json, campaign: ExactCampaign, accepted: Accepted, chosen: list[int]
) -> Iterator[tuple[str, Any, Any]]:
    model, extra = result["model"]["name"], [p["name"] for p in result["model"]["parameters"]]
    if model not in EXTRA:  # one of the user's own: the certificate states its constraints
        yield "problem", f"leg {leg['leg']}, model {model}, campaign {campaign.sha256}", accepted.about
        yield "parameters", [*_NETWORK, *extra, "eps"], list(accepted.unknowns)
        return
    yield "leg", leg["leg"], accepted.leg
    yield "model", model, accepted.model
    yield "extra parameters", extra, list(EXTRA[model])
    yield "measurements", chosen, list(accepted.chosen)


def of_the_box(result: Json, leg: Json, accepted: Accepted, asked: Any) -> Iterator[tuple[str, Any, Any]]:
    """The certificate's box is the one that the result states, rounded outward."""
    delta = exact(result["options"]["delta"])
    bracket = leg["bracket"]
    center = bracket["center"] if "center" in bracket else bracket[INFORMATION]["center"]
    yield "size of the center", len(center), len(PARAMETERS)
    sides = [(exact(c), delta) for c in center]
    sides += [(F(0), exact(p["half_width"])) for p in result["model"]["parameters"]]
    yield "number of parameters", len(sides), len(accepted.lo) - 1
    for i, (middle, half) in enumerate(sides):
        low, high = middle - half, middle + half
        slack, lo, hi = (abs(low) + abs(high)) / 2**50, accepted.lo[i], accepted.hi[i]
        yield f"range of unknown {i}", low - slack <= lo <= low and high <= hi <= high + slack, True
    yield "eps asked about", 0 if asked is None else exact(asked), accepted.lo[-1]


def _of_the_leg(result: Json, leg: Json, campaign: ExactCampaign, accepted: Accepted) -> Iterator[tuple[str, Any, Any]]:
    """What the leg states, and what its certificate's claims make of it."""
    claims, asked, bracket = accepted.claims, result["options"]["eps"], leg["bracket"]
    at = None if claims.point is None or claims.point.holds != accepted.chosen else claims.point.at
    ends = zip(accepted.lo[:-1], at or (), accepted.hi, strict=False)
    if at is not None and (any(not a <= v <= b for a, v, b in ends) or (asked is not None and at[-1] != claims.cap)):
        at = None
    informed = result["options"][INFORMATION]
    if informed["method"] == "timeout":  # which encloses nothing: the verdict judges no widths then
        yield "method", None, claims.enclosure
    refuted, lo = _lowest(campaign, leg["leg"], accepted, asked, at)
    if asked is not None:  # only that one is spoken of
        yield "cap", exact(asked), claims.cap
    elif claims.enclosure is not None:  # it holds all up to eps_hi, and up to any eps where none is known
        holds = all_of_it(campaign, leg["leg"], accepted) if at is None else claims.cap == at[-1]
        yield "eps up to which the enclosure holds", True, holds
    elif at is not None and claims.infeasible:
        yield "eps up to which there is no solution", lo, claims.cap
    yield "eps_lo", bracket["lo"], lo
    yield "eps_hi", bracket["hi"], "inf" if at is None else at[-1]
    yield "point", bracket["point"] and [exact(v) for v in bracket["point"]], at and list(at[:-1])
    yield from _of_the_hull(result, bracket["enclosure"], accepted, empty=refuted)
    narrow, slack = at is not None, F(0)
    if at is not None and asked is None:
        asked_gap = max(exact(informed["gap"]) * at[-1], _CLOSED)
        slack = asked_gap / 2**20 * (1 if bracket["status"] == "proved" else -1)  # how a float64 may see it
        narrow = at[-1] - lo <= asked_gap + slack
    yield "status", bracket["status"], "refuted" if refuted else "proved" if narrow else "unknown"


def _lowest(campaign: ExactCampaign, leg: int, accepted: Accepted, asked: Any, at: Any) -> tuple[bool, Any]:
    """Whether it is refuted that there is a solution, and the lower bound that the claims make."""
    claims = accepted.claims
    refuted = claims.infeasible and at is None and (asked is not None or all_of_it(campaign, leg, accepted))
    if asked is not None:
        return refuted, claims.cap if refuted else 0
    return refuted, "inf" if refuted else claims.eps_lo or 0


def _of_the_support(
    result: Json, leg: Json, stated: Json, campaign: ExactCampaign, accepted: Accepted
) -> Iterator[tuple[str, Any, Any]]:
    """The lower bound by the support alone, and nothing more."""
    claims, asked = accepted.claims, result["options"]["eps"]
    yield from of_the_box(result, leg, accepted, asked)
    refuted, lo = _lowest(campaign, leg["leg"], accepted, asked, None)
    yield "eps_lo of the support", stated["eps_lo"], lo
    yield "eps of the support", True, refuted or claims.cap == lo
    yield "claims of the support", (None, None), (claims.enclosure, claims.point)


def _of_the_ranges(result: Json, leg: Json, stated: Json, accepted: Accepted) -> Iterator[tuple[str, Any, Any]]:
    """The parameters at one eps."""
    yield from of_the_box(result, leg, accepted, stated["eps"])
    yield "eps of the ranges", exact(stated["eps"]), accepted.claims.cap
    if stated["certificate"] != leg["bracket"]["certificate"]:  # where one eps was asked about it is that of the leg
        yield "point of the ranges", None, accepted.claims.point
    yield from _of_the_hull(result, stated["box"], accepted, empty=accepted.claims.infeasible)


def _of_the_hull(result: Json, box: Json, accepted: Accepted, *, empty: bool) -> Iterator[tuple[str, Any, Any]]:
    yield "parameters", box["names"], [*PARAMETERS, *(p["name"] for p in result["model"]["parameters"])]
    sides = [box[side] and [exact(v) for v in box[side]] for side in ("lo", "hi")]
    found = accepted.claims.enclosure or (None if empty else (accepted.lo, accepted.hi))
    yield "enclosure", sides, [side and list(side[:-1]) for side in found or (None, None)]


def all_of_it(campaign: ExactCampaign, leg: int, accepted: Accepted) -> bool:
    """Whether the cap is above every eps for which legs can be longer than eps."""
    cap = accepted.claims.cap
    return cap is not None and cap >= campaign.shortest(leg) + accepted.hi[6]


def nothing_beside(of: Json, *proved: str) -> None:
    """What is not proved stands under `information`."""
    for key in proved:
        if key in of:
            raise Refused(f"states {key} without a proof")


def compare(stated: Iterable[tuple[str, Any, Any]]) -> None:
    for what, value, proved in stated:
        same(what, value, proved)


def same(what: str, stated: Any, proved: Any) -> None:
    """Equal, and of the same kind: true is not 1."""
    if stated != proved or isinstance(stated, bool) != isinstance(proved, bool):
        raise Refused(f"states another {what} than is proved")


def exact(value: Any) -> F:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"holds {shown(value)} where a number is needed")
    return F(value)


def reason_of(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"lacks the key {shown(error.args[0])}"
    return str(error) if isinstance(error, (Refused, Unusable)) else "holds a value of the wrong kind"


# ------------------------------------------------------------------------------------------------------------------
# Checks a robust claim: certificates that together prove a bound whichever q measurements are wrong.
#
# docs/certificate-format.md, "Robust claims", is the specification.


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
