"""What certification found, as plain values, and its file `result.json` (DESIGN section 8)."""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from cpcal.common.codec import Document, Informed, checked
from cpcal.common.errors import printable, refuse, unusable
from cpcal.common.files import StrPath
from cpcal.common.numbers import stated
from cpcal.common.values import Names, Numbers, Places, Texts, all_finite, fill
from cpcal.files.folders import CAMPAIGN_NAME, campaign_sha256, save_campaign_json
from cpcal.models import BUILT_IN, PARAMETERS, PLAIN, LegModel, Parameter, leg_model, model_name_problem
from cpcal.robot import Campaign
from cpcal.solver.accounts import Trial
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

# ------------------------------------------------------------------------------------------------------------------
# What a user asks of `certify` and `compare`: one frozen value that checks itself, stored in every result.

_Certificate = Annotated[str | None, checked("a file of the run, which is accepted")]
_CAMPAIGN = checked("campaign.json")
_CLAIM = checked("the claim of the certificate", "certificate")
_POINT = checked("the claim of the certificate", "certificate", "point_certificate")
_ALL = checked("the claim of the certificate, of all readings", "certificate")
_BOX = checked("the box of each certificate", "certificate", "proofs", "point_certificate")

_ALWAYS = ("delta", "center", "gap", "contractors")
LARGEST_DELTA = 1e6  # mm: a kilometre


def _number(value: Any) -> float:
    if isinstance(value, str | bool):
        raise TypeError
    return float(value)


def _whole(value: Any) -> int:
    if isinstance(value, bool):
        raise TypeError
    return operator.index(value)


def _names(value: Sequence[Any]) -> Names:
    if isinstance(value, str) or not all(isinstance(name, str) for name in value):
        raise TypeError
    return tuple(value)


