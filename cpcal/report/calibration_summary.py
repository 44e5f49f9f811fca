"""What matters of a calibration in at most twelve lines, for a terminal: doubts first. The tables say the rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cpcal.calibration import CalibrationRecord
from cpcal.calibration.repeatability import KINDS
from cpcal.common.names import listed
from cpcal.common.numbers import about

_NAMED = 6  # channels


def summary(record: CalibrationRecord) -> tuple[str, ...]:
    """Sentences; lengths in mm and angles in degrees."""
    budget = () if record.budget is None else (record.budget.sentence,)
    return (
        f"{record.robot}: {record.readings:,} readings of {record.configurations} configurations. {record.screening}",
        *_doubts(record),
        record.repeats,
        f"x_c_sigma: {record.x_c_sigma.sentence}",
        _known(record),
        *budget,
        f"Validation of x_c_sigma: {record.validation_sigma.validation.sentence}",
        record.diagnosis.sentence,
    )


def _doubts(record: CalibrationRecord) -> Iterator[str]:
    """What speaks against independent normal noise; one sentence where nothing does."""
    statistics = [channel.statistics for channel in record.channels]
    names = [one.name for one in statistics if one.not_normal()]
    said = [f"NOT NORMAL (backlash, drift?): {listed(names, _NAMED)}."] if names else []
    said += [record.tests.sentence(kind) for kind in KINDS if record.tests.found(kind)]
    yield from said or ["Repeats scatter as independent noise does, as far as it can be tested."]


def _known(record: CalibrationRecord) -> str:
    """How well the parameters are known, by least squares."""
    errors = 2.0 * np.array(record.x_c_sigma.standard_errors)
    finite = errors[np.isfinite(errors)]
    if not finite.size:
        return "No parameter has a known uncertainty."
    least, most = (about(float(value), 3) for value in (finite.min(), finite.max()))
    without = "" if finite.size == errors.size else f"; of {errors.size - finite.size} parameters nothing is known"
    known = f"Parameters have expanded uncertainties U (k = 2) of {least} to {most} mm"
    return f"{known}, in the frames of camera and target{without}."
