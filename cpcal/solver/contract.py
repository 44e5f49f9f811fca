"""Every contract of a plug-in, on one page. Imports nothing of cpcal at run time.

How to write a contractor: a class whose constructor has the signature of `ContractorFactory`, with a method
`contract(box, deadline) -> Contraction`. Derive it from `Composable` for the operators and the declarations' defaults,
or write the declarations that `Contractor` lists; nothing else is asked of it. Name it under the entry-point group
`cpcal.contractors`. `cpcal.solver.testing.check_contractor` tests all that is promised here.

Contractors compose, whoever wrote them: `Then(a, b)` or `a >> b` is a, then b; `Union(a, b)` or `a | b` is the hull of
what either leaves; `Repeat(a, ratio)` is a again and again while some width shrinks below `ratio` times what it was.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from cpcal.common.values import Floats, Indices
    from cpcal.solver.interval import Box, IntervalArray
    from cpcal.solver.network import ConstraintNetwork


Row = tuple[int, int]  # constraint, element


class Verdict(Enum):
    """What is known of a statement. `UNKNOWN` is never reported as a proof.

    `NOT_CERTIFIED`: found with proof, but the certificate that was asked for does not hold it.
    """

    PROVED = "proved"
    REFUTED = "refuted"
    UNKNOWN = "unknown"
    NOT_CERTIFIED = "not certified"


@dataclass(frozen=True)
class StepWeights:
    """The multipliers that carry a step, for whoever proves it again: on the box that was contracted.

    `rows`: (constraint, part, element, weight), parts being the polynomial rows of one constraint in order;
    `products`: (variable i, variable j, p, q, weight) of the bound product (1 + p u_i)(1 + q u_j) in the box's
    coordinates u; `tangents`: (i, t, weight) of (u_i - t)^2. None of it need be trusted.
    """

    rows: tuple[tuple[int, int, int, float], ...]
    products: tuple[tuple[int, int, float, float, float], ...]
    tangents: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True)
class Step:
    """One proved removal: no solution of the network lies in `box` outside of what is left.

    `variable` is the component whose bound on `side` ("lo" or "hi") moved to `bound`, or None when the
    whole box was proved empty. `rows` are the (constraint, measurement) pairs that carry the proof.
    """

    contractor: str
    variable: str | None
    side: str
    bound: float
    rows: tuple[Row, ...] = ()
    weights: StepWeights | None = None


@dataclass(frozen=True)
class Contraction:
    """What a contractor made of a box: a subset that holds all its solutions, and why.

    `point` is a promising point of the new box (one value per component), proposed without proof.
    """

    box: Box
    steps: tuple[Step, ...] = ()
    point: Floats | None = None
    programs: int = 0  # linear programs solved on the way


class Contractor(Protocol):
    """Removes from a box points that are no solutions, never a solution. Remembers nothing between calls; pickles.

    A long contraction ends at the `deadline` (of time.monotonic()), with what it has proved. What it can do is
    declared; what is not declared counts as the default, in brackets:

    gives_weights       its steps carry `StepWeights`, so that they can be written into a certificate (False)
    """

    gives_weights: bool

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction: ...


Named = tuple[str, Contractor]  # what it is called in results


@runtime_checkable
class SupportFunction(Protocol):
    """What a contractor may offer besides: half-spaces that hold all solutions in a box."""

    def support_function(self, box: Box, directions: Floats) -> Floats:
        """Proved upper bounds (m,) of `directions @ x` over the solutions x in `box`; `directions` is (m, n).

        -inf for all when the box is proved to hold no solution.
        """
        ...


@runtime_checkable
class TakesBatches(Protocol):
    """What a contractor may offer besides: many boxes at a time, which `solve` decides together then."""

    def contract_batch(self, boxes: IntervalArray, deadline: float = math.inf) -> IntervalArray:
        """Bounds (B, n) in and out, NaN where a box holds no solution."""
        ...


@runtime_checkable
class TakesParts(Protocol):
    """What a contractor may offer besides: the same for fewer measurements, without all that is made of a network."""

    def among(self, network: ConstraintNetwork, elements: Indices) -> Contractor:
        """For `network`: some elements (ascending) of each constraint, all of one axis. Steps need not be told."""
        ...


class ContractorFactory(Protocol):
    """What an entry point of the group `cpcal.contractors` names: usually the contractor's class.

    `objective`: the variable to be minimised, whose lower bound matters most.
    """

    def __call__(self, network: ConstraintNetwork, *, objective: str | None) -> Contractor: ...


def contracted(contractor: Contractor, box: Box, deadline: float = math.inf) -> Contraction:
    """What a contractor makes of a box. Raises PluginError where that is no `Contraction` of this box."""
    found = contractor.contract(box, deadline)
    if not isinstance(found, Contraction) or getattr(found.box, "names", None) != box.names:
        from cpcal.common.errors import PluginError

        raise PluginError(
            f"contract(box) of the contractor {type(contractor).__name__} returned {found!r}: it returns a Contraction "
            "whose box is a part of the given one"
        )
    return found


def narrowed(name: str, box: Box, after: Box) -> Contraction:
    """`after` as what the contractor of that name leaves of a box, without the rows that moved each bound."""
    if after.is_empty:
        return Contraction(after, () if box.is_empty else (Step(name, None, "", math.nan),))
    sides = (("lo", after.lo, after.lo > box.lo), ("hi", after.hi, after.hi < box.hi))
    return Contraction(
        after,
        tuple(Step(name, box.names[k], side, float(to[k])) for side, to, moved in sides for k in moved.nonzero()[0]),
    )


class Composable:
    """Base class of contractors: the declarations' defaults, and the operators `>>` and `|` with any contractor."""

    gives_weights: bool = False

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        raise NotImplementedError

    def __rshift__(self, other: Contractor) -> Then:
        return Then(self, other)

    def __rrshift__(self, other: Contractor) -> Then:
        return Then(other, self)

    def __or__(self, other: Contractor) -> Union:
        return Union(self, other)

    def __ror__(self, other: Contractor) -> Union:
        return Union(other, self)


