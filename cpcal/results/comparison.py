"""A comparison of models as plain values, and its file `compare.json`."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpcal.errors import InputError, Problem
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

FORMAT = "cpcal-comparison/1"
COMPARISON_NAME = "compare.json"


@dataclass(frozen=True)
class Entry:
    """One model of one subject (a leg, a cable): proved, its smallest eps lies in [eps_lo, eps_hi].

    To within its smallest eps some parameters satisfy all equations: THERE EXISTS for each a reading in its set.
    `enclosure` holds all parameters with eps <= eps_hi. `certificate`: the file that proves it to `cpcal verify`; None:
    unchecked. `status`: how the proof ended.
    """

    subject: str
    model: str
    eps_lo: float
    eps_hi: float
    enclosure: Box
    certificate: str | None
    status: str
    seconds: float

    def verdict(self, tolerance: float) -> Verdict:
        """Of "some parameters satisfy all equations to within the tolerance"."""
        if self.eps_lo > tolerance:
            return Verdict.REFUTED
        return Verdict.PROVED if self.eps_hi <= tolerance else Verdict.UNKNOWN

    def word(self, tolerance: float | None) -> str:
        """The same for a table."""
        if tolerance is None:
            return "—"
        words = {Verdict.REFUTED: "refuted", Verdict.PROVED: "not refuted", Verdict.UNKNOWN: "unknown"}
        verdict = self.verdict(tolerance)
        unchecked = verdict is not Verdict.UNKNOWN and self.certificate is None
        return words[verdict] + (", unchecked" if unchecked else "")

    def to_json(self, tolerance: float | None) -> dict[str, Any]:
        box, names = self.enclosure, list(self.enclosure.names)
        return {
            "subject": self.subject,
            "model": self.model,
            "eps_lo": _number(self.eps_lo),
            "eps_hi": _number(self.eps_hi),
            "at_tolerance": None if tolerance is None else self.verdict(tolerance).value,
            "certificate": self.certificate,
            "parameters": names,
            "enclosure": None
            if box.is_empty
            else {"lo": [_number(v) for v in box.lo], "hi": [_number(v) for v in box.hi]},
            "status": self.status,
            "seconds": self.seconds,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Entry:
        names, found = tuple(data["parameters"]), data["enclosure"]
        sides = None if found is None else [[float(v) for v in found[side]] for side in ("lo", "hi")]
        return cls(
            str(data["subject"]),
            str(data["model"]),
            float(data["eps_lo"]),
            float(data["eps_hi"]),
            Box.empty(names) if sides is None else Box(names, *sides),
            None if data["certificate"] is None else str(data["certificate"]),
            str(data["status"]),
            float(data["seconds"]),
        )


@dataclass(frozen=True)
class Comparison:
    """Subjects and their models, in the order asked. `tolerance` in the unit of eps (mm for legs), None: none asked.

    `models`: what each model is, by its name. `campaign_sha256`: None for networks of one's own. `interrupted`: entries
    that had not begun are missing.
    """

    title: str
    tolerance: float | None
    models: dict[str, str]
    entries: tuple[Entry, ...]
    campaign_sha256: str | None = None
    interrupted: bool = False

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

    def to_json(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "title": self.title,
            "campaign_sha256": self.campaign_sha256,
            "tolerance": self.tolerance,
            "models": dict(self.models),
            "interrupted": self.interrupted,
            "entries": [entry.to_json(self.tolerance) for entry in self.entries],
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Comparison:
        sha256, tolerance = data["campaign_sha256"], data["tolerance"]
        entries = tuple(Entry.from_json(entry) for entry in data["entries"])
        unknown = {entry.model for entry in entries} - set(data["models"])
        if unknown:
            raise ValueError(f"entries of models that are not listed: {sorted(unknown)}")
        return cls(
            str(data["title"]),
            None if tolerance is None else float(tolerance),
            {str(k): str(v) for k, v in data["models"].items()},
            entries,
            None if sha256 is None else str(sha256),
            bool(data["interrupted"]),
        )


def save_comparison(comparison: Comparison, folder: str | os.PathLike[str]) -> Path:
    """Write `compare.json` into the folder (made if missing), all or nothing; its path."""
    path = Path(folder) / COMPARISON_NAME
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{COMPARISON_NAME}.partial")
    partial.write_text(json.dumps(comparison.to_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return partial.replace(path)


def load_comparison(folder: str | os.PathLike[str]) -> Comparison:
    """Read `compare.json` from a folder. Raises InputError."""
    path = Path(folder) / COMPARISON_NAME
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT}")
        return Comparison.from_json(data)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"is no comparison: {error!r}"
        raise InputError([Problem(str(path), what, "name the folder that compare wrote")]) from None


def _number(value: float) -> float | str:
    """JSON has no infinities: they are the strings "inf" and "-inf"."""
    return float(value) if math.isfinite(value) else str(float(value))
