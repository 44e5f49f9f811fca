"""What the harness wants of a method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

from benchmarks.problems import Leg, PosedProblem
from benchmarks.records import MethodAnswer
from benchmarks.tasks import Task, Unsupported

Work = Callable[[], MethodAnswer]
HULL_GAP = 0.01  # mm, within which each bound of a hull is wanted


@dataclass(frozen=True)
class TaskQuestion:
    """`eps` (mm) is the tolerance that a task is about, where it is about one; `limit` is in seconds."""

    problem: PosedProblem
    task: Task
    eps: float | None
    limit: float

    @property
    def leg(self) -> Leg:
        """The problem as a leg with exact readings. Raises Unsupported."""
        if not isinstance(self.problem, Leg) or self.problem.uncertain:
            raise Unsupported("is written for legs with exact readings only")
        return self.problem

    @property
    def tolerance(self) -> float:
        if self.eps is None:
            raise Unsupported("needs to be told a tolerance")
        return self.eps


class Method(Protocol):
    """`guarantee` says in a few words what its answers are worth."""

    guarantee: str

    def missing(self) -> str | None:
        """Why it cannot run here, or None."""
        ...

    def prepare(self, question: TaskQuestion) -> Work:
        """Read what the problem says; the task itself is the returned function, which is timed. Raises Unsupported."""
        ...


def not_installed(package: str) -> str | None:
    return None if find_spec(package) else f"the package {package} is not installed (extra `peers`)"
