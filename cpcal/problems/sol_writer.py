"""AMPL's .sol files: the answer to a .nl file, as AMPL, JuMP and Pyomo read it."""

from __future__ import annotations

from cpcal.problems.answer import Answer
from cpcal.solver.contract import Verdict

SOLVED, UNCERTAIN, INFEASIBLE, LIMIT = 0, 100, 200, 400  # of the solve_result codes
_CODES = {
    Verdict.PROVED: SOLVED,
    Verdict.NOT_CERTIFIED: UNCERTAIN,
    Verdict.REFUTED: INFEASIBLE,
    Verdict.UNKNOWN: LIMIT,
}


def sol_bytes(answer: Answer, rows: int) -> bytes:
    """The text; the point is the best proved one, or the middle of the first box. `rows`: constraints of the .nl."""
    values = _point(answer)
    lines = [f"cpcal: {answer.status}".replace("\n", " "), "", "Options", "3", "1", "1", "0"]
    lines += [str(rows), "0", str(len(answer.problem.network.names)), str(len(values))]
    lines += [repr(value) for value in values]
    return ("\n".join([*lines, f"objno 0 {_CODES[answer.verdict]}"]) + "\n").encode()


def _point(answer: Answer) -> list[float]:
    if answer.point is not None:
        return list(answer.point.values())
    if answer.paving is not None and answer.paving.solutions:
        return [float(v) for v in answer.paving.solutions[0].box.mid[: len(answer.problem.network.names)]]
    return []
