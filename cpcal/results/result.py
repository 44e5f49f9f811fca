"""What certification found, as plain values, and its file `result.json` (DESIGN section 8)."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from cpcal.common.errors import InputError, Problem, printable
from cpcal.files.codec import INFORMED, checked, informed, load, save, text_of
from cpcal.files.folders import NAME as CAMPAIGN_NAME
from cpcal.files.folders import campaign_sha256, save_campaign_json
from cpcal.legs import BUILT_IN, PARAMETERS, PLAIN, LegModel, Parameter, leg_model, model_name_problem
from cpcal.results.determination import Determination
from cpcal.results.options import Options
from cpcal.results.projection import Projections
from cpcal.results.ranges import Ranges
from cpcal.results.support_proof import SupportProof
from cpcal.results.verified_point import VerifiedPoint
from cpcal.solver.accounts import ContractorUse, Trial
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from cpcal.robot import Campaign

FORMAT = "cpcal-result/6"
RESULT_NAME = "result.json"


@dataclass(frozen=True)
class ModelNote:
    """The leg model of a result: its name, and its parameters beyond (a, b, l). Raises ValueError for no such name."""

    name: str = field(default=PLAIN.name, metadata=checked("the model of each certificate"))
    extra: tuple[Parameter, ...] = field(default=(), metadata={"json": "parameters"})

    def __post_init__(self) -> None:
        if not self.is_ours and (problem := model_name_problem(self.name)):
            raise ValueError(problem)

    @property
    def is_ours(self) -> bool:
        """Whether it comes with cpcal: of others the certificates state the constraints themselves."""
        return any(self.name == model.name for model in BUILT_IN)

    @property
    def summary(self) -> str:
        """What a leg's length is, for a model that comes with cpcal; of others nothing is known but their name."""
        ours = (model.summary for model in BUILT_IN if model.name == self.name)
        return next(ours, "what the constraints say that its certificates state")

    @property
    def not_compared(self) -> str:
        """What must be said beside every answer; empty for a model that comes with cpcal."""
        return "" if self.is_ours else not_compared(self.name)

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*PARAMETERS, *(p.name for p in self.extra))

    def unit(self, name: str) -> str:
        return next((p.unit for p in self.extra if p.name == name), "mm")


def not_compared(model: str) -> str:
    """A sentence on the certificates of a model that the checker does not know."""
    return (
        f"The checker does not know the model {printable(model)}: its certificates state the constraints themselves, "
        "which were not compared with the campaign."
    )


def model_of(result: Result, model: LegModel | None = None) -> LegModel:
    """The leg model of a result, with its half-widths: the one given, or the one that is known here by its name.

    Raises InputError where none is known, or the one given is another; PluginError where its package does not load.
    """
    note = result.model
    found = leg_model(note.name if model is None else model)
    if (found.name, found.parameters) != (note.name, note.parameters):
        what = f"{found.name!r} with the parameters {', '.join(found.parameters)} is not the result's"
        remedy = f"give the model {note.name!r} with the parameters {', '.join(note.parameters)}"
        raise InputError([Problem("model", what, remedy)])
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
class LegResult:
    """One leg: proved, no x in the box satisfies all equations for any eps < `eps_lo`; `point` does at `eps_hi`.

    Where one eps was asked about, `eps_lo` is that eps if no x satisfies the equations at it, else 0, which says
    nothing: no other bound was asked for; `eps_hi` is that eps with a proved point, else infinite.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. Lengths in mm. `verdict` PROVED: the
    bracket is closed (or, when an eps was asked for, some x satisfies it); REFUTED: no x does; UNKNOWN: a limit
    came first. `point` is (a_x, a_y, a_z, b_x, b_y, b_z, l) and the model's extra parameters, None without a proved
    point; `enclosure` holds every x with eps <= eps_hi. `floor`: second-order effect of the readings below which the
    bracket cannot close. `support`: ids of measurements that by themselves prove eps_lo up to the gap or, where no few
    were found to, of all with a weight in some step.

    `certificate`: the file that claims exactly these eps_lo, eps_hi, point and enclosure. Where there is none,
    `not_certified` says why: the numbers were found by the same proofs, but nobody can check them again.
    Raises ValueError for fields that contradict each other.
    """

    leg: int = field(metadata=checked("the list of legs, and the certificate"))
    verdict: Verdict = field(metadata=checked("follows from the bounds and the gap", "certificate", json="status"))
    eps_lo: float = field(metadata=checked("the claim of the certificate", "certificate"))
    eps_hi: float = field(metadata=checked("the claim of the certificate", "certificate"))
    point: tuple[float, ...] | None = field(metadata=checked("the claim of the certificate", "certificate"))
    center: tuple[float, ...] = field(metadata=checked("the box of the certificate", "certificate"))
    enclosure: Box = field(metadata=checked("the claim of the certificate", "certificate"))
    floor: float = field(metadata=INFORMED)
    support: tuple[str, ...] = field(metadata=INFORMED)
    nodes: int = field(metadata=INFORMED)
    programs: int = field(metadata=informed("lps"))
    seconds: float = field(metadata=INFORMED)
    certificate: str | None = field(default=None, metadata=checked("a file of the run, which is accepted"))
    not_certified: Uncertified = field(default=Uncertified.NOTHING, metadata=INFORMED)
    support_proof: SupportProof | None = None  # that the support by itself proves a bound
    ranges: Ranges | None = None  # of the parameters at a tolerance; see cpcal.certify.certified_ranges
    # what the report draws; see cpcal.certify.projections
    projections: Projections | None = field(default=None, metadata=INFORMED)
    # the center of the box, as a solution at eps = 0 (or the eps asked about)
    verified: VerifiedPoint | None = field(default=None, metadata=informed("center_verified"))
    # None: nothing is to be determined, or it was not asked
    determination: Determination | None = field(default=None, metadata=INFORMED)
    trials: tuple[Trial, ...] = field(default=(), metadata=INFORMED)  # calls of the solver, with method "timeout"
    # those asked for: how often each ran, its part in the certificate
    contractors_used: tuple[ContractorUse, ...] = field(default=(), metadata=INFORMED)
    # what all contractors together found, where the certificate proves less: nobody can check it
    found_lo: float | None = field(default=None, metadata=INFORMED)
    found_enclosure: Box | None = field(default=None, metadata=INFORMED)
    pending: int = field(default=0, metadata=INFORMED)  # boxes that were left at a limit

    def __post_init__(self) -> None:
        if self.certified and self.not_certified:
            raise ValueError("a leg with a certificate is certified")
        size = len(self.center)
        if (self.point is not None and len(self.point) != size) or len(self.enclosure.names) != size:
            raise ValueError("center, point and enclosure have not the same parameters")
        if not all(map(math.isfinite, (*self.center, *(self.point or ())))):
            raise ValueError("the center or the point is not finite")
        if any(map(math.isnan, (self.eps_lo, self.eps_hi, self.floor, self.seconds))) or self.eps_lo < 0.0:
            raise ValueError("eps_lo, eps_hi, floor or seconds is no number that it can be")
        if min(self.nodes, self.programs, self.pending) < 0 or self.leg < 1:
            raise ValueError("a count or the leg's number is negative")

    @property
    def certified(self) -> bool:
        return self.certificate is not None

    @property
    def not_refuted(self) -> bool:
        """Whether the model without any error is proved to fit: eps* = 0."""
        return self.point is not None and self.eps_hi == 0.0

    def plot_residuals(self, campaign: Campaign, ax: Axes | None = None, *, model: LegModel | None = None) -> Axes:
        """Residuals of the proved point and of the center of the box over the measurements, and the band of eps_hi.

        `model`: the leg model, where it is not the plain one. Raises ValueError without a proved point.
        """
        from cpcal.results.plots import residuals_axes

        return residuals_axes(self, campaign, ax, model)

    def plot_parameters(self, ax: Axes | None = None) -> Axes:
        """The range of each parameter (without ranges: its enclosure) about the proved point, in mm."""
        from cpcal.results.plots import parameters_axes

        return parameters_axes(self, ax)

    def _repr_html_(self) -> str:
        from cpcal.results.notebook import leg_html  # which reads results

        return leg_html(self)


