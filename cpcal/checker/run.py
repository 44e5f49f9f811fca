"""Checks a run: every number that its result.json states is claimed by an accepted certificate, or not certified."""

import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction as F
from importlib import import_module
from pathlib import Path
from typing import Any

from .certificate import Accepted, Certificates, problem_of
from .files import KINDS, WORK, Budget, Lines, content, leg_work, parsed
from .leg import EXTRA, NAME, PARAMETERS, ExactCampaign, check_model
from .readers import (
    STRANGE,
    Json,
    Names,
    Places,
    Refused,
    Stated,
    Unusable,
    compare,
    exact,
    finite,
    reading,
    reason_of,
    same,
    shown,
)
from .rule import Box, Problem, hitting_set

RESULT_NAME, INFORMATION = "result.json", "information"
RESULT_FORMAT = "cpcal-result/14"
_POINTS = ("recommended", "passes_from", "reduced")
_CLOSED = F(1, 10**9)  # a bracket this narrow is closed, whatever the relative gap
_NETWORK = ("a[0]", "a[1]", "a[2]", "b[0]", "b[1]", "b[2]", "l")  # in a certificate that states its constraints


@dataclass(frozen=True)
class LegChecked:
    """What is proved of one leg. Nothing is proved or refused where the run says that the leg is not certified."""

    leg: int
    proofs: tuple[tuple[str, Accepted], ...] = ()  # certificates: of the bracket, the ranges, points
    robust: "RobustChecked | None" = None  # with outliers, in place of bracket and ranges
    refused: str | None = None


@dataclass(frozen=True)
class RobustChecked:
    """What is proved of a leg of whose measurements some may be wrong; None where an end is not certified."""

    outliers: int
    lo: F | None
    hi: F | None
    left_out: Names
    proofs: int


def check_run(folder: Path, *, work: int = 0) -> list[LegChecked]:
    """What is proved of every leg of the run.

    Raises Unusable where there is nothing to check, Refused where the run as a whole is not what it says.
    `work`: what the check may cost (0: `leg_work`); each leg has the same part, so that no leg depends on another.
    """
    return [check() for check in leg_checks(folder, work=work)]


def head_of(folder: Path) -> str:
    """The results that a folder holds; "" where there are none. Raises Refused for those of two commands."""
    heads = [head for head in (RESULT_NAME, *KINDS) if (folder / head).exists()]
    if len(heads) > 1:
        raise Refused(f"{' and '.join(heads)} are the answers of two commands, which share no folder", "run", 0)
    return heads[0] if heads else ""


def check_kind(folder: Path, head: str, *, work: int = 0) -> list[tuple[bool, str]]:
    """For each statement of a run of one of the other KINDS whether it is accepted, and a sentence; what checks it is
    loaded for such a run only. Raises Unusable, Refused for the whole."""
    module, name = KINDS[head]
    return list(getattr(import_module(f".{module}", __package__), name)(folder, work=work))