class Then(Composable):
    """One after the other, each on what the one before has left: solutions of all."""

    def __init__(self, *parts: Contractor) -> None:
        self.parts = parts

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        total = Contraction(box)
        for part in self.parts:
            total = followed(total, contracted(part, total.box, deadline))
            if total.box.is_empty:
                break
        return total


@dataclass(eq=False)
class Union(Composable):
    """Hull of what either leaves: solutions of one or the other. Its steps prove nothing alone: none."""

    first: Contractor
    second: Contractor

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        one, two = (contracted(part, box, deadline) for part in (self.first, self.second))
        programs = one.programs + two.programs
        return Contraction(one.box.hull(two.box), (), one.point if one.point is not None else two.point, programs)


class Repeat(Composable):
    """`inner` again and again, at most `most` times, while some width shrinks below `ratio` times what it was."""

    def __init__(self, inner: Contractor, ratio: float = 0.9, most: int = 100) -> None:
        if not 0.0 < ratio <= 1.0:
            raise ValueError(f"ratio is in (0, 1], not {ratio}")
        self.inner, self._ratio, self._most = inner, ratio, most

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        once = partial(contracted, self.inner, deadline=deadline)
        return repeated(once, box, ratio=self._ratio, most=self._most)


def elements(contractor: Contractor) -> tuple[Contractor, ...]:
    """What a composition applies in sequence, from the inside: weights are given by elements, not by compositions."""
    if isinstance(contractor, Repeat):
        return elements(contractor.inner)
    if not isinstance(contractor, Then):
        return (contractor,)
    return tuple(e for part in contractor.parts for e in elements(part))


def givers(contractor: Contractor) -> list[Contractor]:
    """The elements that declare to give weights."""
    return [element for element in elements(contractor) if getattr(element, "gives_weights", False)]


def followed(one: Contraction, two: Contraction) -> Contraction:
    """Two contractions in sequence as one: what holds in the second's box holds for all solutions in the first's."""
    return Contraction(
        box=two.box,
        steps=one.steps + two.steps,
        point=two.point if two.point is not None else one.point,
        programs=one.programs + two.programs,
    )


def shrunk(before: Floats, after: Floats, ratio: float) -> bool:
    """Whether some width fell below `ratio` times what it was (an infinite one: is finite now)."""
    return bool((after < ratio * before).any())


def repeated(
    step: Callable[[Box], Contraction],
    box: Box,
    *,
    ratio: float,
    most: int,
    pays: Callable[[Floats, Floats, float], bool] = shrunk,
) -> Contraction:
    """`step` on its own result, at most `most` times, while it `pays`: all steps as one contraction."""
    total = Contraction(box)
    for _ in range(most):
        before = total.box.width
        total = followed(total, step(total.box))
        if total.box.is_empty or not pays(before, total.box.width, ratio):
            break
    return total


class Strategy(Protocol):
    """Chooses how to divide a box: a cover of it, or () when it is fine enough to be kept."""

    def split(self, box: Box) -> tuple[Box, ...]: ...


class StrategyFactory(Protocol):
    """What an entry point of the group `cpcal.strategies` names: usually the strategy's class."""

    def __call__(self, network: ConstraintNetwork, width: float) -> Strategy: ...


# ------------------------------------------------------------------------------------------------------------------
# Where a search stops at the latest, and the clock that says when.


@dataclass(frozen=True)
class Limits:
    """Where a search stops at the latest, with what it has proved so far."""

    seconds: float | None = None
    nodes: int | None = None
    gap: float = 1e-6  # relative, of a bracket
    gap_absolute: float = 1e-9  # in the objective's unit

    def clock(self) -> Clock:
        """A clock that starts now."""
        return Clock(self, math.inf if self.seconds is None else time.monotonic() + self.seconds)


@dataclass(frozen=True)
class Clock:
    """Limits that began to count at some moment."""

    limits: Limits
    deadline: float

    def over(self, nodes: int = 0) -> bool:
        """Whether the time or the nodes are used up."""
        too_many = self.limits.nodes is not None and nodes >= self.limits.nodes
        return too_many or time.monotonic() > self.deadline
