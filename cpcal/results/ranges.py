"""In which range each parameter of a leg lies, if the leg's equations are to hold to within some eps: plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cpcal.files.codec import checked
from cpcal.solver.interval import Box


@dataclass(frozen=True)
class Ranges:
    """Proved: all parameters in the leg's box that satisfy its equations to within `eps` (mm) lie in `box`.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. `certificate`: the file that claims exactly
    this; None: proved in outward-rounded arithmetic, and nobody can check it again. Raises ValueError for an eps that
    is no tolerance, and for a box that holds nothing.
    """

    eps: float = field(metadata=checked("the cap of the certificate", "certificate"))
    box: Box = field(metadata=checked("the enclosure of the certificate", "certificate"))
    certificate: str | None = field(default=None, metadata=checked("a file of the run, which is accepted"))

    def __post_init__(self) -> None:
        if not 0.0 <= self.eps < math.inf:
            raise ValueError("eps of the ranges is no tolerance")
        if self.box.is_empty:
            raise ValueError("the ranges are empty")
