"""The certified sets of an accuracy run, as far as certificates hold them: a box around each, for the checker.

The bounds of poses rest on the sets' support functions, which are tighter than the boxes and proved in interval
arithmetic only. What the checker proves is where all of it begins: that with the model error that is assumed all
parameters of a leg lie in a box, or that there are none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpcal.accuracy.findings import AssumedError, CertifiedBox
from cpcal.certify.bracket import by_bound
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.certify.question import Question
from cpcal.results import Result
from cpcal.robot import Campaign

PREFIX = "set-"  # of the certificates' names


def certified_boxes(
    campaign: Campaign, result: Result, assumed: Sequence[AssumedError], folder: Path
) -> tuple[CertifiedBox, ...]:
    """Write `set-legN.cert.jsonl` into the folder for each leg, and say what they prove."""
    out = []
    for leg, error in zip(result.legs, assumed, strict=True):
        options = replace(result.options, eps=error.eps, tolerance=None, method="bound")
        question = Question(campaign=campaign, options=options, certificates=folder, prefix=PREFIX)
        center = np.array(leg.center)
        start = np.append(leg.center if leg.point is None else leg.point, error.eps)
        found = by_bound(PreparedLeg.of(question, leg.leg, center), start, lambda _: None)
        box = found.minimum.enclosure
        sides = (tuple(map(float, side[:7])) for side in (box.lo, box.hi))
        lo, hi = ((), ()) if box.is_empty else sides
        out.append(CertifiedBox(leg.leg, error.eps, lo, hi, found.certificate))
    return tuple(out)
