"""A problem whose constraints are one leg's rows of a campaign. Standard library only; part of the checker."""

from __future__ import annotations

from fractions import Fraction as F
from typing import Protocol

from cpcal.checker.equation import Equation
from cpcal.checker.measurement import Measurement
from cpcal.checker.models import Model
from cpcal.checker.polynomial import ExactBox, Polynomial, least, shifted


class Readings(Protocol):
    """One leg's rows of a campaign."""

    def __len__(self) -> int: ...

    def measurement(self, k: int) -> Measurement: ...


class Leg:
    """Measurements of a campaign, all or the `chosen` ones, in the unknowns of a leg model."""

    sides = ("upper", "lower", "length")

    def __init__(self, campaign: Readings, model: Model, only: tuple[int, ...] | None = None) -> None:
        self._campaign, self.count = campaign, len(campaign)
        self.model, self.unknowns, self.objective = model, model.unknowns, model.eps
        self.chosen = tuple(range(self.count)) if only is None else only
        self._known: dict[int, Equation] = {}

    def equation(self, k: int) -> Equation:
        """Read when first used."""
        if k not in self._known:
            self._known[k] = Equation(self._campaign.measurement(k), self.model)
        return self._known[k]

    def row(self, side: str, k: int, box: ExactBox) -> Polynomial:
        return self.equation(k).row(side, box)

    def holds(self, k: int, point: tuple[F, ...]) -> bool:
        return self.equation(k).holds(point)

    def fails(self, k: int, point: tuple[F, ...]) -> bool:
        """At every reading one of the inequalities is violated."""
        box = ExactBox(point, point)
        return any(least(shifted(self.row(side, k, box), box)) > 0 for side in self.sides)
