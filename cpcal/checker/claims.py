"""What a certificate claims, and what of it was accepted: plain values."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F


@dataclass(frozen=True)
class Point:
    """A point with what is proved of it, measurement by measurement; nothing is said of the others."""

    at: tuple[F, ...]
    holds: tuple[int, ...]
    fails: tuple[int, ...]


@dataclass(frozen=True)
class Claims:
    """What a certificate says of the problem's box.

    `infeasible`: no solution has an objective up to `cap`. `eps_lo`: none has a smaller objective; `eps_hi`: one has
    this. `enclosure`: all with an objective up to `cap` lie there. `point`: see Point.
    """

    cap: F | None
    infeasible: bool = False
    eps_lo: F | None = None
    eps_hi: F | None = None
    enclosure: tuple[tuple[F, ...], tuple[F, ...]] | None = None
    point: Point | None = None


@dataclass(frozen=True)
class Accepted:
    """What a certificate proves, of what, and how much work that was."""

    leg: int | None  # None: of constraints that the certificate states itself
    model: str | None  # of the leg
    about: str  # constraints of its own: what they are about, in the certificate's words, which are not checked
    campaign: str | None  # SHA-256 of the campaign.json that was used
    unknowns: tuple[str, ...]
    objective: int | None
    count: int  # of measurements or constraints
    chosen: tuple[int, ...]  # those that the certificate speaks of
    lo: tuple[F, ...]
    hi: tuple[F, ...]
    claims: Claims
    used: frozenset[int]  # measurements with a weight in some step
    steps: int
    last: tuple[tuple[str, int, str], ...] = ()  # rows of the last step
    forms: tuple[tuple[tuple[tuple[int, ...], F], ...], ...] = ()  # polynomials that are unknowns, of a leg
