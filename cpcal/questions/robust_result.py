"""The smallest model error when some measurements may be wrong, as plain values, and its file `robust.json`."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from cpcal.files.codec import INFORMED, checked, load, save
from cpcal.questions.result import CampaignNote, ModelNote, Options

FORMAT = "cpcal-robust/2"
ROBUST_NAME = "robust.json"
MARGIN = 1e-5  # relative, below eps_hi: what is proved of every choice of outliers
SMALLEST = 1e-9  # mm, likewise


@dataclass(frozen=True)
class RobustLeg:
    """One leg when at most `outliers` of its measurements may be wrong, nobody knows which. Lengths in mm.

    PROVED: whichever so many are left out, no parameters in the box satisfy all others for any eps < `eps_lo`.
    `point` satisfies all but those `left_out` (names) at `eps_hi`; None and infinite without one.

    `proofs`: certificates. Whichever `outliers` measurements are left out, one of these does without them and proves
    eps_lo. `point_certificate` proves the point. Empty and None where no certificates were asked for.
    `searches`: how many sets of measurements were looked at.
    """

    leg: int = field(metadata=checked("the list of legs, and each certificate"))
    outliers: int = field(metadata=checked("that of the whole"))
    eps_lo: float = field(metadata=checked("the least bound of the proofs, which no choice spoils", "proofs"))
    eps_hi: float = field(metadata=checked("the claim of the certificate of the point", "point_certificate"))
    point: tuple[float, ...] | None = field(metadata=checked("the claim of its certificate", "point_certificate"))
    center: tuple[float, ...] = field(metadata=checked("the box of each certificate", "proofs", "point_certificate"))
    left_out: tuple[str, ...] = field(metadata=checked("the measurements of the certificate", "point_certificate"))
    proofs: tuple[str, ...] = field(metadata=checked("files of the run, which are accepted"))
    point_certificate: str | None = field(metadata=checked("a file of the run, which is accepted"))
    searches: int = field(metadata=INFORMED)
    seconds: float = field(metadata=INFORMED)

    @property
    def complete(self) -> bool:
        """Whether the bracket is closed."""
        return self.point is not None and self.eps_hi - self.eps_lo <= 2.0 * max(MARGIN * self.eps_hi, SMALLEST)

    @property
    def sentence(self) -> str:
        """What is proved, without numbers."""
        if not self.complete:
            return "Both bounds are proved; the search stopped at a limit before they met."
        return "Both bounds are proved and the gap is closed."


@dataclass(frozen=True)
class RobustResult:
    """The legs that were asked about, and how."""

    campaign: CampaignNote
    options: Options
    model: ModelNote
    outliers: int = field(metadata=checked("what the proofs bear"))
    version: str = field(metadata=INFORMED)
    legs: tuple[RobustLeg, ...]


def save_robust(found: RobustResult, folder: str | os.PathLike[str]) -> Path:
    """Write `robust.json` into the folder, all or nothing; its path. Raises InputError."""
    return save(found, Path(folder) / ROBUST_NAME, FORMAT)


def load_robust(folder: str | os.PathLike[str]) -> RobustResult:
    """Read `robust.json` from the folder. Raises InputError."""
    return load(RobustResult, Path(folder) / ROBUST_NAME, FORMAT, remedy="certify again")
