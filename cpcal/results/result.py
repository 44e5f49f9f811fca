"""What certification found, as plain values, and its file `result.json` (DESIGN section 8)."""

from __future__ import annotations

import html
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpcal.errors import InputError, Problem, printable
from cpcal.legs import PARAMETERS, PLAIN, LegModel, Parameter, leg_model
from cpcal.numbers import bracket_text, stated
from cpcal.results.projection import Projections
from cpcal.results.verified_point import VerifiedPoint
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.optimize import Trial
from cpcal.solver.search import ContractorUse

FORMAT = "cpcal-result/1"


@dataclass(frozen=True)
class ModelNote:
    """The leg model of a result: its name, what it takes a leg's length to be, its parameters beyond (a, b, l)."""

    name: str = PLAIN.name
    summary: str = PLAIN.summary
    extra: tuple[Parameter, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*PARAMETERS, *(p.name for p in self.extra))

    def unit(self, name: str) -> str:
        return next((p.unit for p in self.extra if p.name == name), "mm")

    def to_json(self) -> dict[str, Any]:
        extra = [{"name": p.name, "unit": p.unit, "half_width": p.half_width} for p in self.extra]
        return {"name": self.name, "summary": self.summary, "parameters": extra}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ModelNote:
        extra = (Parameter(str(p["name"]), str(p["unit"]), float(p["half_width"])) for p in data["parameters"])
        return cls(str(data["name"]), str(data["summary"]), tuple(extra))


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


@dataclass(frozen=True)
class LegResult:
    """One leg: proved, no x in the box satisfies all equations for any eps < `eps_lo`; `point` does at `eps_hi`.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. Lengths in mm. `verdict` PROVED: the
    bracket is closed (or, when an eps was asked for, some x satisfies it); REFUTED: no x does; UNKNOWN: a limit
    came first. `point` is (ax, ay, az, bx, by, bz, l) and the model's extra parameters, None without a proved point;
    `enclosure` holds every x with eps <= eps_hi. `floor`: second-order effect of the readings below which the bracket
    cannot close. `support`: ids of measurements that by themselves prove eps_lo up to the gap or, where no few were
    found to, of all with a weight in some step.
    """

    leg: int
    verdict: Verdict
    status: str
    eps_lo: float
    eps_hi: float
    point: tuple[float, ...] | None
    center: tuple[float, ...]
    enclosure: Box
    floor: float
    support: tuple[str, ...]
    nodes: int
    programs: int
    seconds: float
    certificate: str | None = None
    projections: Projections | None = None  # what the report draws; see cpcal.certify.projections
    verified: VerifiedPoint | None = None  # the center of the box, as a solution at eps = 0 (or the eps asked about)
    trials: tuple[Trial, ...] = ()  # calls of the solver, with method "timeout"
    contractors_used: tuple[ContractorUse, ...] = ()  # those asked for: how often each ran, its part in the certificate
    found_lo: float | None = None  # the lower bound of eps by all contractors, where the certificate proves less

    @property
    def not_refuted(self) -> bool:
        """Whether the model without any error is proved to fit: eps* = 0."""
        return self.point is not None and self.eps_hi == 0.0

    def _repr_html_(self) -> str:
        """For notebooks: the verdict and a sentence. The bracket only where it says more than the sentence."""
        lo, hi = bracket_text(self.eps_lo, self.eps_hi)
        between = f"The smallest model error lies between {lo} and {hi} mm. "
        bracket = between if self.eps_lo < self.eps_hi < math.inf else ""
        return f"<p><b>Leg {_escaped(self.leg)}: {self.verdict.value}.</b> {bracket}{_escaped(self.status)}</p>"

    def to_json(self) -> dict[str, Any]:
        return {
            "leg": self.leg,
            "status": self.verdict.value,
            "sentence": self.status,
            "eps_lo": _number(self.eps_lo),
            "eps_hi": _number(self.eps_hi),
            "point": None if self.point is None else list(self.point),
            "center": list(self.center),
            "enclosure": None
            if self.enclosure.is_empty
            else {
                "lo": [_number(v) for v in self.enclosure.lo],
                "hi": [_number(v) for v in self.enclosure.hi],
            },
            "floor": self.floor,
            "support": list(self.support),
            "certificate": self.certificate,
            "nodes": self.nodes,
            "lps": self.programs,
            "seconds": self.seconds,
            "center_verified": None if self.verified is None else self.verified.to_json(),
            **({} if self.projections is None else {"projections": self.projections.to_json()}),
            **({"trials": [t.to_json() for t in self.trials]} if self.trials else {}),
            "contractors_used": [use.to_json() for use in self.contractors_used],
            "found_lo": None if self.found_lo is None else _number(self.found_lo),
        }

    @classmethod
    def from_json(cls, data: dict[str, Any], names: tuple[str, ...]) -> LegResult:
        enclosure, projections, verified = data["enclosure"], data.get("projections"), data.get("center_verified")
        return cls(
            data["leg"],
            Verdict(data["status"]),
            data["sentence"],
            _float(data["eps_lo"]),
            _float(data["eps_hi"]),
            None if data["point"] is None else tuple(map(float, data["point"])),
            tuple(map(float, data["center"])),
            Box.empty(names)
            if enclosure is None
            else Box(names, [_float(v) for v in enclosure["lo"]], [_float(v) for v in enclosure["hi"]]),
            data["floor"],
            tuple(data["support"]),
            data["nodes"],
            data["lps"],
            data["seconds"],
            data["certificate"],
            None if projections is None else Projections.from_json(projections, names),
            None if verified is None else VerifiedPoint.from_json(verified),
            tuple(Trial.from_json(t) for t in data.get("trials", ())),
            tuple(ContractorUse.from_json(use) for use in data.get("contractors_used", ())),
            None if data.get("found_lo") is None else _float(data["found_lo"]),
        )


