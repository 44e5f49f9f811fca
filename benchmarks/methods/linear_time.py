"""How long the linear programs take."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from cpcal.solver.linear import Dense
from cpcal.solver.linear.engine import LinearSolution


class LinearTime:
    """Adds up the time that linear programs take, while it is entered as a context."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._original: Callable[..., LinearSolution] = Dense.minimize

    @property
    def figures(self) -> dict[str, float]:
        return {"linear": self.seconds}

    def __enter__(self) -> LinearTime:
        def timed(engine: Dense, objective: Any) -> LinearSolution:
            began = time.perf_counter()
            try:
                return self._original(engine, objective)
            finally:
                self.seconds += time.perf_counter() - began

        Dense.minimize = timed  # type: ignore[method-assign,assignment]
        return self

    def __exit__(self, *_: object) -> None:
        Dense.minimize = self._original  # type: ignore[method-assign]
