"""`calibration.json`: a record as JSON, and back, every field checked for its type.

JSON has no NaN and no infinities: they are the strings "nan", "inf" and "-inf".
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from cpcal.calibration.record import CalibrationRecord, Parameters
from cpcal.errors import InputError, Problem
from cpcal.files.documents import json_object

FORMAT = "cpcal-calibration/1"
RECORD_NAME = "calibration.json"

_REMEDY = "run cpcal calibrate again"
_NUMBERS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


def save_record(record: CalibrationRecord, folder: str | os.PathLike[str]) -> Path:
    """Write `calibration.json` into `folder` (made if missing), all or nothing; its path. Raises OSError."""
    path = Path(folder) / RECORD_NAME
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    data = {"format": FORMAT, **_encoded(asdict(record))}
    partial.write_text(json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")
    return partial.replace(path)


def load_record(folder: str | os.PathLike[str]) -> CalibrationRecord:
    """Read `calibration.json` in `folder`. Raises InputError."""
    path = Path(folder) / RECORD_NAME
    data = json_object(path, "name a folder that cpcal calibrate wrote", _REMEDY)
    if data.pop("format", None) != FORMAT:
        raise InputError([Problem(str(path), f"is not of format {FORMAT}", _REMEDY)])
    try:
        record = _decoded(CalibrationRecord, data, "it")
        _check_shapes(record)
    except ValueError as error:
        raise InputError([Problem(str(path), f"lacks or garbles a field: {error}", _REMEDY)]) from None
    assert isinstance(record, CalibrationRecord)
    return record


def _encoded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _encoded(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_encoded(part) for part in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _decoded(kind: Any, value: Any, where: str) -> Any:
    """A value of JSON as `kind`: a dataclass, tuple[X, ...], float, int, bool or str. Raises ValueError."""
    if is_dataclass(kind) and isinstance(kind, type):
        if not isinstance(value, dict):
            raise ValueError(f"{where} is no object")
        hints = get_type_hints(kind)
        names = [field.name for field in fields(kind)]
        if set(value) != set(names):
            raise ValueError(f"{where} has not the fields {', '.join(names)}")
        return kind(**{name: _decoded(hints[name], value[name], name) for name in names})
    if get_args(kind):
        if not isinstance(value, list):
            raise ValueError(f"{where} is no list")
        return tuple(_decoded(get_args(kind)[0], part, where) for part in value)
    if kind is float and isinstance(value, str) and value in _NUMBERS:
        return _NUMBERS[value]
    allowed = (int, float) if kind is float else kind
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{where} is no {kind.__name__}")
    return kind(value)


def _check_shapes(record: CalibrationRecord) -> None:
    """The same number of legs everywhere, seven parameters each, and errors of the same poses."""
    legs = len(record.drawing)
    for name, fit in (("x_c", record.x_c), ("x_c_sigma", record.x_c_sigma)):
        _check_fit(name, fit, legs)
    if any(len(row) != 7 for row in record.drawing) or not legs:
        raise ValueError("drawing is not seven numbers a leg")
    for errors in (record.validation, record.validation_sigma):
        columns = (errors.position_before, errors.orientation_before, errors.position_after, errors.orientation_after)
        if any(len(column) != len(errors.names) for column in columns):
            raise ValueError("validation has not one error for each name")


def _check_fit(name: str, fit: Parameters, legs: int) -> None:
    for rows in (fit.values, fit.standard_errors):
        if len(rows) != legs or any(len(row) != 7 for row in rows):
            raise ValueError(f"{name} is not seven numbers for each of {legs} legs")
    if not all(math.isfinite(value) for row in fit.values for value in row):
        raise ValueError(f"{name} is not finite")