def answer(checks: Iterable[Callable[[], object]], there: Any) -> None:
    """The work of a process beside another one, which alone hears of signals, and checks again what it is not told."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    with suppress(Exception):
        there.send([check() for check in checks])


def leg_checks(folder: Path, *, work: int = 0) -> list[Callable[[], LegChecked]]:
    """The run as a whole is checked; what is given checks each of its legs. Raises as `check_run`."""
    if not folder.is_dir():
        raise Unusable(f"{shown(folder.name)} is no folder")
    with reading(RESULT_NAME):
        text = content(folder / RESULT_NAME)
        campaign = ExactCampaign(folder / NAME)
        result = parsed(text, finite)
        same("format", result["format"], RESULT_FORMAT)
        compare(_of_the_run(result, campaign))
        legs: list[Json] = result["legs"]
        others = [of for leg in legs for of in (leg["ranges"], *map(leg.get, _POINTS)) if of]
        brackets = [leg["bracket"] for leg in legs]
        named = [of["certificate"] for of in (*brackets, *others)]
        named += [name for of in brackets for name in (*of["proofs"], of["point_certificate"])]
        work = work // max(len(legs), 1) or leg_work(len(legs), len(campaign))
        LegCertificates(folder, campaign, work).names_all(set(map(str, named)))
        return [_Leg(LegCertificates(folder, campaign, work), campaign, result, leg).checked for leg in legs]


def _of_the_run(result: Json, campaign: ExactCampaign) -> Stated:
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


def of_the_campaign(stated: Json, campaign: ExactCampaign) -> Stated:
    """What a result states of the campaign beside it, and what it must be."""
    yield "campaign SHA-256", stated["sha256"], campaign.sha256
    yield "number of measurements", stated["measurements"], len(campaign)
    yield "name of the robot", stated["robot"], campaign.robot


def certificates_of(folder: Path, *, work: int = 0) -> "LegCertificates":
    """Those of a folder without result.json, about one campaign or about constraints that they state themselves.

    They share one budget, as the legs of a run do. Raises Refused for a campaign.json that is none.
    """
    if not (folder / NAME).exists():
        return LegCertificates(folder, folder / NAME, work or WORK)
    campaign = ExactCampaign(folder / NAME)
    return LegCertificates(folder, campaign, work or campaign.legs * leg_work(campaign.legs, len(campaign)))


class LegCertificates(Certificates):
    """About one campaign, or, without one, about constraints that they state themselves."""

    def __init__(self, folder: Path, campaign: ExactCampaign | Path, work: int) -> None:
        super().__init__(folder, Budget(work))
        self.campaign = campaign

    def form(self, header: Json, lines: Lines) -> tuple[Problem, Box]:
        return problem_of(header, lines, self.folder / NAME, self.campaign)


@dataclass
class _Leg:
    """A leg of a result beside the certificates that it names."""

    certificates: LegCertificates
    campaign: ExactCampaign
    result: Json
    leg: Json

    def checked(self) -> LegChecked:
        number, bracket = self.leg["leg"], self.leg["bracket"]
        try:
            robust = self.result["options"]["outliers"] > 0
            found = self._robust(bracket) if robust else LegChecked(number, tuple(self._certified(bracket)))
            return replace(found, proofs=(*found.proofs, *self._points(bracket)))
        except (Unusable, Refused, *STRANGE) as error:
            return LegChecked(number, refused=reason_of(error))

    def _certified(self, bracket: Json) -> list[tuple[str, Accepted]]:
        campaign, leg = self.campaign, self.leg
        name, stated = bracket["certificate"], leg["ranges"]
        every = tuple(range(len(campaign)))
        support = [campaign.place.get(name, -1) for name in leg[INFORMATION]["support"]]
        same("support", len(set(support) - {-1}), len(support))
        same("proofs", (bracket["proofs"], bracket["point_certificate"]), ([], None))
        proofs = list[tuple[str, Accepted]]()
        if stated is not None and stated["certificate"] is not None:
            ranges = self.accepted(stated["certificate"], every)  # from any eps on up to theirs
            same("eps of the ranges", stated["eps"], ranges.claims.cap)
            if stated["certificate"] != name:  # of one eps that was asked about
                same("point of the ranges", None, ranges.claims.point)
            compare(self.of_the_hull(stated["box"], ranges, empty=ranges.claims.infeasible))
            proofs.append((stated["certificate"], ranges))
        if name is None:
            nothing_beside(bracket, "status", "lo", "hi", "point", "center", "enclosure", "left_out")
        else:
            found = self.accepted(name, every)
            compare(self.of_the_bracket(bracket, found))
            proofs.insert(0, (name, found))
        return proofs

    def accepted(self, file: Any, chosen: Places | None = None) -> Accepted:
        """A certificate of this leg: of the `chosen` measurements (None: of any), in its box."""
        found = self.certificates.accepted(file)
        compare(self.of_the_problem(found, found.chosen if chosen is None else chosen))
        return found

    def of_the_problem(self, accepted: Accepted, chosen: Places) -> Stated:
        """The box is the one that the result states, rounded outward."""
        result, number, bracket = self.result, self.leg["leg"], self.leg["bracket"]
        model, parameters = result["model"]["name"], result["model"]["parameters"]
        extra = [p["name"] for p in parameters]
        if model not in EXTRA:  # one of the user's own: the certificate states its constraints
            yield "problem", f"leg {number}, model {model}, campaign {self.campaign.sha256}", accepted.about
            yield "parameters", [*_NETWORK, *extra, "eps"], list(accepted.unknowns)
        else:
            yield "leg", number, accepted.leg
            yield "model", model, accepted.model
            yield "extra parameters", extra, list(EXTRA[model])
            yield "measurements", chosen, accepted.chosen
        center, delta = where("center", bracket), result["options"]["delta"]
        yield "size of the center", len(center), len(PARAMETERS)
        sides = [(exact(c), exact(delta)) for c in center] + [(F(0), exact(p["half_width"])) for p in parameters]
        yield "number of parameters", len(sides), len(accepted.lo) - 1
        for i, (middle, half) in enumerate(sides):
            low, high = middle - half, middle + half
            slack, lo, hi = (abs(low) + abs(high)) / 2**50, accepted.lo[i], accepted.hi[i]
            yield f"range of unknown {i}", low - slack <= lo <= low and high <= hi <= high + slack, True

    def of_the_bracket(self, bracket: Json, accepted: Accepted) -> Stated:
        """What the leg states, and what its certificate's claims make of it."""
        claims, options = accepted.claims, self.result["options"]
        asked, informed = options["eps"], options[INFORMATION]
        yield "eps asked about", 0 if asked is None else asked, accepted.lo[-1]
        at = None if claims.point is None or claims.point.holds != accepted.chosen else claims.point.at
        if claims.point is not None:
            yield "factor of the point", None, claims.point.factor
        ends = zip(accepted.lo[:-1], at or (), accepted.hi, strict=False)
        if any(not a <= v <= b for a, v, b in ends) or (at and asked is not None and at[-1] != claims.cap):
            at = None
        if informed["method"] == "timeout":  # which encloses nothing: the verdict judges no widths then
            yield "method", None, claims.enclosure
        refuted, lo = self.lowest(accepted, at)
        if asked is not None:  # only that one is spoken of
            yield "cap", asked, claims.cap
        elif claims.enclosure is not None:  # it holds all up to eps_hi, and up to any eps where none is known
            holds = self.all_of_it(accepted) if at is None else claims.cap == at[-1]
            yield "eps up to which the enclosure holds", True, holds
        elif at is not None and claims.infeasible:
            yield "eps up to which there is no solution", lo, claims.cap
        yield "eps_lo", bracket["lo"], lo
        yield "eps_hi", bracket["hi"], "inf" if at is None else at[-1]
        yield "point", bracket["point"], at and at[:-1]
        yield from self.of_the_hull(bracket["enclosure"], accepted, empty=refuted)
        narrow, slack = at is not None, F(0)
        if at is not None and asked is None:
            asked_gap = max(exact(informed["gap"]) * at[-1], _CLOSED)
            slack = asked_gap / 2**20 * (1 if bracket["status"] == "proved" else -1)  # how a float64 may see it
            narrow = at[-1] - lo <= asked_gap + slack
        yield "status", bracket["status"], "refuted" if refuted else "proved" if narrow else "unknown"

    def _points(self, bracket: Json) -> Iterator[tuple[str, Accepted]]:
        """What is proved for all readings, at all measurements but those left out."""
        left_out = where("left_out", bracket)
        kept = tuple(k for name, k in self.campaign.place.items() if name not in left_out)
        for key in _POINTS:
            stated = self.leg[key]
            if stated is None:
                continue
            if stated["certificate"] is None:
                nothing_beside(stated, "point", "largest", "eps", "factor")
                continue
            found = self.certificates.accepted(stated["certificate"])
            compare(self.of_the_point(key, stated, found, kept))
            yield stated["certificate"], found

    def of_the_point(self, key: str, stated: Json, accepted: Accepted, kept: Places) -> Stated:
        """What it meets whatever the readings are; with reduced half-widths the recommended one meets the tolerance."""
        yield "leg", (self.leg["leg"], self.result["model"]["name"]), (accepted.leg, accepted.model)
        yield "measurements", kept, accepted.chosen
        claims, point = accepted.claims, accepted.claims.point
        if point is None or point.holds != accepted.chosen:
            raise Refused(f"states {key}, of which its certificate claims nothing")
        yield "claims", (None, None), (claims.enclosure, claims.eps_lo)
        of, eps, factor = stated, stated.get("largest", stated.get("eps")), 1
        if key == "reduced":
            of, eps, factor = self.leg["recommended"], where("tolerance", self.result["options"]), stated["factor"]
        yield f"factor of {key}", factor, point.factor
        yield f"point of {key}", where("point", of), point.at[:-1]
        yield f"eps of {key}", eps, point.at[-1]

    def lowest(self, accepted: Accepted, at: Any = None) -> tuple[bool, Any]:
        """Whether it is refuted that there is a solution, and the lower bound that the claims make."""
        claims, asked = accepted.claims, self.result["options"]["eps"]
        refuted = claims.infeasible and at is None and (asked is not None or self.all_of_it(accepted))
        if asked is not None:
            return refuted, claims.cap if refuted else 0
        return refuted, "inf" if refuted else claims.eps_lo or 0

    def of_the_hull(self, box: Json, accepted: Accepted, *, empty: bool) -> Stated:
        yield "parameters", box["names"], [*PARAMETERS, *(p["name"] for p in self.result["model"]["parameters"])]
        found = accepted.claims.enclosure or (None if empty else (accepted.lo, accepted.hi))
        yield "enclosure", [box["lo"], box["hi"]], [side and side[:-1] for side in found or (None, None)]

    def all_of_it(self, accepted: Accepted) -> bool:
        """Whether the cap is above every eps for which legs can be longer than eps."""
        cap = accepted.claims.cap
        return cap is not None and cap >= self.campaign.shortest(self.leg["leg"]) + accepted.hi[6]

    # whichever measurements are wrong: docs/certificate-format.md, "Robust claims" ----------------------------------

    def _robust(self, bracket: Json) -> LegChecked:
        campaign, outliers, proofs = self.campaign, self.result["options"]["outliers"], bracket["proofs"]
        same("eps asked about", self.result["options"]["eps"], None)
        same("certificate of all measurements", bracket["certificate"], None)
        same("ranges", self.leg["ranges"], None)
        nothing_beside(bracket, "status", "enclosure")
        if len(set(proofs)) < len(proofs):
            raise Refused("names a proof twice")
        family, lo, hi = [self.accepted(file) for file in proofs], None, None
        names: Names = ()
        if not family:
            nothing_beside(bracket, "lo")
        elif hitting_set([proof.used for proof in family], outliers, self.certificates.budget.spend) is not None:
            raise Refused("states a bound, but so many wrong measurements could spoil all of its proofs")
        else:
            bounds = [proof.claims.eps_lo for proof in family]
            if None in bounds:
                raise Refused("names a proof that claims no lower bound")
            lo = min(bound for bound in bounds if bound is not None)
            same("eps_lo", bracket["lo"], lo)
        if bracket["point_certificate"] is None:
            nothing_beside(bracket, "hi", "point", "left_out", *(() if proofs else ("center",)))
        else:
            left_out = {campaign.place.get(name, -1) for name in bracket["left_out"]}
            if -1 in left_out or len(bracket["left_out"]) > min(outliers, len(left_out)):
                raise Refused("leaves out a measurement that is none, one twice, or more than may be wrong")
            accepted = self.accepted(bracket["point_certificate"])
            claims, names, hi = accepted.claims, tuple(map(str, bracket["left_out"])), exact(bracket["hi"])
            kept = [k for k in range(len(campaign)) if k not in left_out]
            same("measurements of the point", kept, list(accepted.chosen))
            same("eps_hi", hi, claims.eps_hi)  # which a point proves that holds at all of these
            at = () if claims.point is None else claims.point.at[:-1]
            same("point", bracket["point"], at)
        proved = None if lo is hi is None else RobustChecked(outliers, lo, hi, names, len(proofs))
        return LegChecked(self.leg["leg"], robust=proved)


def where(key: str, of: Json) -> Any:
    """What stands in it, or under its `information`."""
    return of[key] if key in of else of[INFORMATION][key]


def nothing_beside(of: Json, *proved: str) -> None:
    """What is not proved stands under `information`."""
    for key in proved:
        if key in of:
            raise Refused(f"states {key} without a proof")