_LENGTH = _number, lambda value: math.isfinite(value) and value >= 0.0
_TOLERANCE = *_LENGTH, "{} is no tolerance", "give a number of mm, 0 or more"
# sequences become tuples, numbers float64: a result that was read again equals the one that was written
_KINDS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], bool], str, str]] = {
    "legs": (lambda legs: tuple(map(_whole, legs)), bool, "names no leg", "name one at least, or leave it out for all"),
    "delta": (*_LENGTH, "{} is no half-width", "give a number of mm, 0 or more"),
    "gap": (_number, lambda gap: 0.0 <= gap < 1.0, "{} is no relative gap", "give 0 to below 1, such as 1e-6"),
    "time_limit": (_number, lambda limit: limit > 0.0, "{} is no time", "give a positive number of seconds"),
    "node_limit": (_whole, lambda limit: limit >= 1, "{} is no number of boxes", "give a whole number, 1 or more"),
    "contractors": (_names, lambda _: True, "", ""),
    "eps": _TOLERANCE,
    "tolerance": _TOLERANCE,
    "half_widths": (lambda widths: {str(k): _number(v) for k, v in widths.items()}, lambda _: True, "", ""),
    "outliers": (_whole, lambda count: count >= 0, "{} is no number of measurements", "give 0 or more"),
}
_WORDS = {"center": ("fit", "nominal", "plain"), "support": ("few", "none"), "method": ("bound", "timeout")}
for _name, _known in _WORDS.items():
    _KINDS[_name] = str, _known.__contains__, "{!r:.60} is not known", f"use one of {', '.join(_known)}"


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of `cpcal.certify`, whose help says what they mean. Lengths in mm, times in seconds.

    Raises InputError with every problem that shows without the campaign.
    """

    legs: Annotated[Places | None, checked("the legs that are there")] = None
    delta: Annotated[float, checked("the box of each certificate")] = 100.0
    center: Informed[str] = "fit"
    gap: Informed[float] = 1e-6
    time_limit: Informed[float | None] = None
    node_limit: Informed[int | None] = None
    contractors: Informed[Names] = ("lifted",)
    eps: Annotated[float | None, checked("the box and the cap of each certificate")] = None
    tolerance: Informed[float | None] = None
    support: Informed[str] = "few"
    method: Informed[str] = "bound"
    model: Informed[str | None] = None
    half_widths: Informed[Mapping[str, float]] = field(default_factory=dict)
    ranges: Informed[bool] = False
    outliers: Annotated[int, checked("what the proofs bear")] = 0

    def __post_init__(self) -> None:
        wrong = []
        for name, (kind, good, what, remedy) in _KINDS.items():
            value = getattr(self, name)
            if value is None:
                continue
            try:
                value = kind(value)
                wrong.append((not good(value), name, what.format(value), remedy))
            except (TypeError, ValueError, OverflowError):
                wrong.append((True, name, f"{value!r:.60} is not what this option takes", "see `cpcal certify --help`"))
                value = getattr(Options, name, None)
            fill(self, **{name: value})
        timeout, beside = self.method == "timeout", self.eps is not None or self.method != "bound"
        least = "asks for the smallest eps, by branch and bound"
        forever = "is missing, and method timeout may go on for ever"
        kilometre = f"give {LARGEST_DELTA} mm (a kilometre) at most"
        refuse(
            *wrong,
            (len(set(self.legs or ())) < len(self.legs or ()), "legs", "a leg is named twice", "name each once"),
            (LARGEST_DELTA < self.delta < math.inf, "delta", f"{self.delta} mm is wider than any robot", kilometre),
            (self.outliers and beside, "outliers", least, "leave out eps and method"),
            (timeout and self.eps is not None, "method", "timeout seeks the smallest eps", "leave eps out"),
            (timeout and self.time_limit is None, "time_limit", forever, "give a number of seconds a leg, such as 60"),
        )

    def words(self) -> list[str]:
        """The options of `cpcal certify` that say the same; those that decide the answer are always named."""
        out = []
        for option in fields(self):
            name, value = option.name, getattr(self, option.name)
            # half-widths of extra parameters stand in the campaign, and no option says them
            if name in _ALWAYS or (name not in ("ranges", "half_widths") and value != option.default):
                text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
                out += [f"--{name.replace('_', '-')}", text]
        return out


# ------------------------------------------------------------------------------------------------------------------
# In which range each parameter of a leg lies, if the leg's equations are to hold to within some eps: plain values.


@dataclass(frozen=True)
class Ranges:
    """Proved: all parameters in the leg's box that satisfy its equations to within `eps` (mm) lie in `box`.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. `certificate`: the file that claims exactly
    this; None: proved in outward-rounded arithmetic, and nobody can check it again. Raises ValueError for an eps that
    is no tolerance, and a box that holds nothing or is not finite.
    """

    eps: Annotated[float, checked("the cap of the certificate", "certificate")]
    box: Annotated[Box, checked("the enclosure of the certificate", "certificate")]
    certificate: _Certificate = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.eps < math.inf:
            raise ValueError("eps of the ranges is no tolerance")
        if not all_finite(self.box.width):
            raise ValueError("the ranges are empty, or not finite")


# ------------------------------------------------------------------------------------------------------------------
# A given point of one leg, measurement by measurement, as plain values (section 5.1.2 of the paper).


@dataclass(frozen=True)
class VerifiedPoint:
    """Of N measurements at tolerance `eps` (mm): how many the point is proved to satisfy, and to fail.

    It satisfies measurement k when THERE EXISTS a reading in its set with |g(x, M_k)| <= eps (and the leg is longer
    than eps); it fails when there is none. Of the others nothing is proved.
    """

    eps: float
    holds: int
    fails: int
    count: int

    def __post_init__(self) -> None:
        """Raises ValueError for counts that do not go together."""
        if min(self.holds, self.fails) < 0 or self.holds + self.fails > self.count:
            raise ValueError("holds and fails are not counts of the measurements")
        if not 0.0 <= self.eps < math.inf:
            raise ValueError("eps is no tolerance")

    @property
    def verdict(self) -> Verdict:
        """Of the statement that the point is a solution."""
        if self.fails:
            return Verdict.REFUTED
        return Verdict.PROVED if self.holds == self.count else Verdict.UNKNOWN

    def sentence(self, name: str) -> str:
        """What is proved of the point called `name`."""
        within = "within the stated reading uncertainty" if self.eps == 0.0 else f"to within {stated(self.eps)} mm"
        equations = f"{self.holds:,} of the {self.count:,} equations {within} for some readings in their sets"
        if self.verdict is Verdict.PROVED:
            return f"{name} is a solution: it satisfies all {self.count:,} equations {within} for some readings."
        refuting = f"{self.fails:,} measurement{' refutes' if self.fails == 1 else 's refute'} it" if self.fails else ""
        unknown = self.count - self.holds - self.fails
        rest = [text for text in (refuting, f"{unknown:,} are undecided" if unknown else "") if text]
        return f"{name} satisfies {equations}; {', '.join(rest)}."


# ------------------------------------------------------------------------------------------------------------------
# The parameters to load, and the tolerances that they meet for ALL readings (DESIGN section 6): plain values.
#
#     E(x) = max over measurements k, max over all readings M in the k-th set, of |g(x, M)|      mm
#
# Worse sensors make it larger. A certificate beside a number claims exactly it; without one it is information.

LEAST_SQUARES, CONSTRAINED = "least squares", "constrained least squares"


@dataclass(frozen=True)
class Recommended:
    """The parameters to load, `why` these, and `largest`: PROVED, E(point) <= largest, mm; infinite where it is not.

    `why` is "least squares", weighted by the stated deviations, or "constrained least squares": the least sum of
    squares among parameters that meet the tolerance. Raises ValueError for a number that none of these can be.
    """

    point: Annotated[Numbers, _ALL]
    why: Informed[str]
    largest: Annotated[float, _ALL]
    certificate: _Certificate = None


@dataclass(frozen=True)
class PassesFrom:
    """PROVED: E(point) <= eps, in mm. No smaller tolerance was found at which some parameters pass."""

    eps: Annotated[float, _ALL]
    point: Annotated[Numbers, _ALL]
    certificate: _Certificate = None


@dataclass(frozen=True)
class Reduced:
    """PROVED: with half-widths of `factor` times the stated ones the recommended parameters meet the tolerance.

    0: never at these parameters, whose equations fail at the readings as they are.
    """

    factor: Annotated[float, _ALL]
    certificate: _Certificate = None


# ------------------------------------------------------------------------------------------------------------------
# Whether the measurements of a leg determine its parameters: plain values.
#
# The rank of the equations, in floating point, tells which parameters they leave open.


@dataclass(frozen=True)
class Determination:
    """The `rank` of the Jacobian of so many equations in `of` parameters, and those that they leave `undetermined`."""

    measurements: int
    of: int
    rank: int
    undetermined: Names = ()

    @property
    def sentence(self) -> str:
        """Empty when all is well: the parameters are determined, and measurements left to contradict the model."""
        count = f"{self.measurements:,} measurement{'' if self.measurements == 1 else 's'}"
        if self.undetermined:
            names = ", ".join(self.undetermined)
            return f"{count} of rank {self.rank} leave {len(self.undetermined)} of {self.of} parameters open: {names}."
        if self.measurements <= self.of:
            return f"{count} determine {self.of} parameters, and none is left to test the model."
        return ""


_OURS = {model.name: model.summary for model in BUILT_IN}


@dataclass(frozen=True)
class ModelNote:
    """The leg model of a result: its name, and its parameters beyond (a, b, l). Raises ValueError for no such name."""

    name: Annotated[str, checked("the model of each certificate")] = PLAIN.name
    extra: Annotated[tuple[Parameter, ...], {"json": "parameters"}] = ()

    def __post_init__(self) -> None:
        if self.name not in _OURS and (problem := model_name_problem(self.name)):
            raise ValueError(problem)

    @property
    def summary(self) -> str:
        """What a leg's length is, for a model that comes with cpcal; of others nothing is known but their name."""
        return _OURS.get(self.name, "what the constraints say that its certificates state")

    @property
    def not_compared(self) -> str:
        """A sentence beside every answer of a model that the checker does not know; empty for one that it does."""
        return (
            ""
            if self.name in _OURS
            else (
                f"The checker does not know the model {printable(self.name)}: its certificates state the constraints "
                "themselves, which were not compared with the campaign."
            )
        )

    @property
    def parameters(self) -> Names:
        return (*PARAMETERS, *(p.name for p in self.extra))

    def unit(self, name: str) -> str:
        return next((p.unit for p in self.extra if p.name == name), "mm")


