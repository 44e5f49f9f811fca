"""Whether the measurements of a leg determine its parameters: plain values. Computed in floating point, no proof."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Determination:
    """The `rank` of the Jacobian of so many equations in `of` parameters, and those that they leave `undetermined`."""

    measurements: int
    of: int
    rank: int
    undetermined: tuple[str, ...] = ()

    @property
    def tests_the_model(self) -> bool:
        """Whether measurements are left to contradict the model, once the parameters are determined."""
        return not self.undetermined and self.measurements > self.of

    @property
    def sentence(self) -> str:
        """Empty when all is well."""
        count = f"{self.measurements:,} measurement{'' if self.measurements == 1 else 's'}"
        if self.undetermined:
            names = ", ".join(self.undetermined)
            return f"{count} of rank {self.rank} leave {len(self.undetermined)} of {self.of} parameters open: {names}."
        if not self.tests_the_model:
            return f"{count} determine {self.of} parameters, and none is left to test the model."
        return ""
