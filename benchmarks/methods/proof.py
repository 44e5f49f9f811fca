"""The one place that knows how a certificate is written and checked."""

from __future__ import annotations

import time
from pathlib import Path

from cpcal.proof.checker import check
from cpcal.prove import write_certificate
from cpcal.result import LegResult, Result
from cpcal.robot import Campaign


def proved(campaign: Campaign, folder: Path, result: Result, leg: LegResult) -> dict[str, float]:
    """Steps, size and times of the certificate of `leg`, and the share of eps that its lower bound gives away.

    `folder` holds the files of the campaign; checking reads them, too. Raises what the writer or the checker raises.
    """
    began = time.perf_counter()
    path = write_certificate(campaign, folder, result, leg, folder.parent / "leg.cert.jsonl")
    written = time.perf_counter()
    accepted = check(path, folder)
    checked = time.perf_counter()
    return {
        "steps": accepted.steps,
        "size": path.stat().st_size / 1000,
        "write": written - began,
        "check": checked - written,
        "given away": float(leg.eps_lo - accepted.eps_lo) / leg.eps_hi,
    }