def model_of(result: Result, model: LegModel | None = None) -> LegModel:
    """The leg model of a result, with its half-widths: the one given, or the one that is known here by its name.

    Raises InputError where none is known, or the one given is another; PluginError where its package does not load.
    """
    note = result.model
    found = leg_model(note.name if model is None else model)
    if (found.name, found.parameters) != (note.name, note.parameters):
        what = f"{found.name!r} with the parameters {', '.join(found.parameters)} is not the result's"
        remedy = f"give the model {note.name!r} with the parameters {', '.join(note.parameters)}"
        raise unusable("model", what, remedy)
    return found.within({p.name: p.half_width for p in note.extra})


class Uncertified(StrEnum):
    """Why a leg has no certificate."""

    NOTHING = ""  # it has one
    NOT_ASKED = "no certificate was asked for"
    INTERRUPTED = "the search was interrupted"
    UNWRITTEN = "the certificate could not be written"
    UNCHECKABLE = "its check would take more work than the checker spends"
    MODEL = "with uncertain readings a user-defined model has no certificate"
    NOTHING_PROVED = "nothing was proved that a certificate could claim"


@dataclass(frozen=True, kw_only=True)
class LegBracket:
    """Proved: no x in the box satisfies all equations for any eps < `lo`; `point` does at `hi`. Lengths in mm.

    Where one eps was asked about, `lo` is that eps if no x satisfies the equations at it, else 0, which says nothing:
    no other bound was asked for; `hi` is that eps with a proved point, else infinite.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. `verdict` PROVED: the bracket is closed (or,
    when an eps was asked for, some x satisfies it); REFUTED: no x does; UNKNOWN: a limit came first. `point` is
    (a_x, a_y, a_z, b_x, b_y, b_z, l) and the model's extra parameters, None without a proved point. The box is around
    `center`, (a, b, l), and around 0 in the extra parameters; `enclosure` holds every x with eps <= hi. `certificate`:
    the file that claims exactly these.

    When some measurements may be wrong: whichever so many are left out, no x satisfies all others for any eps < `lo`,
    since one of the `proofs` does without them; `point` satisfies all but those `left_out` at `hi`, which
    `point_certificate` proves. Raises ValueError for fields that contradict each other.
    """

    verdict: Annotated[Verdict, checked("follows from the bounds and the gap", "certificate", json="status")]
    lo: Annotated[float, checked("the claim of the certificate, or the least of the proofs", "certificate", "proofs")]
    hi: Annotated[float, _POINT]
    point: Annotated[Numbers | None, _POINT]
    center: Annotated[Numbers, _BOX]
    enclosure: Annotated[Box, _CLAIM]
    certificate: _Certificate = None
    proofs: Annotated[Names, checked("files of the run, which are accepted")] = ()
    point_certificate: _Certificate = None
    left_out: Annotated[Names, checked("the measurements of the certificate", "point_certificate")] = ()

    def __post_init__(self) -> None:
        size = len(self.enclosure.names)
        if len(self.center) != len(PARAMETERS) or (self.point is not None and len(self.point) != size):
            raise ValueError("center, point and enclosure have not the same parameters")
        if not all(map(math.isfinite, (*self.center, *(self.point or ())))):
            raise ValueError("the center or the point is not finite")
        if math.isnan(self.lo) or math.isnan(self.hi) or self.lo < 0.0:
            raise ValueError("lo or hi is no number that it can be")
        if math.isinf(self.hi) != (self.point is None):
            raise ValueError("hi and point do not go together")