@dataclass(frozen=True)
class CampaignNote:
    """Which campaign a result is of: SHA-256 of its campaign.json, the robot's name, the number of measurements."""

    sha256: str = field(metadata=checked("campaign.json"))
    robot: str = field(metadata=checked("campaign.json"))
    measurements: int = field(metadata=checked("campaign.json"))


@dataclass(frozen=True, kw_only=True)
class Result:
    """The legs that were certified, and what was asked: everything that `result.json` holds.

    `interrupted`: the user stopped the run; legs that had not begun are missing. Raises ValueError for legs that have
    other parameters than the model, or that are there twice.
    """

    campaign: CampaignNote
    options: Options
    model: ModelNote = ModelNote()
    version: str = field(metadata=INFORMED)
    interrupted: bool = field(default=False, metadata=INFORMED)
    legs: tuple[LegResult, ...]

    def __post_init__(self) -> None:
        if len({leg.leg for leg in self.legs}) < len(self.legs):
            raise ValueError("a leg is there twice")
        if any(leg.enclosure.names != self.parameters for leg in self.legs):
            raise ValueError(f"a leg has not the parameters {', '.join(self.parameters)}")

    @property
    def robot(self) -> str:
        return self.campaign.robot

    @property
    def campaign_sha256(self) -> str:
        return self.campaign.sha256

    @property
    def measurements(self) -> int:
        return self.campaign.measurements

    @property
    def parameters(self) -> tuple[str, ...]:
        return self.model.parameters

    def plot(self, ax: Axes | None = None) -> Axes:
        """The bracket of each leg's smallest error, from zero, against the tolerance; on `ax`, or on new axes."""
        from cpcal.results.plots import errors_axes

        return errors_axes(self, ax)

    def to_frame(self) -> DataFrame:
        """A pandas table, a row a leg and parameter: center, proved point, range, and the leg's verdict and bracket."""
        from cpcal.results.frame import result_frame

        return result_frame(self)

    def _repr_html_(self) -> str:
        from cpcal.results.notebook import result_html

        return result_html(self)


def result_text(result: Result) -> str:
    """The text of `result.json`."""
    return text_of(result, FORMAT)


def save_result(result: Result, run: str | os.PathLike[str], campaign: Campaign | None = None) -> Path:
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
        raise InputError([Problem(where, f"cannot be read: {error.strerror}", remedy)]) from None
    if kept != result.campaign_sha256:
        raise InputError([Problem(where, "is another campaign than the result's", remedy)])
    if campaign is not None:
        save_campaign_json(campaign, folder)
    return save(result, folder / RESULT_NAME, FORMAT)


def load_result(run: str | os.PathLike[str]) -> Result:
    """Read `result.json` from the folder of a run. Raises InputError."""
    return load(Result, Path(run) / RESULT_NAME, FORMAT, remedy="name the folder of a run, or run certify again")
