"""Parameters for a controller: least squares and certified side by side, with ranges, frame and provenance."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cpcal.common.values import Floats
from cpcal.questions import LegResult, Result, model_of, verdict_of
from cpcal.report.advice import fitted
from cpcal.report.run_page import DRAWING_FRAME, DrawingFrames, command
from cpcal.report.words import FRAME, overall
from cpcal.robot import Campaign

FORMAT = "cpcal-parameters/1"
NOT_CERTIFIED = "not certified"  # the verdict where no certificate holds it
_COLUMNS = ("nominal", "least_squares", "certified", "range_lo", "range_hi")


def exported(campaign: Campaign, result: Result, frames: DrawingFrames | None = None) -> dict[str, Any]:
    """What is exported, as texts, numbers, lists and dicts; what is not known, or in no certificate, is left out.

    `frames`: of the drawing, to which the parameters are moved. Raises InputError for a model that is not known here.
    """
    verdict, certified = overall(result), all(leg.certified for leg in result.legs)
    provenance = {
        **campaign.provenance,
        "campaign_sha256": result.campaign.sha256,
        "measurements": result.campaign.measurements,
        "cpcal": result.version,
        "command": command(result),
    }
    return _known(
        format=FORMAT,
        robot=result.campaign.robot,
        model=result.model.name,
        not_compared=result.model.not_compared or None,
        frame=FRAME if frames is None else DRAWING_FRAME,
        tolerance=result.options.tolerance,
        verdict=None if verdict is None else verdict.word.lower() if certified else NOT_CERTIFIED,
        missing_legs=sorted({*range(1, campaign.legs + 1)} - {leg.leg for leg in result.legs}) or None,
        provenance=provenance,
        legs=[_leg(campaign, result, leg, frames) for leg in result.legs],
    )


def _leg(campaign: Campaign, result: Result, leg: LegResult, frames: DrawingFrames | None) -> dict[str, Any]:
    nominal = np.append(campaign.robot.parameters[leg.leg - 1], np.zeros(len(result.model.extra)))
    fit = fitted(campaign, result, leg, model_of(result)).x
    certified = None if leg.bracket.point is None or not leg.certified else np.array(leg.bracket.point)
    ranges = None if leg.ranges is None or leg.ranges.certificate is None else leg.ranges
    box = None if ranges is None else (ranges.box.lo, ranges.box.hi)
    if frames is not None:
        nominal, fit = frames.point(nominal), frames.point(fit)
        certified = None if certified is None else frames.point(certified)
        box = None if box is None else frames.box(*box)
    values: list[Floats | None] = [nominal, fit, certified, *(box or (None, None))]
    parameters = {
        name: {
            "unit": result.model.unit(name),
            **_known(**{c: None if v is None else float(v[k]) for c, v in zip(_COLUMNS, values, strict=True)}),
        }
        for k, name in enumerate(result.model.parameters)
    }
    files = [leg.bracket.certificate, None if ranges is None else ranges.certificate]
    return _known(
        leg=leg.leg,
        verdict=verdict_of(result, leg).word if leg.certified else NOT_CERTIFIED,
        not_certified=str(leg.not_certified) or None,
        eps_lo=leg.bracket.lo if leg.certified and math.isfinite(leg.bracket.lo) else None,
        eps_hi=leg.bracket.hi if leg.certified and math.isfinite(leg.bracket.hi) else None,
        range_eps=None if ranges is None else ranges.eps,
        certificates=[name for name in files if name is not None],
        parameters=parameters,
    )


def _known(**fields: Any) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def as_json(data: Mapping[str, Any]) -> str:
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def as_csv(data: Mapping[str, Any]) -> str:
    """A row a parameter; frame and provenance are in the other formats only, but for the robot and the campaign."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("leg", "parameter", "unit", *_COLUMNS, "verdict", "range_eps", "campaign_sha256"))
    for leg in data["legs"]:
        rest = (leg["verdict"], leg.get("range_eps", ""), data["provenance"]["campaign_sha256"])
        for name, values in leg["parameters"].items():
            writer.writerow((leg["leg"], name, values["unit"], *(values.get(c, "") for c in _COLUMNS), *rest))
    return stream.getvalue()


def as_toml(data: Mapping[str, Any]) -> str:
    return "\n".join(_toml(data, "")) + "\n"


def _toml(table: Mapping[str, Any], path: str) -> Iterator[str]:
    """Simple values first, then tables, then arrays of tables."""
    nested = {k: v for k, v in table.items() if isinstance(v, Mapping) or (isinstance(v, list) and _tables(v))}
    for key, value in table.items():
        if key not in nested:
            yield f"{_key(key)} = {_scalar(value)}"
    for key, value in nested.items():
        name = f"{path}{_key(key)}"
        for part in value if isinstance(value, list) else [value]:
            yield f"\n[[{name}]]" if isinstance(value, list) else f"\n[{name}]"
            yield from _toml(part, f"{name}.")


def _tables(values: list[Any]) -> bool:
    return bool(values) and isinstance(values[0], Mapping)


def as_yaml(data: Mapping[str, Any]) -> str:
    return "\n".join(_yaml(data, "")) + "\n"


def _yaml(table: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield f"{indent}{_key(key)}:"
            yield from _yaml(value, indent + "  ")
        elif isinstance(value, list) and _tables(value):
            yield f"{indent}{_key(key)}:"
            for part in value:
                first, *rest = _yaml(part, indent + "    ")
                yield f"{indent}  - {first.lstrip()}"
                yield from rest
        else:
            yield f"{indent}{_key(key)}: {_scalar(value)}"


def _key(name: str) -> str:
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else _scalar(name)


def _scalar(value: Any) -> str:
    """A text, number or list as JSON writes it, which TOML and YAML read alike.

    Characters stay as they are: JSON would write one beyond the basic plane as two halves, which no other reader takes.
    """
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)


WRITERS = {"toml": as_toml, "json": as_json, "yaml": as_yaml, "csv": as_csv}
