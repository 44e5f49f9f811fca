"""Named lists of what to run: (problem, task, methods) in order, with a limit and a number of repetitions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from benchmarks.problems import CABLES

MINIMISE = "minimise-1e-06"
REFERENCE = "lifted"  # brackets eps* where a task needs to know it, and proves the points that peers are held to
PAPER = ("refute-0.5", "refute-0.9", "hull-1.1", "minimise-0.001", MINIMISE)
OURS = ("lifted", "hc4,lifted")
ABLATION = ("hc4", "krawczyk", "hc4,krawczyk", "hc4,beaumont", "hc4,krawczyk,beaumont", "hc4,shaving", *OURS)
SWEEPS = ("hc4", "codac", "codac-fwdbwd")
SIZES = (64, 704, 7744)

Entry = tuple[str, str, tuple[str, ...]]


@dataclass(frozen=True)
class Suite:
    """`limit` in seconds for each run."""

    name: str
    purpose: str
    limit: float
    repeat: int
    entries: tuple[Entry, ...]


def leg(number: int = 1, error: float = 1, count: int = 64, delta: float = 100, uncertain: bool = False) -> str:
    """The name of a problem."""
    return f"leg{number}-e{error:g}-n{count}-d{delta:g}{'-u' if uncertain else ''}"


def _quick() -> tuple[Entry, ...]:
    boxes = [leg(delta=delta) for delta in (1, 10, 100, 1000)]
    others = [leg(error=0), leg(error=10), leg(5, error=10), leg(count=704), leg(count=7744)]
    questions = [(leg(), task, OURS) for task in ("refute-0.5", "refute-0.9", "hull-1.1")]
    whole = [(leg(), task, ("lifted",)) for task in ("certify-1e-06", "prove-1e-06")]
    return (*((name, MINIMISE, OURS) for name in boxes + others), *questions, *whole)


def _peers() -> tuple[Entry, ...]:
    tasks = (MINIMISE, "refute-0.9", "refute-0.5", "hull-1.1")
    methods = (*OURS, "gurobi", "scip", "codac", "least-squares")
    names = (leg(), leg(5, error=10))
    asked = tuple((name, task, methods) for name in names for task in tasks)
    return (
        *asked,
        *((name, "prove-1e-06", ("lifted",)) for name in names),
    )  # cpcal alone: its proof written and checked


def _scaling() -> tuple[Entry, ...]:
    methods = (*OURS, "gurobi", "scip", "least-squares")
    return tuple((leg(error=e, count=n), MINIMISE, methods) for e, n in product((0, 1, 10), SIZES))


def _legs(task: str) -> list[Entry]:
    cases = product((False, True), SIZES, (1, 5))
    return [(leg(k, count=n, uncertain=uncertain), task, ("lifted",)) for uncertain, n, k in cases]


def _micro() -> tuple[Entry, ...]:
    small = [(leg(), f"sweep-{count}", SWEEPS) for count in (1, 10, 100, 1000)]
    return (*small, (leg(count=7744), "sweep-1", SWEEPS), (leg(count=7744), "sweep-10", SWEEPS))


def _ablation() -> tuple[Entry, ...]:
    return tuple((leg(delta=delta), task, ABLATION) for delta, task in product((1, 10, 100), PAPER))


_CABLES = tuple((name, MINIMISE, ("lifted",)) for name in CABLES)

SUITES = {
    suite.name: suite
    for suite in (
        Suite("quick", "cpcal on every kind of problem, in minutes", 60.0, 3, _quick()),
        Suite("ablation", "what each contractor adds, from boxes of three sizes", 60.0, 1, _ablation()),
        Suite("peers", "four tasks on everything that can be asked", 60.0, 3, _peers()),
        Suite("scaling", "64 to 7,744 measurements, joint errors of 0 to 10 mm", 120.0, 3, _scaling()),
        Suite(
            "spine",
            "the main job: legs, readings exact and uncertain; cables",
            120.0,
            3,
            (*_legs("certify-1e-06"), *_CABLES),
        ),
        Suite("proofs", "certificates written and checked", 300.0, 1, tuple(_legs("prove-1e-06"))),
        Suite("micro", "one sweep over every equation, boxes alone and in batches", 120.0, 3, _micro()),
    )
}