@dataclass(frozen=True)
class Result:
    """The legs that were certified, and what was asked: everything that `result.json` holds.

    `eps`: the tolerance that was asked about, or None when the smallest one was sought. `interrupted`: the user
    stopped the run; legs that had not begun are missing.
    """

    robot: str
    campaign_sha256: str
    measurements: int
    parameters: tuple[str, ...]
    delta: float
    center: str
    gap: float
    eps: float | None
    contractors: tuple[str, ...]
    arithmetic: str
    version: str
    legs: tuple[LegResult, ...]
    interrupted: bool = False
    method: str = "bound"
    time_limit: float | None = None
    support: str = "few"
    model: ModelNote = ModelNote()

    def _repr_html_(self) -> str:
        """For notebooks: a table, a row a leg. Bounds are rounded to the side on which they stay proved."""
        names = ("eps_lo [mm]", "eps_hi [mm]") if self.eps is None else ("eps asked [mm]",)
        header = "".join(f"<th>{name}</th>" for name in ("leg", "verdict", *names, "support", "sentence"))
        rows = []
        for leg in self.legs:
            bounds = bracket_text(leg.eps_lo, leg.eps_hi) if self.eps is None else (stated(self.eps),)
            cells = (leg.leg, leg.verdict.value, *bounds, len(leg.support), leg.status)
            rows.append("<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in cells) + "</tr>")
        title = f"{_escaped(self.robot)}: {self.measurements:,} measurements"
        stopped = "; interrupted: what is shown was proved until then" if self.interrupted else ""
        return (
            f"<table><caption>{title}{stopped}</caption><thead><tr>{header}</tr></thead>"
            f"<tbody>{''.join(rows)}</tbody></table>"
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "campaign": {
                "sha256": self.campaign_sha256,
                "robot": self.robot,
                "measurements": self.measurements,
            },
            "box": {"center": self.center, "delta": self.delta, "parameters": list(self.parameters)},
            "question": {
                "eps": self.eps,
                "gap": self.gap,
                "method": self.method,
                "time_limit": self.time_limit,
                "support": self.support,
            },
            "solver": {
                "version": self.version,
                "contractors": list(self.contractors),
                "arithmetic": self.arithmetic,
            },
            **({} if self.model.name == PLAIN.name else {"model": self.model.to_json()}),
            "interrupted": self.interrupted,
            "legs": [leg.to_json() for leg in self.legs],
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Result:
        names, question = tuple(data["box"]["parameters"]), data["question"]
        return cls(
            data["campaign"]["robot"],
            data["campaign"]["sha256"],
            data["campaign"]["measurements"],
            names,
            data["box"]["delta"],
            data["box"]["center"],
            question["gap"],
            question["eps"],
            tuple(data["solver"]["contractors"]),
            data["solver"]["arithmetic"],
            data["solver"]["version"],
            tuple(LegResult.from_json(leg, names) for leg in data["legs"]),
            data["interrupted"],
            question.get("method", "bound"),
            question.get("time_limit"),
            question.get("support", "few"),
            ModelNote.from_json(data["model"]) if "model" in data else ModelNote(),
        )


def save_result(result: Result, run: str | os.PathLike[str]) -> Path:
    """Write `result.json` into the folder `run` (made if missing), all or nothing; its path."""
    folder = Path(run)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "result.json"
    partial = folder / ".result.json.partial"
    partial.write_text(json.dumps(result.to_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    partial.replace(path)
    return path


def load_result(run: str | os.PathLike[str]) -> Result:
    """Read `result.json` from the folder of a run. Raises InputError."""
    path = Path(run) / "result.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError([Problem(str(path), f"cannot be read: {error}", "name the folder of a run")]) from None
    except json.JSONDecodeError as error:
        raise InputError([Problem(str(path), f"is not JSON: {error.msg}", "run certify again", error.lineno)]) from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError([Problem(str(path), f"is not of format {FORMAT}", "run certify again")])
    try:
        return Result.from_json(data)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError([Problem(str(path), f"lacks or garbles a field: {error!r}", "run certify again")]) from None


def _escaped(value: object) -> str:
    """As text of an HTML page."""
    return html.escape(printable(str(value)))


def _number(value: float) -> float | str:
    """JSON has no infinities: they are the strings "inf" and "-inf"."""
    return float(value) if math.isfinite(value) else str(float(value))


def _float(value: float | str) -> float:
    return float(value)
