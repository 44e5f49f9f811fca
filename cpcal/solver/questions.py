"""What the verbs on a network are asked with, checked and put in the solver's own terms. Raises ModelError."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import ModelError
from cpcal.common.numbers import stated
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, Strategy, until
from cpcal.solver.existence import Equalities
from cpcal.solver.interval import Box
from cpcal.solver.interval.number import float_bounds
from cpcal.solver.limits import Clock, Limits
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, evaluate
from cpcal.solver.network.expression import as_expr
from cpcal.solver.network.forms import check_powers
from cpcal.solver.search import ORDERS, STRATEGIES, Contracting, Priority, WholeNumbers

FINE_WIDTH = 1e-6  # of the boxes about single points
REACH = 100.0  # from 0, of boxes that are divided where solutions may run to infinity and nobody asks for a width
_BOXES = 256  # about as many make up the set of solutions, or some times as many
_DIVISIONS = 1000.0
_WHOLE = 0.5  # so that boxes of whole numbers are points

N = TypeVar("N", bound=ConstraintNetwork)


def relaxed(network: N, relax: float) -> N:
    """Equations between the same bounds, wider by `relax` on both sides."""
    if not _is_number(relax) or not 0.0 <= relax < np.inf:
        raise ModelError(f"relax={relax!r} is no tolerance: give a number of at least 0")
    if not relax:
        return network
    out = copy(network)
    low, high = as_expr(-float(relax)), as_expr(float(relax))
    out._constraints = [
        Constraint(c.body - c.lower, low, high) if c.lower.digest == c.upper.digest else c for c in network.constraints
    ]
    return out


def with_objective(network: N, objective: Expr) -> tuple[N, str]:
    """A network of whose components the objective is one, and the component's name."""
    if not isinstance(objective, Expr) or objective.shape != () or objective.op in ("variable", "index"):
        return network, network.component(objective)
    network.check_owner(objective)
    check_powers(network, [objective])
    bounds = evaluate(network, objective, network.domain)
    name = "objective"
    while any(leaf.name == name for leaf in network.variables):
        name += "_"
    nowhere = bool(bounds.empty)  # it has a value: then no point satisfies the row below
    bound = network.variable(name, domain=(0.0, 0.0) if nowhere else (float(bounds.lo), float(bounds.hi)))
    network.add(objective <= bound)
    return network, name


def default_width(network: ConstraintNetwork, left: Callable[[], Box]) -> tuple[float, Floats]:
    """1e-6 where solutions are single points; else what cuts `left`, which holds them, into some hundred boxes or more.

    Solutions that leave `freedom` of the unknowns open form a set of that dimension: each of its directions gets its
    share of the boxes. Widths count in `small_units`. And how far from 0 each component (n,) is divided: where `left`
    is unbounded, up to `REACH`.
    """
    free, equations = network.domain.hi > network.domain.lo, Equalities.of(network)
    freedom = int(free.sum()) - (0 if equations.reads else equations.count)
    everywhere = np.full(len(free), np.inf)
    if freedom <= 0:
        return FINE_WIDTH, everywhere
    widths = left().width
    reach = np.where(np.isinf(widths), REACH, np.inf)
    widest = float(np.max(np.minimum(widths, 2.0 * reach) / small_units(network), where=free, initial=0.0))
    if not widest > 0.0:
        return FINE_WIDTH, everywhere
    width: float = min(widest * _BOXES ** (-1.0 / freedom), _WHOLE if network.whole.any() else np.inf)
    width = max(width, 5e-324)  # of a domain next to the least float it is zero
    return round(width, -math.floor(math.log10(width))), reach  # one digit


def small_units(network: ConstraintNetwork) -> Floats:
    """The unit of each component (n,): 1, or smaller where the whole domain is hardly wider than boxes about points.

    So that a domain of a nanometre is divided, too: a thousand times at least.
    """
    widths = network.domain.width
    small = (widths > 0.0) & (widths < _DIVISIONS * FINE_WIDTH)
    return np.where(small, widths / (_DIVISIONS * FINE_WIDTH), 1.0)


def width_sentence(width: float, reach: Floats) -> str:
    """What `default_width` chose, to follow a sentence; empty for the width of single points."""
    if width == FINE_WIDTH:
        return ""
    shape, chosen = "Solutions form curves or regions", f"width {stated(width)} was chosen"
    said = f" {shape}: {chosen}, width=... asks for another."
    if np.isfinite(reach).any():
        said += f" They may run to infinity: further than {stated(REACH)} from 0 boxes are not divided."
    return said


