"""A comparison of models as plain values, and its file `compare.json`."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cpcal.files.codec import INFORMED, checked, load, save, text_of
from cpcal.questions.result import Determination, Options, wide
from cpcal.questions.verdict import EpsBracket, LegVerdict, compared, verdict_on
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

FORMAT = "cpcal-comparison/4"
COMPARISON_NAME = "compare.json"
_CLOSED = 1e-9  # mm: a bracket this narrow is closed, whatever the relative gap


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One model of one subject (a leg, a cable): proved, its smallest eps lies in [eps_lo, eps_hi].

    To within its smallest eps some parameters satisfy all equations: THERE EXISTS for each a reading in its set.
    `enclosure` holds all parameters with eps <= eps_hi. `certificate`: the file that proves it to `cpcal verify`; None:
    unchecked.
    """

    subject: str = field(metadata=checked("what the certificate is about", "certificate"))
    model: str = field(metadata=checked("what the certificate is about", "certificate"))
    eps_lo: float = field(metadata=checked("the claim of the certificate", "certificate"))
    eps_hi: float = field(metadata=checked("the claim of the certificate", "certificate"))
    enclosure: Box = field(metadata=checked("the claim of the certificate", "certificate"))
    certificate: str | None = field(metadata=checked("a file of the folder, which is accepted"))
    seconds: float = field(metadata=INFORMED)
    determination: Determination | None = field(default=None, metadata=INFORMED)
    not_certified: str = field(default="", metadata=INFORMED)  # why there is no certificate

    def __post_init__(self) -> None:
        """Raises ValueError for a bracket that is none."""
        if math.isnan(self.eps_lo) or math.isnan(self.eps_hi):
            raise ValueError("eps_lo or eps_hi is no number")

    def verdict(self, tolerance: float) -> Verdict:
        """Of "some parameters satisfy all equations to within the tolerance"."""
        if self.eps_lo > tolerance:
            return Verdict.REFUTED
        return Verdict.PROVED if self.eps_hi <= tolerance else Verdict.UNKNOWN

    def leg_verdict(self, tolerance: float, options: Options | None = None) -> LegVerdict:
        """The same as of a leg: a pass only where the measurements suffice to test the model.

        `options`: the comparison's; None, of the user's networks: ranges are not judged, as they have no common box.
        """
        closed = options is not None and self.eps_hi - self.eps_lo <= max(options.gap * self.eps_hi, _CLOSED)
        ranges = wide(self.enclosure, options.delta) if options is not None and closed else None
        bracket = EpsBracket(self.eps_lo, self.eps_hi)
        verdict = verdict_on(bracket, tolerance, determination=self.determination, ranges=ranges)
        return verdict if options is None else compared(verdict, self.model)

    def word(self, tolerance: float | None, options: Options | None = None) -> str:
        """The same for a table."""
        if tolerance is None:
            return "—"
        verdict = self.leg_verdict(tolerance, options)
        if verdict.kind in ("undecided", "undetermined", "uncompared"):
            return verdict.word
        word = "refuted" if verdict.kind == "unexplained" else "not refuted"
        return word + (", unchecked" if self.certificate is None else "")


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Subjects and their models, in the order asked. `tolerance` in the unit of eps (mm for legs), None: none asked.

    `models`: what each model is, by its name. `campaign_sha256` and `options`: None for the user's networks.
    `interrupted`: entries that had not begun are missing. Raises ValueError for entries of models that are not listed.
    """

    title: str = field(metadata=INFORMED)
    tolerance: float | None = field(metadata=INFORMED)
    models: Mapping[str, str] = field(metadata=checked("the text that cpcal has for them"))
    entries: tuple[Entry, ...]
    campaign_sha256: str | None = field(default=None, metadata=checked("campaign.json, and each certificate"))
    options: Options | None = None
    interrupted: bool = field(default=False, metadata=INFORMED)

    def __post_init__(self) -> None:
        unknown = {entry.model for entry in self.entries} - set(self.models)
        if unknown:
            raise ValueError(f"entries of models that are not listed: {sorted(unknown)}")

    def entry(self, subject: str, model: str) -> Entry:
        """Raises KeyError."""
        for entry in self.entries:
            if (entry.subject, entry.model) == (subject, model):
                return entry
        raise KeyError((subject, model))

    def refuted(self, tolerance: float | None = None) -> tuple[Entry, ...]:
        """Those refuted at a tolerance (default: the comparison's). Raises ValueError where there is none."""
        at = self.tolerance if tolerance is None else tolerance
        if at is None:
            raise ValueError("no tolerance was asked about: give one")
        return tuple(entry for entry in self.entries if entry.verdict(at) is Verdict.REFUTED)


def comparison_text(comparison: Comparison) -> str:
    """The text of `compare.json`."""
    return text_of(comparison, FORMAT)


def save_comparison(comparison: Comparison, folder: str | os.PathLike[str]) -> Path:
    """Write `compare.json` into the folder (made if missing), all or nothing; its path. Raises InputError."""
    return save(comparison, Path(folder) / COMPARISON_NAME, FORMAT)


def load_comparison(folder: str | os.PathLike[str]) -> Comparison:
    """Read `compare.json` from a folder. Raises InputError."""
    return load(Comparison, Path(folder) / COMPARISON_NAME, FORMAT, remedy="name the folder that compare wrote")
