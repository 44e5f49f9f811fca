"""What is proved to exist: whole boxes of solutions, and boxes that hold exactly one.

NaN, here and wherever something is proved. The bounds of the empty interval are NaN, which the interval operations make
of operands without a common point of definition, and of nothing else: a lower bound is never +inf nor an upper one
-inf, so that no sum is inf - inf. So a contractor may drop a box whose bounds are NaN. Numbers beside that, such as
coefficients that overflow, can be NaN for no good reason. Nothing is proved by them: every comparison is written so
that it is true only of numbers (`x <= 0.0`, never `not x > 0.0`), an extreme of several is taken after NaN has become
the infinity that proves nothing (`upper_ends`), because `max(-inf, nan)` is -inf, and a bound that does not exist is no
row at all (`sides`).
"""

from cpcal.solver.existence.unique import Inside, prove_unique

__all__ = ["Inside", "prove_unique"]
