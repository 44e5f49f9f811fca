"""From a log to a campaign: columns by a map, units and rotation form by name, what the log lacks from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import YOUR_DATA, InputError, Problems
from cpcal.common.names import TEXT_MAX
from cpcal.files.log_reader import Log, number_texts
from cpcal.robot import Campaign, ModelChoice, Robot, Uncertainty
from cpcal.robot.campaign_arrays import mapped, table_arguments, unit_factor
from cpcal.robot.columns import ColumnSource, is_length
from cpcal.robot.rotation_form import RotationForm
from cpcal.robot.units import LENGTHS


@dataclass(frozen=True)
class LogSettings:
    """What a log does not say. `uncertainty` None: readings are exact."""

    robot: Robot
    uncertainty: Uncertainty | None
    columns: str | Mapping[str, str]
    rotation: str
    provenance: Mapping[str, str]
    model: ModelChoice | None = None


def campaign_of_log(log: Log, settings: LogSettings) -> Campaign:
    """The campaign in a log. Lengths are converted in decimal, so that 0.1 m is the float nearest to 100 mm.

    Poses are named p1, p2, ... in the order of the rows unless a column is mapped to `pose`. Raises InputError with
    every cell that is no number, by its line.
    """
    form = RotationForm.named(settings.rotation)
    header = log.header or tuple(f"#{i}" for i in range(1, len(log.rows[0]) + 1))
    found = mapped(settings.columns, header, settings.robot.legs, form)
    names: dict[str, list[str]] = {}
    values: dict[str, Floats] = {}
    problems = Problems()
    for target, source in found.items():
        place = source.place(header)
        assert place is not None  # `mapped` raised otherwise
        if target in ("pose", "run"):
            names[target] = [row[place] for row in log.rows]
        else:
            values[target] = _column(log, place, target, source, form, problems)
    problems.raise_any(YOUR_DATA)
    try:
        arguments = table_arguments(names, values, settings.robot, form, settings.uncertainty)
    except InputError as error:
        raise _by_line(error, log) from None
    told = {"imported_from": Path(log.where).name, "rotation_form": form.name, "columns": _told(found)}
    provenance = dict(settings.provenance) | told
    return Campaign.of(**arguments, exact=settings.uncertainty is None, provenance=provenance, model=settings.model)


def _column(log: Log, place: int, target: str, source: ColumnSource, form: RotationForm, problems: Problems) -> Floats:
    texts = number_texts(log, place, target, problems)
    if is_length(target):
        size = LENGTHS[source.unit or "mm"]
        return np.array([float(Decimal(text) * size) for text in texts])
    return unit_factor(target, source, form) * np.array([float(text) for text in texts])


def _told(found: Mapping[str, ColumnSource]) -> str:
    entries = (f'{target}="{source.name}"[{source.unit or ""}]' for target, source in found.items())
    return "".join(c for c in ", ".join(entries).replace("[]", "") if c.isprintable())[:TEXT_MAX]


def _by_line(error: InputError, log: Log) -> InputError:
    """The same problems, with the log's line instead of a row's number."""
    problems = []
    for problem in error.problems:
        start, _, row = problem.where.rpartition(" ")
        if start == "rotation of row":
            problem = type(problem)(log.where, f"the rotation {problem.what}", problem.remedy, log.lines[int(row)])
        problems.append(problem)
    return InputError(problems, omitted=error.omitted)
