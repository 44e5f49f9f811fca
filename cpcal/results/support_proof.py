"""What few measurements of a leg prove by themselves: plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cpcal.files.codec import checked


@dataclass(frozen=True)
class SupportProof:
    """Proved: no parameters in the leg's box satisfy the equations of its support to within less than `eps_lo` (mm).

    With one eps that was asked about it is that one, and refuted. `certificate`: the file that claims exactly this.
    Raises ValueError for a bound that says nothing.
    """

    eps_lo: float = field(metadata=checked("the bound of the certificate, by the support alone"))
    certificate: str = field(metadata=checked("a file of the run, which is accepted"))

    def __post_init__(self) -> None:
        if math.isnan(self.eps_lo) or self.eps_lo < 0.0:
            raise ValueError("eps_lo of the support is no bound")
