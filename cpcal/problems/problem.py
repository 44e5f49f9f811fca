"""Problems in files, and their answers: read a file, solve or minimise, write JSON or AMPL's .sol."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpcal.common.errors import InputError, ModelError, unusable
from cpcal.common.files import StrPath, small_file
from cpcal.common.numbers import at_most, bracket_text
from cpcal.problems.minibex import read_minibex
from cpcal.problems.nl import read_nl
from cpcal.problems.values import StatedProblem
from cpcal.solver.certificate.recording import UncertifiedError
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.optimize.bound import Minimum, Progress
from cpcal.solver.search.paving import Paving
from cpcal.solver.search.search import Event

MOST = 2**26  # bytes
READERS = {".bch": read_minibex, ".mbx": read_minibex, ".nl": read_nl}


def load_problem(path: Path) -> StatedProblem:
    """The problem in a file. Raises InputError that names file and line."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        what = "is neither Minibex (.bch, .mbx) nor AMPL's .nl"
        raise unusable(path, what, "give it the suffix of what it is")
    content = small_file(path, "give a file of a problem", most=MOST)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise unusable(path, "is no UTF-8 text", "save it as UTF-8 text") from None
    return reader(text, str(path))


# ------------------------------------------------------------------------------------------------------------------
# A problem's answer: all solutions, or the best value bracketed; and its JSON (docs/solve.md).

FORMAT = "cpcal-solution/1"
_WORDS = {verdict: verdict.value for verdict in Verdict} | {Verdict.REFUTED: "infeasible"}


@dataclass(frozen=True)
class Answer:
    """paving   all solutions, where there is no objective
    best     lo, hi: the objective's best value lies between; point: where the value nearer to us is attained, or None
    verdict  PROVED: complete, or the bracket closed to the gap; REFUTED: there is no solution; UNKNOWN: a limit came
             first; NOT_CERTIFIED: as PROVED, but the certificate that was asked for does not hold all of it
    pending  boxes that were left
    uncertified  why a certificate that was asked for could not be written
    """

    problem: StatedProblem
    verdict: Verdict
    status: str
    nodes: int
    seconds: float
    pending: int
    paving: Paving | None = None
    best: Minimum | None = None
    uncertified: InputError | None = None

    @property
    def method(self) -> str:
        """Contractors and strategy, and why these; rows that one of them cannot use."""
        found = self.best or self.paving
        if found is None:
            return ""
        unused = "" if found.row_use is None else found.row_use.sentence
        return f"{found.method.rstrip('.')}. {unused[:1].upper()}{unused[1:]}." if unused else found.method

    @property
    def objective(self) -> tuple[float, float] | None:
        """The bracket of the objective as it was asked for: of a maximum the signs are turned."""
        if self.best is None:
            return None
        lo, hi = self.best.lo, self.best.hi
        return (-hi, -lo) if self.problem.maximize else (lo, hi)

    @property
    def point(self) -> dict[str, float] | None:
        """The components of the best point that is proved to be a solution."""
        if self.best is None or self.best.witness is None:
            return None
        return dict(zip(self.problem.network.names, self.best.witness.point.tolist(), strict=False))

    @property
    def points(self) -> list[list[float]]:
        """By variables: the best proved point, or the middles of all boxes, those with a proved solution first."""
        if self.point is not None:
            return [list(self.point.values())]
        boxes = (
            [] if self.paving is None else sorted(self.paving.solutions, key=lambda s: s.verdict is not Verdict.PROVED)
        )
        return [s.box.mid[: len(self.problem.network.names)].tolist() for s in boxes]

    def to_json(self) -> bytes:
        """Bounds that are not finite are null."""
        names = self.problem.network.names
        solutions = [] if self.paving is None else self.paving.solutions
        bracket = self.objective
        document = {
            "format": FORMAT,
            "status": "complete" if self.verdict is not Verdict.UNKNOWN else "limit reached",
            "verdict": _WORDS[self.verdict],
            "sentence": self.status,
            "solutions": [
                {
                    "status": _WORDS[s.verdict],
                    "box": {name: [_number(s.box[name].lo), _number(s.box[name].hi)] for name in names},
                }
                for s in solutions
            ],
            "objective": None
            if bracket is None
            else {"lo": _number(bracket[0]), "hi": _number(bracket[1]), "point": self.point},
            "pending": self.pending,
            "nodes": self.nodes,
            "seconds": round(self.seconds, 3),
            "method": self.method,
            "width": None if self.paving is None else self.paving.width,
        }
        return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def answer(
    problem: StatedProblem,
    *,
    width: float | None = None,
    limits: Limits | None = None,
    certificate: StrPath | None = None,
    searched: Callable[[Event], None] | None = None,
    bracketed: Progress = None,
    **kept: Any,
) -> Answer:
    """Solve, or minimise, the problem; further options are those of `Network.solve` and `Network.minimize`.

    `searched` is told of every box of a search, `bracketed` of every bracket of a minimisation.

    Raises ModelError for what the solver cannot take, InputError for a checkpoint of other things.
    """
    start, network = time.monotonic(), problem.network
    if problem.objective is None:
        if certificate is not None:
            raise ModelError("a certificate is written of a minimisation: this problem has no objective")
        found = network.solve(width=width, limits=limits, progress=searched, **kept)
        unknown = sum(s.verdict is Verdict.UNKNOWN for s in found.solutions)
        verdict = Verdict.UNKNOWN if not found.complete else Verdict.PROVED if found.solutions else Verdict.REFUTED
        pending = 0 if found.complete else unknown
        return Answer(problem, verdict, found.status, found.nodes, time.monotonic() - start, pending, paving=found)
    objective = -problem.objective if problem.maximize else problem.objective
    why: InputError | None = None
    try:
        best = network.minimize(objective, limits=limits, certificate=certificate, progress=bracketed, **kept)
    except UncertifiedError as error:
        best, why = error.answer, error
    return Answer(
        problem,
        best.verdict,
        _sentence(problem, best),
        best.nodes,
        time.monotonic() - start,
        best.pending,
        best=best,
        uncertified=why,
    )


def _sentence(problem: StatedProblem, best: Minimum) -> str:
    """The solver's, where what was asked for is the smallest value; of the largest one of its own."""
    if not problem.maximize or best.verdict in (Verdict.REFUTED, Verdict.NOT_CERTIFIED):
        return best.status
    lo, hi = -best.hi, -best.lo
    if best.verdict is Verdict.PROVED:
        least, most = bracket_text(lo, hi, 10)
        return f"The largest value lies in [{least}, {most}]: proved."
    return f"The largest value is at most {at_most(hi, 10)}; a limit came first."


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


# ------------------------------------------------------------------------------------------------------------------
# AMPL's .sol files: the answer to a .nl file, as AMPL, JuMP and Pyomo read it.

_CODES = {Verdict.PROVED: 0, Verdict.NOT_CERTIFIED: 100, Verdict.REFUTED: 200, Verdict.UNKNOWN: 400}


def sol_bytes(answer: Answer, rows: int) -> bytes:
    """The text; the point is the best proved one, or the middle of the first box. `rows`: constraints of the .nl."""
    values = next(iter(answer.points), [])
    lines = [f"cpcal: {answer.status}".replace("\n", " "), "", "Options", "3", "1", "1", "0"]
    lines += [str(rows), "0", str(len(answer.problem.network.names)), str(len(values))]
    lines += [repr(value) for value in values]
    return ("\n".join([*lines, f"objno 0 {_CODES[answer.verdict]}"]) + "\n").encode()
