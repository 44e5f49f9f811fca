"""Soundness sweep of the interval kernels against arb: `python -m benchmarks.kernel_soundness --pairs 10000000`.

Random operand pairs of all magnitudes, signs and special bounds; for each kernel the bounds must enclose arb's value
(of 200 bits) of the operation at random points of the operands. Pairs at whose points the operation has no finite value
that arb can form are not compared, and counted apart. Exits with status 1 and names the operands where bounds miss one.
"""

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from flint import arb, ctx

from benchmarks import run_by_hand
from cpcal.common.values import Floats
from cpcal.solver.interval import functions, kernels

Kernel = tuple[Callable[..., Any], Callable[..., arb], int]

_NAMES = "exp log sin cos tan asin atan".split()  # noqa: SIM905

# kernel on bounds, the same on points in arb (nan where it is not defined), number of operands
KERNELS: dict[str, Kernel] = {
    "add": (kernels.add, lambda x, y: x + y, 2),
    "sub": (kernels.sub, lambda x, y: x - y, 2),
    "mul": (kernels.mul, lambda x, y: x * y, 2),
    "div": (kernels.div, lambda x, y: x / y, 2),
    "smaller": (kernels.smaller, min, 2),
    "larger": (kernels.larger, max, 2),
    "sqr": (kernels.sqr, lambda x: x * x, 1),
    "sqrt": (kernels.sqrt, lambda x: x.sqrt(), 1),
    "absolute": (kernels.absolute, abs, 1),
    "power 3": (lambda x: kernels.power(x, 3), lambda x: x**3, 1),
    "power -2": (lambda x: kernels.power(x, -2), lambda x: 1 / (x * x), 1),
    "root 5": (lambda x: kernels.root(x, 5), lambda x: abs(x).root(5) * (1 if x >= 0 else -1), 1),
    "root 4": (lambda x: kernels.root(x, 4), lambda x: x.root(4) if x >= 0 else arb("nan"), 1),
    **{name: (getattr(functions, name), lambda x, name=name: getattr(x, name)(), 1) for name in _NAMES},
    "atan2": (functions.atan2, lambda y, x: arb.atan2(y, x) if x != 0 or y != 0 else arb("nan"), 2),
}

_SPECIAL = np.array([0.0, 1.0, -1.0, 5e-324, 2.2250738585072014e-308, 1e-160, 1e160, 1.7976931348623157e308, 2.0**-53])


def operands(rng: np.random.Generator, count: int) -> tuple[Floats, Floats, Floats]:
    """Bounds (count,) and a point of each: all magnitudes, points, special numbers, half lines."""
    spread = rng.choice([1.0, 5.0, 300.0], count)
    x = rng.choice([-1.0, 1.0], count) * 10.0 ** (spread * rng.uniform(-1.0, 1.0, count))
    x = np.where(rng.random(count) < 0.1, rng.choice(_SPECIAL, count) * rng.choice([-1.0, 1.0], count), x)
    with np.errstate(over="ignore"):
        room = np.where(rng.random((2, count)) < 0.5, 0.0, np.abs(x) * 10.0 ** rng.uniform(-17, 2, (2, count)))
        lo, hi = x - room[0], x + room[1]
    lo = np.where(rng.random(count) < 0.02, -np.inf, np.minimum(lo, x))
    hi = np.where(rng.random(count) < 0.02, np.inf, np.maximum(hi, x))
    return lo, hi, x


def swept(name: str, pairs: int, seed: int) -> tuple[int, str | None]:
    """Random operands of a kernel, compared with arb until one is wrong: how many were compared, and which is wrong."""
    kernel, exact, arity = KERNELS[name]
    rng = np.random.default_rng(seed)
    given, compared = [operands(rng, pairs) for _ in range(arity)], 0
    with ctx.workprec(200):
        for k in range(pairs):
            bounds = [(float(lo[k]), float(hi[k])) for lo, hi, _ in given]
            points = [float(x[k]) for _, _, x in given]
            if name == "exp" and abs(points[0]) > 1e4:
                continue  # arb's own exponents would overflow
            low, high = kernel(*bounds)
            value = exact(*map(arb, points))
            if not value.is_finite():
                continue
            compared += 1
            if math.isnan(low) or arb(low) > value.upper() or arb(high) < value.lower():
                return compared, f"{name}: {bounds} at {points} gives [{low!r}, {high!r}] without {value}"
    return compared, None


def main(pairs: int = 10_000, seed: int = 0) -> None:
    """`pairs` of operands for each kernel (nightly: 10000000)."""
    wrong = False
    for name in KERNELS:
        compared, found = swept(name, pairs, seed)
        wrong |= found is not None
        print(found or f"{name}: {pairs} operand pairs, {compared} with a value, all enclosed", flush=True)
    sys.exit(wrong)


if __name__ == "__main__":
    run_by_hand(main)
