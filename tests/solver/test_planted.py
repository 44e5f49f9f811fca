"""Random networks with a planted solution, exact to the last bit: no answer loses it, no proof says more than is so.

Every operation of the table, in domains from denormal numbers to 1e300 and beyond all bounds. Bounds of constraints are
the two float64 numbers next to the value at the point (one, where the value is such a number: then it may be an
equation), so that a single missing rounding loses it. What is proved is evaluated again at 400 bits, by arb alone.
"""

import math
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

import cpcal
from cpcal.checker import check
from cpcal.common.errors import ModelError
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.interval.operations import CODES
from cpcal.solver.network.expression import Expr, topological

COUNT = int(os.environ.get("CPCAL_PLANTED", "40"))  # 20,000 at night
SEEDS = (*range(14, 14 + COUNT), 15078)  # the first 40 in a row that have every operation; one that overflowed
PARTS = 2  # of the networks, a test each
BITS = 400
BINARY = {"add", "sub", "mul", "div", "min", "max", "atan2"}
LARGE = 1200  # bits, so that sums of very large and very small numbers are exact, too

# What arb makes of one or two arguments. All of the table but "power", which has its exponent beside it.
_ARB: dict[str, Callable[..., Any]] = {
    "neg": lambda x: -x, "sqr": lambda x: x * x, "abs": abs,
    "add": lambda x, y: x + y, "sub": lambda x, y: x - y, "mul": lambda x, y: x * y, "div": lambda x, y: x / y,
    "min": lambda x, y: x.min(y), "max": lambda x, y: x.max(y), "atan2": lambda y, x: arb.atan2(y, x),
    **{
        op: (lambda name: lambda x: getattr(x, name)())(op)
        for op in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "atan")
    },
}  # fmt: skip


def value(expr: Expr, at: dict[str, Any], bits: int = LARGE) -> Any:
    """A scalar expression at a point, without any of our arithmetic."""
    before, ctx.prec = ctx.prec, bits
    try:
        known: dict[bytes, Any] = {}
        for node in topological((expr,)):
            args = [known[arg.digest] for arg in node.args]
            if node.op == "variable":
                known[node.digest] = at[node.name]
            elif node.op == "constant":
                known[node.digest] = arb(float(node.data.lo))
            elif node.op == "power":
                known[node.digest] = args[0] ** node.parameter if node.parameter else arb(1)
            else:
                known[node.digest] = _ARB[node.op](*args)
        return known[expr.digest]
    finally:
        ctx.prec = before


def bounds(ball: Any) -> tuple[float, float]:
    """The greatest float64 below and the least above; NaN where it is no number."""
    if not ball.is_finite():
        return math.nan, math.nan
    low, high = (_float(ball.lower(), -math.inf), _float(ball.upper(), math.inf))
    return low, high


def _float(exact: Any, toward: float) -> float:
    """An exact number, rounded in one direction."""
    mantissa, exponent = (int(v) for v in exact.man_exp())
    cut = max(abs(mantissa).bit_length() - 64, 0)
    near = _ldexp(mantissa >> cut, exponent + cut)
    while (arb(near) > exact) if toward < 0.0 else (arb(near) < exact):
        near = math.nextafter(near, toward)
    return near


def _ldexp(mantissa: int, exponent: int) -> float:
    try:
        return math.ldexp(mantissa, max(min(exponent, 10**6), -(10**6)))
    except OverflowError:
        return math.copysign(math.inf, mantissa)


def _coordinate(rng: np.random.Generator) -> tuple[tuple[float, float], float]:
    """A domain, and a number in it."""
    few = float(rng.integers(-24, 25)) / 8.0
    huge = float(rng.integers(1, 64)) * 10.0 ** float(rng.integers(0, 299))
    tiny = float(rng.integers(0, 2**20)) * 5e-324
    whole = 2.0**53 + 2.0 * float(rng.integers(-8, 9))
    kind = int(rng.integers(0, 12))
    if kind < 5:
        return (-3.0, 3.0), few if kind < 3 else float(rng.uniform(-3.0, 3.0))
    if kind == 5:
        return (0.0, 1e300), min(huge, 1e300)
    if kind == 6:
        return (-np.inf, np.inf), few if rng.integers(0, 2) else -huge
    if kind == 7:
        return (-1.0, np.inf), abs(few)
    if kind == 8:
        return (0.0, 1e-310), tiny
    if kind == 9:
        return (2.0**53 - 16.0, 2.0**53 + 16.0), whole
    if kind == 10:
        return (-4.0, 4.0), float(rng.integers(-4, 5))
    return (-huge, huge), float(rng.choice([-huge, huge, 0.0, few if abs(few) <= huge else 0.0]))


_SPECIAL = ("power", "mul", "add", "sub", "neg")


