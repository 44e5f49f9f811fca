"""Everything that can be asked: cpcal by its contractors' names, and peers, each behind a small adapter."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from benchmarks.problems import Leg, PosedProblem
from benchmarks.runs import MethodAnswer, Task, Unsupported

PEERS = {
    "scip": "benchmarks.methods.peers:Scip",
    "gurobi": "benchmarks.methods.peers:Gurobi",
    "least-squares": "benchmarks.methods.peers:LeastSquares",
}
Work = Callable[[], MethodAnswer]


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


class Method(Protocol):
    """`guarantee` says in a few words what its answers are worth."""

    guarantee: str

    def missing(self) -> str | None:
        """Why it cannot run here, or None."""
        ...

    def prepare(self, question: TaskQuestion) -> Work:
        """Read what the problem says; the task itself is the returned function, which is timed. Raises Unsupported."""
        ...


def method(name: str) -> Method:
    """A peer, a `module:Class` of a user, or cpcal with contractors, "hc4,lifted"."""
    if name in PEERS or ":" in name:
        module, _, member = PEERS.get(name, name).partition(":")
        made: Method = getattr(importlib.import_module(module), member)()
        return made
    from benchmarks.methods.ours import Cpcal

    return Cpcal(tuple(name.split(",")))
