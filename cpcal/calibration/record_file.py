"""`calibration.json`: a record as JSON, and back, every field checked."""

from __future__ import annotations

import os
from pathlib import Path

from cpcal.calibration.record import CalibrationRecord
from cpcal.files.codec import load, save

FORMAT = "cpcal-calibration/5"
RECORD_NAME = "calibration.json"


def save_record(record: CalibrationRecord, folder: str | os.PathLike[str]) -> Path:
    """Write `calibration.json` into `folder` (made if missing), all or nothing; its path. Raises InputError."""
    return save(record, Path(folder) / RECORD_NAME, FORMAT)


def load_record(folder: str | os.PathLike[str]) -> CalibrationRecord:
    """Read `calibration.json` in `folder`. Raises InputError."""
    remedy = "name a folder that cpcal calibrate wrote, or run it again"
    return load(CalibrationRecord, Path(folder) / RECORD_NAME, FORMAT, remedy=remedy)