@dataclass(frozen=True, kw_only=True)
class Work:
    """What a bracket cost, and how it was found. Nobody proves it.

    floor    second-order effect of the readings, mm, below which the bracket cannot close
    pending  boxes that were left at a limit
    trials   calls of the solver, with method "timeout"
    """

    nodes: int = 0
    programs: Annotated[int, {"json": "lps"}] = 0
    seconds: float = 0.0
    pending: int = 0
    floor: float = 0.0
    trials: tuple[Trial, ...] = ()

    def __post_init__(self) -> None:
        if min(self.nodes, self.programs, self.pending) < 0 or math.isnan(self.floor) or math.isnan(self.seconds):
            raise ValueError("a count is negative, or floor or seconds is no number")


@dataclass(frozen=True, kw_only=True)
class LegResult:
    """One leg. Where it has no certificate `not_certified` says why: the numbers were found by the same proofs, but
    nobody can check them again. Raises ValueError for fields that contradict each other.

    recommended    the parameters to load
    passes_from    the least tolerance found that some parameters meet for all readings
    reduced        where it is open if `recommended` meets the tolerance: with which smaller half-widths it does
    support        ids of few measurements found to give the lower bound by themselves, up to the gap; of all with a
                   weight in some step where no few were
    ranges         of the parameters at a tolerance; see cpcal.questions.leg
    extra          the model's own parameters of the fit that the box is around; they are no part of the box
    determination  None: nothing is to be determined, or it was not asked
    """

    leg: Annotated[int, checked("the list of legs, and the certificate")]
    bracket: LegBracket
    recommended: Recommended
    passes_from: PassesFrom | None = None
    reduced: Reduced | None = None
    ranges: Ranges | None = None
    support: Informed[Names] = ()
    not_certified: Informed[Uncertified] = Uncertified.NOTHING
    extra: Informed[Numbers] = ()
    determination: Informed[Determination | None] = None
    work: Informed[Work] = Work()

    def __post_init__(self) -> None:
        if self.certified and self.not_certified:
            raise ValueError("a leg with a certificate is certified")
        if self.leg < 1:
            raise ValueError("the leg's number is no number of a leg")
        best, points = self.recommended, [one.point for one in (self.recommended, self.passes_from) if one is not None]
        if best.why not in (LEAST_SQUARES, CONSTRAINED) or not best.largest >= 0.0:
            raise ValueError("why or largest is nothing that it can be")
        if any(len(point) != len(self.bracket.enclosure.names) for point in points):
            raise ValueError("the recommended parameters are not those of the model")
        least = (self.passes_from and self.passes_from.eps, self.reduced and self.reduced.factor)
        if not all(0.0 <= (number or 0.0) < math.inf for number in least):
            raise ValueError("passes_from is no tolerance, or the factor on the half-widths is none")
        if not all(math.isfinite(number) for point in points for number in point):
            raise ValueError("a recommended point is not finite")
        if len(self.center) != len(self.bracket.enclosure.names) or not all(map(math.isfinite, self.extra)):
            raise ValueError("the extra parameters of the center are not those of the model")

    @property
    def center(self) -> Numbers:
        """All parameters of the fit, or of the nominal values, that the box is around."""
        return self.bracket.center + self.extra

    @property
    def certified(self) -> bool:
        return bool(self.bracket.certificate or self.bracket.proofs or self.bracket.point_certificate)


