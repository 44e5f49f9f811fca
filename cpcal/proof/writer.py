"""Writes certificates: the search once more, with every step proved by the checker's own rule before it counts.

A linear program proposes weights, they are shortened, and `bounds.Bounder` says in exact arithmetic what they prove.
The search goes on from the boxes that were proved, so what is written is what the checker will see.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction as F
from typing import Any

import numpy as np

from cpcal.interfaces import Contraction, Contractor, Step, StepWeights
from cpcal.interval import Box
from cpcal.proof.bounds import Bounder, ExactBox, Weights
from cpcal.proof.measurement import Measurement

_BITS = (10, 16, 24, 53)  # of a weight's mantissa: the first that proves nearly as much as was proposed
_LOSS = 0.02  # of the width that was proposed, given away for shorter numbers
_SIDES = {(0, 0): "length", (0, 1): "upper", (0, 2): "lower", (1, 0): "length"}


def rounded(value: F, down: bool) -> float:
    """The nearest float64 that is not above (below) a fraction."""
    nearest = float(value)
    if down and F(nearest) > value:
        return math.nextafter(nearest, -math.inf)
    if not down and F(nearest) < value:
        return math.nextafter(nearest, math.inf)
    return nearest


def brief(value: F, down: bool, loss: float) -> float:
    """A float64 with few digits that is at most about `loss` below (above) a fraction."""
    if loss > 0.0:
        unit = F(2) ** (math.frexp(loss)[1] - 1)
        value = ((value / unit).__floor__() if down else (value / unit).__ceil__()) * unit
    return rounded(value, down)


def shortened(weight: float, bits: int) -> float:
    mantissa, exponent = math.frexp(weight)
    return math.ldexp(round(mantissa * 2**bits), exponent - bits)


def exact(weights: StepWeights, bits: int) -> Weights:
    """The checker's form of proposed weights."""
    return Weights(
        tuple((_SIDES[c, part], k, F(shortened(w, bits))) for c, part, k, w in weights.rows),
        tuple((i, j, F(p), F(q), F(shortened(w, bits))) for i, j, p, q, w in weights.products),
        tuple((i, F(t), F(shortened(w, bits))) for i, t, w in weights.tangents),
    )


def encoded(weights: Weights) -> dict[str, Any]:
    """The JSON of weights."""
    return {
        "rows": [[side, k, number(w)] for side, k, w in weights.rows],
        "products": [[i, j, int(p), int(q), number(w)] for i, j, p, q, w in weights.products],
        "tangents": [[i, number(t), number(w)] for i, t, w in weights.tangents],
    }


def number(value: F | float) -> str:
    """`float.hex` without needless zeros."""
    text = float(value).hex()
    mantissa, exponent = text.split("p")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}p{exponent}"


@dataclass
class Certifying:
    """A contractor whose every bound is proved in exact arithmetic; `record` is what it did last."""

    inner: Contractor
    measurement: Callable[[int], Measurement]
    record: dict[str, Any] | None = None
    idempotent: bool = False
    _known: dict[int, Measurement] = field(default_factory=dict)

    def contract(self, box: Box) -> Contraction:
        proposed = self.inner.contract(box)
        bounder = Bounder(self._measurements(proposed), ExactBox(_fractions(box.lo), _fractions(box.hi)))
        cap = number(float(box.hi[-1]))
        lo, hi, bounds = box.lo.copy(), box.hi.copy(), []
        for step in proposed.steps:
            if step.weights is None:
                continue
            if step.variable is None:
                for bits in _BITS:
                    weights = exact(step.weights, bits)
                    if bounder.excludes(weights):
                        self.record = {"cap": cap, "weights": encoded(weights)}
                        return Contraction(Box.empty(box.names), proposed.steps, None, proposed.programs)
                continue
            i = box.index(step.variable)
            weights, bound = _bound(bounder, i, step, _LOSS * _width(proposed.box, i))
            if (step.side == "lo" and bound > lo[i]) or (step.side == "hi" and bound < hi[i]):
                (lo if step.side == "lo" else hi)[i] = bound
                bounds.append([i, step.side, number(bound), encoded(weights)])
        self.record = {"cap": cap, "bounds": bounds}
        return Contraction(box.with_bounds(lo, hi), proposed.steps, proposed.point, proposed.programs)

    def _measurements(self, proposed: Contraction) -> dict[int, Measurement]:
        used = {k for step in proposed.steps if step.weights for _, _, k, _ in step.weights.rows}
        for k in used - set(self._known):
            self._known[k] = self.measurement(k)
        return self._known


def _width(box: Box, i: int) -> float:
    return 0.0 if box.is_empty else float(box.hi[i] - box.lo[i])


def _bound(bounder: Bounder, i: int, step: Step, loss: float) -> tuple[Weights, float]:
    """The shortest weights, and the bound on unknown i that they prove, that lose little of what was proposed."""
    assert step.weights is not None
    for bits in _BITS:
        weights = exact(step.weights, bits)
        proved = bounder.improved(i, step.side, weights)
        if abs(proved - F(step.bound)) <= F(loss):
            break
    return weights, brief(proved, step.side == "lo", loss)


def _fractions(values: np.ndarray[Any, Any]) -> tuple[F, ...]:
    return tuple(F(float(v)) for v in values)


def line(value: dict[str, Any]) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n"
