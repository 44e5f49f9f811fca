"""A result as a table of pandas, which is needed only here."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import InputError, Problem
from cpcal.results.leg_verdict import verdict_of
from cpcal.results.result import LegResult, Result

if TYPE_CHECKING:
    from pandas import DataFrame


def result_frame(result: Result) -> DataFrame:
    """Raises InputError without pandas."""
    try:
        import pandas
    except ImportError:
        raise InputError([Problem("to_frame", "needs pandas", "pip install 'cpcal[frames]'")]) from None
    return pandas.DataFrame([row for leg in result.legs for row in _rows(result, leg)])


def _rows(result: Result, leg: LegResult) -> list[dict[str, Any]]:
    known = leg.ranges
    return [
        {
            "leg": leg.leg,
            "parameter": name,
            "unit": result.model.unit(name),
            "center": leg.center[k],
            "certified": math.nan if leg.point is None else leg.point[k],
            "range_lo": math.nan if known is None else float(known.box.lo[k]),
            "range_hi": math.nan if known is None else float(known.box.hi[k]),
            "range_eps": math.nan if known is None else known.eps,
            "verdict": verdict_of(result, leg).word,
            "eps_lo": leg.eps_lo,
            "eps_hi": leg.eps_hi,
        }
        for k, name in enumerate(result.parameters)
    ]