@dataclass(frozen=True)
class CampaignNote:
    """Which campaign a result is of: SHA-256 of its campaign.json, the robot's name, the number of measurements."""

    sha256: Annotated[str, _CAMPAIGN]
    robot: Annotated[str, _CAMPAIGN]
    measurements: Annotated[int, _CAMPAIGN]


@dataclass(frozen=True, kw_only=True)
class Result:
    """The legs that were certified, and what was asked: everything that `result.json` holds.

    `interrupted`: the user stopped the run; legs that had not begun are missing. Raises ValueError for legs that have
    other parameters than the model, or that are there twice.
    """

    campaign: CampaignNote
    options: Options
    model: ModelNote = ModelNote()
    version: Informed[str]
    interrupted: Informed[bool] = False
    legs: tuple[LegResult, ...]

    @property
    def unfinished(self) -> bool:
        """Whether a stop, or a full disk, left something to go on with."""
        return self.interrupted or any(leg.not_certified is Uncertified.UNWRITTEN for leg in self.legs)

    def __post_init__(self) -> None:
        if len({leg.leg for leg in self.legs}) < len(self.legs):
            raise ValueError("a leg is there twice")
        if any(leg.bracket.enclosure.names != self.model.parameters for leg in self.legs):
            raise ValueError(f"a leg has not the parameters {', '.join(self.model.parameters)}")


RESULT_NAME = "result.json"
_DOCUMENT = Document(Result, RESULT_NAME, "cpcal-result/14", "name the folder of a run, or run certify again")
load_result = _DOCUMENT.load


def check_campaign(campaign: Campaign, parts: Texts, remedy: str) -> None:
    """Raises InputError where a part, such as a result, names the SHA-256 of another campaign."""
    own = campaign_sha256(campaign)
    for name, sha256 in parts.items():
        if sha256 != own:
            raise unusable(name, f"is of another campaign (sha256 {printable(sha256)}, not {own})", remedy)


def save_result(result: Result, run: StrPath, campaign: Campaign | None = None) -> Path:
    """Write `result.json` into the folder `run` (made if missing), and the `campaign` beside it, as campaign.json.

    Without a campaign the folder holds it already, as certificates leave it: a run needs nothing else. Returns the path
    of result.json. Raises InputError, and writes nothing, where the campaign is missing or not the result's.
    """
    folder = Path(run)
    where, remedy = str(folder / CAMPAIGN_NAME) if campaign is None else "campaign", "give the one that was certified"
    try:
        if campaign is None:
            kept = hashlib.sha256((folder / CAMPAIGN_NAME).read_bytes()).hexdigest()
        else:
            kept = campaign_sha256(campaign)
    except OSError as error:
        raise unusable(where, f"cannot be read: {error.strerror}", remedy) from None
    if kept != result.campaign.sha256:
        raise unusable(where, "is another campaign than the result's", remedy)
    if campaign is not None:
        save_campaign_json(campaign, folder)
    return _DOCUMENT.save(result, folder)
