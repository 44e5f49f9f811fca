"""No engine's multipliers ever prove what is not true, whatever the program: against exact rational arithmetic."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cpcal.solver.linear import Dense
from tests.solver.exact_programs import KINDS, Highs, contradictions, main, program

COUNT = 35


@pytest.mark.parametrize("solver", [Dense, Highs])
@pytest.mark.parametrize("kind", KINDS)
def test_no_bound_is_contradicted_and_nearly_every_program_is_solved(solver: type[Dense], kind: str) -> None:
    outcomes = [contradictions(seed, solver) for seed in range(KINDS.index(kind), COUNT, len(KINDS))]
    assert [line for lines, _ in outcomes for line in lines] == []
    failed = sum(count for _, count in outcomes)
    allowed = 0.2 if kind == "badly scaled" else 0.02  # of programs that nobody has scaled
    assert failed <= allowed * 4 * len(outcomes)


@pytest.mark.nightly
def test_no_bound_of_three_thousand_programs_is_contradicted() -> None:
    assert main(3000) == 0


def test_the_kernel_ends_in_its_bounded_number_of_pivots_without_help(monkeypatch: pytest.MonkeyPatch) -> None:
    """HiGHS, which takes over where it gives up, is never asked."""

    def asked(*_: object) -> None:
        raise AssertionError("HiGHS was asked")

    monkeypatch.setattr(Dense, "_by_highs", asked)
    for seed in range(COUNT):
        case = program(seed)
        if case.kind != "badly scaled":
            engine = Dense()
            engine.load(case.matrix, case.rhs, case.lower, case.upper)
            for objective in case.objectives:
                engine.minimize(objective)


def test_in_plain_python_the_kernel_finds_the_same_to_the_last_bit() -> None:
    """One source: a fresh interpreter with NUMBA_DISABLE_JIT=1, the same programs."""
    code = "from tests.solver.test_exact_programs import digits; print(digits(28))"
    root = Path(__file__).parents[3]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digits(28)


def digits(count: int) -> str:
    """What the kernel says of the first programs, in full."""
    said = []
    for seed in range(count):
        case = program(seed)
        engine = Dense()
        engine.load(case.matrix, case.rhs, case.lower, case.upper)
        for objective in case.objectives:
            found = engine.minimize(objective)
            said += [found.status.value, *(v.hex() for v in [*found.point.tolist(), *found.multipliers.tolist()])]
    return " ".join(said)