def _expression(rng: np.random.Generator, x: list[Expr], at: dict[str, Any], depth: int, *, exact: bool) -> Expr:
    """Random, and defined at the point; `exact`: a polynomial."""
    for _ in range(20 if depth else 0):
        ops = _SPECIAL if exact or rng.integers(0, 2) else tuple(CODES)
        op = str(rng.choice(ops))
        args = [
            _expression(rng, x, at, depth - 1, exact=exact) for _ in range(1 if op == "power" else 1 + (op in BINARY))
        ]
        if op == "power":
            made = args[0] ** int(rng.integers(2, 4) if exact else rng.choice([-2, -1, 0, 2, 3, 4, 5]))
        else:
            made = Expr(op, tuple(args))
        if value(made, at).is_finite():
            return made
    leaf = x[int(rng.integers(0, len(x)))]
    return leaf if rng.integers(0, 4) else float(rng.integers(-8, 9)) / 4.0 * leaf


class Planted:
    """A network, a point of it (n,), an objective, and whether its constraints are polynomials."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 42])
        self.net, self.exact = cpcal.Network(), seed % 3 == 0
        drawn = [_coordinate(rng) for _ in range(int(rng.integers(1, 4)))]
        x = [self.net.variable(f"x{k}", (), domain) for k, (domain, _) in enumerate(drawn)]
        self.point = np.array([value for _, value in drawn])
        self.at = {f"x{k}": arb(value) for k, value in enumerate(self.point.tolist())}
        for _ in range(int(rng.integers(1, 4))):
            self._constrain(rng, _expression(rng, x, self.at, 3, exact=self.exact))
        self.objective = _expression(rng, x, self.at, 2, exact=self.exact)

    def _constrain(self, rng: np.random.Generator, body: Expr) -> None:
        low, high = bounds(value(body, self.at))
        kind = int(rng.integers(0, 3))
        if low == high and kind == 2 and math.isfinite(low):
            constraint = body == low
        else:
            constraint = body.within(((low if kind != 1 else -np.inf), (high if kind != 0 else np.inf)))
        with refused("may be a whole power of a negative number"):
            self.net.add(constraint)

    def violated(self, box: cpcal.Box) -> list[str]:
        """Constraints that no point of a box satisfies, evaluated at 400 bits."""
        at = {name: _ball(box[name].lo, box[name].hi) for name in self.at}
        return [str(c) for c in self.net.constraints if _fails(c, at)]


@contextmanager
def refused(reasons: str) -> Iterator[None]:
    """What may be refused, with its reason: then nothing is proved."""
    try:
        yield
    except ModelError as error:
        if re.search(reasons, str(error)) is None:
            raise


def _ball(lo: float, hi: float) -> Any:
    return arb(lo) if lo == hi else arb(lo).union(arb(hi))


def _fails(constraint: cpcal.Constraint, at: dict[str, Any]) -> bool:
    body = value(constraint.body, at, BITS)
    low, high = (float(e.data.lo) for e in (constraint.lower, constraint.upper))
    return not body.is_nan() and bool(body < arb(low) or body > arb(high))


@pytest.mark.parametrize("part", range(PARTS))
def test_a_planted_solution_is_not_lost_and_nothing_false_is_proved(part: int, tmp_path: Path) -> None:
    for seed in SEEDS[part::PARTS]:
        one = Planted(seed)
        paving = one.net.solve(width=0.5, limits=Limits(nodes=20))
        assert any(one.point in s.box for s in paving.solutions), (seed, paving.status)
        for solution in paving.solutions:
            assert solution.verdict is not Verdict.PROVED or not one.violated(solution.box), (seed, solution)
        _check_minimum(seed, one, tmp_path / "c.jsonl")


def _check_minimum(seed: int, one: Planted, path: Path) -> None:
    """Without a certificate, and with one where the constraints are polynomials."""
    for certificate in (None, path) if one.exact else (None,):
        best: Any = None
        with refused("needs bounded domains|which no certificate says|bounded box|cannot be certified|whole power of"):
            best = one.net.minimize(one.objective, limits=Limits(nodes=1 + seed % 5), certificate=certificate)
        if best is None:
            continue
        attained = value(one.objective, one.at)
        assert not arb(best.lo) > attained, (seed, best.lo, attained)
        assert best.verdict is not Verdict.REFUTED, seed
        if best.witness is not None:
            assert best.lo <= best.hi, seed
            x = best.witness.point
            around = cpcal.Box(best.names, x, x) if best.witness.around is None else best.witness.around
            assert not one.violated(around), (seed, around)
            reached = value(one.objective, {name: _ball(around[name].lo, around[name].hi) for name in one.at}, BITS)
            assert not reached > arb(best.hi), (seed, best.hi, reached)
        if certificate is not None:
            claims = check(path).claims  # accepted by the checker
            assert (claims.point is None) == (best.witness is None or "ot certified" in best.status), seed
            assert claims.point is not None or best.verdict is not Verdict.PROVED, seed


def test_every_operation_of_the_table_is_planted() -> None:
    seen = frozenset[str]().union(*(c.body.ops for seed in SEEDS for c in Planted(seed).net.constraints))
    assert seen >= CODES.keys()