def checked_width(width: float) -> float:
    """A width that some box can have. Raises ModelError."""
    if not _is_number(width) or not width > 0:
        raise ModelError(f"width={width!r} is no width: give a positive number, below which boxes are not divided")
    return float(width)


def checked_limits(limits: Limits | None, **named: float | None) -> Limits:
    """Limits that a search can reach, those `named` among them (fields of `Limits`). Raises ModelError."""
    given_by_name = {field: value for field, value in named.items() if value is not None}
    if limits is None:
        limits = Limits()
    elif not isinstance(limits, Limits):
        raise ModelError(f"limits={limits!r} sets no limit: write cpcal.Limits(seconds=...) or cpcal.Limits(nodes=...)")
    elif given_by_name:
        raise ModelError("limits are given by limits=cpcal.Limits(...) or by their names, not both")
    limits = replace(limits, **given_by_name)  # type: ignore[arg-type]  # checked here
    given = (limits.seconds, limits.nodes, limits.gap, limits.gap_absolute)
    if not all(value is None or (_is_number(value) and value >= 0) for value in given):
        raise ModelError(f"{limits!r}: seconds, nodes and gaps are numbers of at least 0")
    return limits


def remaining(clock: Clock, before: int = 0) -> Limits:
    """The limits of a clock with the seconds that are left, for a search that counts nodes `before` this call, too."""
    given = clock.limits
    left = None if given.seconds is None else max(0.0, clock.deadline - time.monotonic())
    return replace(given, seconds=left, nodes=None if given.nodes is None else given.nodes + before)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def start_point(network: ConstraintNetwork, start: npt.ArrayLike, count: int) -> npt.NDArray[np.float64]:
    """A point to start from, one finite number for each of the first `count` components. Raises ModelError."""
    point = float_bounds(start)[0]
    if point.shape != (count,) or not np.isfinite(point).all():
        raise ModelError(f"start={start!r} is no point: give {count} finite numbers, in the order of `names`")
    return np.concatenate([point, network.domain.hi[count:]])


def named_strategy(
    network: ConstraintNetwork,
    strategy: str | Strategy,
    width: float,
    reach: Floats,
    unit: Floats | float,
    arithmetic: str,
) -> Strategy:
    if not isinstance(strategy, str):
        if not hasattr(strategy, "split"):
            raise ModelError(f"strategy={strategy!r} divides no box: give a name or an object with split(box)")
        return strategy
    if strategy in STRATEGIES:
        return STRATEGIES[strategy](network, width).within(reach, unit)
    return plugins.load_strategy(strategy, STRATEGIES)(network, width, arithmetic=arithmetic)


def named_order(network: ConstraintNetwork, order: str) -> Priority:
    if order not in ORDERS:
        raise ModelError(f"no order is called {order!r}; there are: {', '.join(ORDERS)}")
    return ORDERS[order](network)


def resolution(
    network: ConstraintNetwork, left: Callable[[], Box], width: float | None
) -> tuple[float, Floats, Floats | float]:
    """Below which width boxes are not divided, how far from 0 they are, and the unit of each component's width."""
    if width is None:
        return *default_width(network, left), small_units(network)
    return checked_width(width), np.full(len(network.names), np.inf), 1.0


def check_weights(named: list[tuple[str, Contractor]]) -> None:
    """Raises ModelError where no certificate could come of it."""
    if not Contracting(named).gives_weights:
        given = ", ".join(called for called, _ in named)
        raise ModelError(f"{given} give no weights: no certificate can be written; use lifted")


def named_contractors(
    network: ConstraintNetwork,
    stated: ConstraintNetwork,
    objective: str,
    contractors: Sequence[str | Contractor],
    arithmetic: str,
    deadline: float,
    *,
    exact: bool,
) -> list[tuple[str, Contractor]]:
    """The contractors of a minimisation, of the rows of `stated`, by their names. Raises ModelError."""
    parts = plugins.build_each(stated, contractors, objective=objective, arithmetic=arithmetic)
    for part in parts:
        until(part, deadline)
    named = list(zip(map(plugins.name_of, contractors), parts, strict=True))
    if network.whole.any() and exact:
        raise ModelError("whole numbers are rounded, which no certificate says: leave the certificate out")
    if network.whole.any():
        named.append(("whole numbers", WholeNumbers(network.whole)))
    if exact:
        check_weights(named)
    return named
