"""Records a minimisation as a certificate: the steps as they are found, then what they prove together."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction as F
from functools import cached_property, partial
from io import StringIO
from pathlib import Path
from typing import IO, Any, BinaryIO, TypeVar

import numpy as np
import numpy.typing as npt

from cpcal.checker import Refused, rule
from cpcal.checker.certificate import check_lines, problem_of
from cpcal.checker.files import WORK, Budget, Lines, leg_work
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Problem, Row, Rule, Unknowns, Weights
from cpcal.common import errors
from cpcal.common.errors import InputError
from cpcal.common.errors import Problem as Trouble
from cpcal.common.files import replacing
from cpcal.common.values import Bools, Floats
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.certificate.exact_network import Statement, free, limits, number
from cpcal.solver.certificate.float_rows import (
    FloatRule,
    Parts,
    Product,
    Square,
    at_point,
    failing,
    rows_of,
    stretchings,
)
from cpcal.solver.contract import Contraction, Step, StepWeights, Verdict, shrunk
from cpcal.solver.execution.checkpoint_file import Checkpoint, Line
from cpcal.solver.execution.stopping import asked
from cpcal.solver.interval import Box
from cpcal.solver.optimize.bound import Minimum, Saved
from cpcal.solver.search import Event, EventKind, Proof

# ------------------------------------------------------------------------------------------------------------------
# Nobody is given a certificate that `cpcal verify` would refuse: it is checked before it is written.
#
# A whole check costs as much as the search. Of legs and of poses, whose claims are of one kind, it is made only where
# its work may come near the limit; of a minimisation of constraints that the certificate states itself, always.

_LEGS = 6  # of a run, for whose legs a check has its budget
_WORK_A_BYTE = 100  # of the steps; 18 to 60 were seen, the most with the leg model "linear" and uncertain readings
_SAMPLE = 4  # measurements
_NEAR = 2  # an estimate within this factor of the limit is not trusted


class UncheckableError(InputError):
    """The checker refuses the certificate, mostly because its check takes too much work; it was not written."""


def check_affordable(where: str, lines: BinaryIO, problem: Problem, domain: Box, claims: Mapping[str, Any]) -> None:
    """Raise UncheckableError where the checker would refuse these lines, which are for the file `where`."""
    most = WORK if problem.model is None else leg_work(_LEGS, problem.count)
    needed = _NEAR * (_WORK_A_BYTE * lines.seek(0, 2) + _work_of_point(problem, claims))
    if needed <= most and (problem.model is not None or problem.objective is None):
        return
    lines.seek(0)
    counted = Lines(lines, Budget(most))
    root = rule.Box(*(tuple(map(F, side.tolist())) for side in (domain.lo, domain.hi)))

    def formed(header: dict[str, Any]) -> tuple[Problem, rule.Box]:
        return (problem, root) if "campaign" in header else problem_of(header, counted, Path(where), None)

    try:
        check_lines(counted, formed)
    except Refused as refused:
        remedy = "use fewer measurements or constraints, or a wider gap; or leave the certificate out"
        if refused.code != "limit":
            remedy = "this is an error of ours, please report it; leave the certificate out"
        raise UncheckableError([Trouble(where, f"would be refused: {refused.reason}", remedy)]) from None


def _work_of_point(problem: Problem, claims: Mapping[str, Any]) -> int:
    """About the work to show that the claimed point satisfies its measurements."""
    point = claims["point"]
    if point is None:
        return 0
    spent: list[int] = []
    at = tuple(F(float.fromhex(v)) for v in point["at"])
    x = Unknowns(rule.Box(at, at), spent.append)
    holds = problem.chosen if point["holds"] == "all" else point["holds"]
    sample = list(zip(holds, point["readings"] or [None] * len(holds), strict=True))[:: max(1, len(holds) // _SAMPLE)]
    problem.unproved(x, [(k, "0" * len(problem.radii(k)) if signs is None else signs) for k, signs in sample])
    return sum(spent) * len(holds) // max(1, len(sample))


# ------------------------------------------------------------------------------------------------------------------
# Proposed steps, proved by the checker's own rule before they count for a certificate.
#
# A contractor proposes bounds with weights; they are shortened, and `Rule` says in exact arithmetic what they prove.
# The search goes on from the boxes that were proved, so what is written is what the checker will see.

T = TypeVar("T")
_BITS = (10, 14, 18, 24, 32, 53)  # of the largest weight: the first that prove nearly as much as was proposed
_LOSS = 0.02  # of the width that was proposed, given away for shorter numbers
_ROUNDING = 0.5  # of that loss: more may not be due to rounding
_NEARLY = 0.9  # of a proved width: a proposed one below that was not proved


def weights_text(proofs: Sequence[Weights]) -> tuple[list[int], list[dict[str, Any]]]:
    """The numbers of the rows that weights speak of, and the JSON of the weights, in which rows are counted anew."""
    used = sorted({n for weights in proofs for n, _ in weights.rows})
    places = {n: new for new, n in enumerate(used)}
    texts = [
        {
            "rows": [[places[n], w] for n, w in weights.rows],
            "products": weights.products,
            "tangents": [[i, number(t), w] for i, t, w in weights.tangents],
            "exponents": weights.exponents,
        }
        for weights in proofs
    ]
    return used, texts


class WeightProver:
    """Proves what a contractor proposes on a box, as far as the rule goes. Steps without weights count for nothing."""

    def __init__(self, statement: Statement, loss: float = _LOSS) -> None:
        self._statement, self._loss = statement, loss

    def __call__(self, box: Box, proposed: Contraction) -> Proof:
        width = np.zeros(len(box)) if proposed.box.is_empty else proposed.box.hi - proposed.box.lo
        table = _Table(self._statement, ExactBox(*(tuple(map(F, side.tolist())) for side in (box.lo, box.hi))))
        o = self._statement.problem.objective
        cap = None if o is None else number(float(box.hi[o]))
        table.take(proposed.steps)
        lo, hi, bounds = box.lo.copy(), box.hi.copy(), []
        steps: list[Step] = []
        for step in proposed.steps:
            if step.weights is None:
                continue
            if step.variable is None:
                excluding = _within_limits(partial(_excluding, table, step.weights))
                if excluding is not None:
                    (weights,), rows = table.encoded([excluding])
                    exclude = {"exclude": 0, "cap": cap, "rows": rows, "weights": weights}
                    return Proof(Box.empty(box.names), (*steps, step), exclude, True)
                continue
            i = box.index(step.variable)
            found = _within_limits(partial(_bound, table, i, step, self._loss * width[i]))
            if found is None:
                continue
            proof, bound = found
            if (step.side == "lo" and bound > lo[i]) or (step.side == "hi" and bound < hi[i]):
                (lo if step.side == "lo" else hi)[i] = bound
                bounds.append((i, step.side, number(bound), proof))
                steps.append(step)
        left, record = box.with_bounds(lo, hi), None
        if bounds:
            texts, rows = table.encoded([proof for *_, proof in bounds])
            entries = [[*entry[:3], text] for entry, text in zip(bounds, texts, strict=True)]
            record = {"pass": 0, "cap": cap, "rows": rows, "bounds": entries}
        return Proof(left, tuple(steps), record, _complete(left, proposed.box))


class _Table:
    """The rows of one step, each with the reference reading that was chosen for it, and the rule on the box."""

    def __init__(self, statement: Statement, box: ExactBox) -> None:
        self._statement = statement
        self._rows: list[Row] = []
        self._places: dict[tuple[str, int], int] = {}
        self.rule = Rule(statement.problem, box, self._rows, free)
        self.fast = FloatRule(self.rule, statement.problem, self._rows)

    def take(self, steps: Sequence[Step]) -> None:
        """Choose the reading of every row that the steps speak of."""
        named = (entry[:3] for step in steps if step.weights is not None for entry in step.weights.rows)
        places = [place for row in dict.fromkeys(named) if (place := self._statement.place(*row)) is not None]
        new = [place for place in dict.fromkeys(places) if place not in self._places]
        self._places |= {place: n for n, place in enumerate(new, start=len(self._rows))}
        first = len(self._rows)
        self._rows += rows_of(self._statement.problem, self.rule.x, new)
        _within_limits(partial(self.fast.form, range(first, len(self._rows))))

    def _place(self, constraint: int, part: int, element: int) -> int | None:
        """The number in the table of a polynomial row of the network; None where the statement has no such row."""
        place = self._statement.place(constraint, part, element)
        return None if place is None else self._places[place]

    def proposed(self, weights: StepWeights) -> _Proposed:
        """Weights as a contractor gives them, of rows of the table."""
        placed = [self._place(*e[:3]) for e in weights.rows]
        products = [(i, j, int(p), int(q)) for i, j, p, q, _ in weights.products]
        squares = [(i, t) for i, t, _ in weights.tangents]
        values = (np.array([e[-1] for e in kind]) for kind in (weights.rows, weights.products, weights.tangents))
        known = [n is not None for n in placed]
        parts = self.fast.parts([n for n in placed if n is not None], products, squares)
        return _Proposed(placed, products, squares, tuple(values), parts, np.array(known, np.bool_))

    def encoded(self, proofs: Sequence[Weights]) -> tuple[list[dict[str, Any]], list[list[Any]]]:
        """The JSON of weights, and of the rows that they speak of."""
        used, texts = weights_text(proofs)
        return texts, [written(self._rows[n]) for n in used]


@dataclass(frozen=True)
class _Proposed:
    """Weights (of rows, of products, of squares) that a contractor proposes, and what they are put on.

    A row that the statement has not is None in `rows`, False in `known`, and missing in `parts`.
    """

    rows: list[int | None]
    products: list[Product]
    squares: list[Square]
    weights: tuple[Floats, ...]
    parts: Parts
    known: Bools

    def shortened(self, bits: int) -> Floats:
        """Weights of the parts, as whole numbers of so many bits at most times a power of two."""
        values, largest = self._placed
        return np.asarray(np.ldexp(np.rint(np.ldexp(values, bits - largest)), largest - bits))

    @cached_property
    def _placed(self) -> tuple[Floats, npt.NDArray[np.intc]]:
        """The weights of the parts, and the exponent of the largest of their kind."""
        kinds = [self.weights[0][self.known], *self.weights[1:]]
        largest = [_exponent(values) for values in self.weights]
        return np.concatenate(kinds), np.repeat(np.array(largest, np.intc), [values.size for values in kinds])

    def exact(self, bits: int) -> Weights:
        """The checker's form of them; those that vanish are left out. Raises Refused where it has none."""
        (rows, r), (products, p), (squares, t) = (whole(values, bits) for values in self.weights)
        if not (all(-1000 <= e < 1000 for e in (r, p, t)) and all(np.isfinite(v).all() for v in self.weights)):
            raise Refused("weights are too large or too small to be written", "limit")
        kinds = zip(self.rows, rows, strict=True), zip(self.products, products, strict=True)
        return Weights(
            tuple((n, int(w)) for n, w in kinds[0] if w and n is not None),
            tuple((*product, int(w)) for product, w in kinds[1] if w),
            tuple((i, F(touch), int(w)) for (i, touch), w in zip(self.squares, squares, strict=True) if w),
            (r, p, t),
        )


def written(row: Row) -> list[Any]:
    """The JSON of a row; signs that are all 0 are left out."""
    return [*row] if set(row[2]) & {"-", "+"} else [*row[:2]]


def _within_limits(tried: Callable[[], T]) -> T | None:
    """None where the checker would refuse, because a polynomial is too large for it."""
    try:
        return tried()
    except Refused:
        return None


def _excluding(table: _Table, given: StepWeights) -> Weights | None:
    proposed = table.proposed(given)
    for bits in _BITS:
        if table.fast.lowest(proposed.parts, proposed.shortened(bits))[0] > 0.0:
            return proposed.exact(bits)
    return next((weights for weights in map(proposed.exact, _BITS) if table.rule.excludes(weights)), None)


def _bound(table: _Table, i: int, step: Step, loss: float) -> tuple[Weights, float]:
    """The shortest weights, and the bound on unknown i that they prove, that lose little of what was proposed."""
    assert step.weights is not None
    proposed = table.proposed(step.weights)
    doubtful = []  # what float64 arithmetic gives away may be all that is missing
    for bits in _BITS:
        proved, rounding = table.fast.bound(i, step.side, proposed.parts, proposed.shortened(bits))
        if abs(proved - step.bound) <= loss:
            return proposed.exact(bits), brief(F(proved), step.side == "lo", loss)
        if not abs(proved - step.bound) > loss + rounding:
            doubtful.append(bits)
    if not rounding <= _ROUNDING * loss:
        weights, bound = _exact_bound(table, i, step, [proposed.exact(b) for b in doubtful or [bits]], loss)
        return weights, brief(bound, step.side == "lo", loss)
    return proposed.exact(bits), brief(F(proved), step.side == "lo", loss)


def _exact_bound(table: _Table, i: int, step: Step, tried: list[Weights], loss: float) -> tuple[Weights, F]:
    """The first of the weights that lose little of what was proposed, or the last, and what they prove."""
    for weights in tried:
        proved = table.rule.bound(i, step.side, weights)
        if abs(proved - F(step.bound)) <= F(loss):
            break
    return weights, proved


def _complete(proved: Box, proposed: Box) -> bool:
    """Whether what was proved is hardly wider than what was proposed."""
    if proposed.is_empty:
        return proved.is_empty
    return not shrunk(proved.width, proposed.width, _NEARLY)


def whole(values: Floats, bits: int) -> tuple[Floats, int]:
    """Whole numbers that are nearly proportional to nonnegative ones, and the power of two between them."""
    exponent = _exponent(values) - bits
    return np.rint(np.ldexp(values, -exponent)), exponent


def _exponent(values: Floats) -> int:
    return math.frexp(values.max(initial=0.0))[1]


def rounded(value: F, down: bool) -> float:
    """The nearest float64 that is not above (below) a fraction."""
    nearest = float(value)
    if down and F(nearest) > value:
        return math.nextafter(nearest, -math.inf)
    if not down and F(nearest) < value:
        return math.nextafter(nearest, math.inf)
    return nearest


def brief(value: F, down: bool, loss: float) -> float:
    """A float64 with few digits that is at most about `loss` below (above) a fraction."""
    if loss > 0.0:
        unit = F(2) ** (math.frexp(loss)[1] - 1)
        value = ((value / unit).__floor__() if down else (value / unit).__ceil__()) * unit
    return rounded(value, down)


def line(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n"


Claims = dict[str, Any]  # line of a certificate

_ROOM = "make room, or name another folder for temporary files by TMPDIR; what was found stays"


class Recording:
    """Steps of one search, kept in a temporary file until `write`; use it in a `with` block.

    There a box is called by the serial number of the node that first stood for it, so that nothing about the boxes that
    wait is in memory; `write` gives them their names, in order.
    """

    def __init__(self, statement: Statement, domain: Box) -> None:
        self._statement, self._domain = statement, domain
        self._lost: OSError | None = None
        self._steps: IO[str] = StringIO()
        try:
            self._steps = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            self._lost = error
        self._written = Counter[str]()
        self._objective = statement.problem.objective

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        with suppress(OSError):
            self._steps.close()

    @property
    def whole(self) -> bool:
        """Whether all steps could be taken down: a full disk costs the certificate, and no search is worth less."""
        if self._lost is None:
            try:
                self._steps.flush()
            except OSError as error:
                self._lost = error
        return self._lost is None

    @property
    def problem(self) -> Problem:
        """What the certificate is about, exactly."""
        return self._statement.problem

    @property
    def prover(self) -> WeightProver:
        """Proves steps as the certificate will say them."""
        return WeightProver(self._statement)

    def event(self, event: Event) -> None:
        """Take down what became of a node, as long as there is space."""
        if self._lost is not None:
            return
        try:
            self._take_down(event)
        except OSError as error:
            self._lost = error

    def _take_down(self, event: Event) -> None:
        name = event.node.serial
        records = list(event.decision.proof)
        if event.kind is EventKind.PRUNED and not records:  # cut away by the incumbent
            records.append(("", {"pass": name, "cap": self._cap(event.node.box), "rows": [], "bounds": []}))
        for contractor, record in records:
            step = record | {"exclude" if "weights" in record else "pass": name}
            self._put(event.node.box, step, contractor)
        if event.kind is EventKind.CONTRACTED:
            self._put(event.node.box, {"same": name, "as": event.children[0].serial})
        elif event.kind is EventKind.SPLIT:
            first, second = event.children
            i = int(np.flatnonzero(first.box.hi != second.box.hi)[0])
            split = {"split": name, "unknown": i, "at": number(first.box.hi[i]), "into": [first.serial, second.serial]}
            self._put(event.contraction.box, split)

    def saved(self) -> Iterator[dict[str, Any]]:
        """All that was taken down, as lines of JSON, for `restore`."""
        yield {"calls": "boxes by serial"}
        self._steps.seek(0)
        yield from ({"step": text} for text in self._steps)

    def restore(self, lines: Iterable[dict[str, Any]]) -> None:
        """Stand where another recording of the same search stood. Raises KeyError, TypeError, ValueError."""
        head, *steps = lines
        if head != {"calls": "boxes by serial"}:
            raise ValueError("its steps are those of an older version")
        try:
            self._steps.seek(0)
            self._steps.truncate()
            self._steps.writelines(str(step["step"]) for step in steps)
        except OSError as error:
            self._lost = error

    def credited(self, uses: Iterable[ContractorUse]) -> tuple[ContractorUse, ...]:
        """With the number of steps that the certificate written last holds of each."""
        return tuple(replace(use, certified_steps=self._written[use.name]) for use in uses)

    def _put(self, box: Box, step: dict[str, Any], contractor: str = "") -> None:
        """Keep a step with the least objective of its box, for one that turns out worse than the claim is left out."""
        lowest = None if self._objective is None else float(box.lo[self._objective])
        self._steps.seek(0, os.SEEK_END)  # `saved` may have read
        self._steps.write(line([lowest, contractor, step]))

    def _useful_steps(self, cap: float | None) -> Iterator[dict[str, Any]]:
        """The steps on boxes that reach down to `cap`, their boxes named in order."""
        names, fresh = _Names(), 1
        names[0] = 0
        self._written.clear()
        self._steps.seek(0)
        for text in self._steps:
            lowest, contractor, step = json.loads(text)
            kind = next(word for word in ("pass", "exclude", "split", "same") if word in step)
            name = names[step[kind]]
            if kind == "same" and name is not None:
                names[step["as"]] = name
            if kind == "same" or name is None or (cap is not None and lowest > cap):
                continue
            step[kind] = name
            if cap is not None and step.get("cap") is not None and float.fromhex(step["cap"]) < cap:
                step["cap"] = number(cap)  # of a box whose objective was proved to be lower
            if kind == "split":
                into = [fresh, fresh + 1]
                names[step["into"][0]], names[step["into"][1]] = into
                step["into"], fresh = into, fresh + 2
            self._written[contractor] += len(step["bounds"]) if kind == "pass" else 1
            yield step

    def _cap(self, box: Box) -> str | None:
        """Just below the objective of a box that is worse than what is known."""
        o = self._objective
        return None if o is None else number(np.nextafter(box.lo[o], -np.inf))

    def write(self, path: str | os.PathLike[str], claims: Claims) -> Path:
        """The certificate, all or nothing. Raises UncheckableError where the checker would refuse it, InputError where
        it cannot be written, or its steps could not."""
        if not self.whole:
            assert self._lost is not None
            what = f"no room for the steps of a proof ({self._lost.strerror or self._lost})"
            raise errors.InputError([errors.Problem(Path(path).name, what, _ROOM)])
        problem = self._statement.problem
        claims = with_readings(problem, claims)
        cap = None if claims["cap"] is None else float.fromhex(claims["cap"])
        with replacing(path) as out, tempfile.TemporaryFile() as whole:
            whole.writelines(line(first).encode() for first in self._statement.header(self._domain))
            whole.write(line(claims).encode())
            whole.writelines(line(step).encode() for step in self._useful_steps(cap))
            check_affordable(Path(path).name, whole, problem, self._domain, claims)
            whole.seek(0)
            shutil.copyfileobj(whole, out)
        return Path(path)


class _Names:
    """The names of boxes by serial number, in eight bytes each."""

    def __init__(self) -> None:
        self._of = array("q")

    def __getitem__(self, serial: int) -> int | None:
        name = self._of[serial] if serial < len(self._of) else -1
        return None if name < 0 else name

    def __setitem__(self, serial: int, name: int) -> None:
        self._of.extend([-1] * (serial + 1 - len(self._of)))
        self._of[serial] = name


def claims_of(found: Minimum, domain: Box, objective: str, *, lower_only: bool = False) -> Claims:
    """What a minimisation over `domain` has proved, or its lower bound alone, and then nothing of what is above it."""
    lowest, cap = domain[objective].lo, min(found.hi, domain[objective].hi)
    if lower_only:
        cap = min(found.lo, cap)
    bracket: dict[str, Any] | None = {"lo": number(min(found.lo, cap)), "hi": None}
    hull = point = None
    if lowest == domain[objective].hi:  # one value of the objective was asked about
        bracket = None
    if not lower_only and not found.enclosure.is_empty:
        hull = limits(found.enclosure)
    if not lower_only and found.witness is not None:
        point = _valid(found.witness.point)
        if bracket is not None:
            bracket["hi"] = number(found.hi)
    refuted = found.witness is None and found.lo == np.inf
    return {"cap": number(cap), "infeasible": refuted, "epsilon": bracket, "enclosure": hull, "point": point}


def claims_at(cap: float, *, refuted: bool, point: npt.NDArray[np.float64] | None) -> Claims:
    """That no solution has an objective up to `cap`, if that is `refuted`, and that `point` is one, if it is given."""
    bracket = {"lo": number(cap), "hi": None} if refuted else None
    valid = None if point is None else _valid(point)
    return {"cap": number(cap), "infeasible": refuted, "epsilon": bracket, "enclosure": None, "point": valid}


def claims_verified(point: npt.NDArray[np.float64], cap: float, holds: list[int], fails: list[int]) -> Claims:
    """That a point satisfies some measurements and fails others."""
    verified = {"at": [number(v) for v in point], "holds": holds, "fails": fails}
    return {"cap": number(cap), "infeasible": False, "epsilon": None, "enclosure": None, "point": verified}


def with_readings(problem: Problem, claims: Claims) -> Claims:
    """Claims with the readings by which the point is a solution, and the rows by which it fails."""
    point = claims["point"]
    if point is None:
        return claims
    x = at_point([float.fromhex(v) for v in point["at"]])
    holds = problem.chosen if point["holds"] == "all" else point["holds"]
    signs = stretchings(problem, x, holds)
    rows = (failing(problem, x, k) for k in point["fails"])
    fails = [written(row) for row in rows if row is not None]
    return claims | {
        "point": point | {"readings": signs if any(set(one) - {"0"} for one in signs) else None, "fails": fails}
    }


def _valid(point: npt.NDArray[np.float64]) -> dict[str, Any]:
    return {"at": [number(v) for v in point], "holds": "all", "fails": []}


# ------------------------------------------------------------------------------------------------------------------
# What a minimisation keeps on disk while it works, so that another call can go on from there to the same answer.

_LONG = 1.0  # seconds: a search that is not done twice


class SearchKeeper(Checkpoint):
    """Keeps where one minimisation stands, and its recording; at the end too, if boxes are left then."""

    def __init__(
        self, path: Path | None, of: Mapping[str, str], recording: Recording | None, *, resume: bool = False
    ) -> None:
        super().__init__(path, of, resume=resume)
        self._recording = recording

    def resumed(self) -> Saved | None:
        """Where to go on, the recording brought there; None to begin. Raises InputError."""
        return self.restored(self._read)

    def _read(self, lines: list[Line]) -> Saved:
        found = Saved.from_lines([line["search"] for line in lines if "search" in line])
        steps = [line for line in lines if "search" not in line]
        if (self._recording is None) != (not steps):
            raise ValueError("it was kept with certificates, or without, and this run is not")
        if self._recording is not None:
            self._recording.restore(steps)
        return found

    def __call__(self, saved: Callable[[], Saved]) -> None:
        """After every round: `saved` says where the search stands."""
        self.after(partial(_kept_lines, self._recording, saved))  # without self: a circle stays in memory

    def keep(self) -> None:
        """A recording that lacks steps is nothing to go on with."""
        if self._recording is None or self._recording.whole:
            super().keep()

    def end(self, found: Minimum) -> None:
        """The search is over. Keep it where boxes are left, or it took long, for what comes next may be interrupted."""
        torn = found.interrupted and not asked()  # an exception broke it off between any two lines
        if not torn and (found.pending or found.seconds > _LONG):
            self.keep()


def _kept_lines(recording: Recording | None, saved: Callable[[], Saved]) -> Iterator[Line]:
    yield from ({"search": line} for line in saved().lines())
    if recording is not None:
        yield from recording.saved()


# ------------------------------------------------------------------------------------------------------------------
# What a certificate holds of an answer: all of it, its lower bound, or nothing. The certificate costs no answer.

_NO_POINT = (
    "the certificate proves the bound, not the point: no certificate can say yet that equations have a solution nearby"
)


class UncertifiedError(InputError):
    """The certificate could not be written, or the checker refuses it; `answer` is what was found, not certified."""

    answer: Minimum


def certified(recording: Recording, path: str | os.PathLike[str], found: Minimum, domain: Box, name: str) -> Minimum:
    """What was found, once its certificate is written and checked. Raises UncertifiedError.

    A certificate says of a point that it satisfies every constraint exactly. A point that only stands for a solution of
    equations in the box around it does not: then the certificate claims the lower bound and the enclosure alone.
    """
    claims = claims_of(found, domain, name)
    why = _unsaid(recording.problem, claims)
    if why:
        found = _not_certified(found, why)
        claims |= {"point": None, "epsilon": claims["epsilon"] and claims["epsilon"] | {"hi": None}}
    try:
        recording.write(path, claims)
    except InputError as error:
        raised = UncertifiedError(error.problems)
        raised.answer = _not_certified(found, "; ".join(problem.what for problem in error.problems))
        raise raised from None
    return replace(found, contractors_used=recording.credited(found.contractors_used))


def _unsaid(problem: Problem, claims: Claims) -> str:
    """Why a certificate cannot say that the claimed point satisfies every constraint exactly; empty where it can."""
    if claims["point"] is None:
        return ""
    at = tuple(F(float.fromhex(v)) for v in claims["point"]["at"])
    x = rule.Unknowns(rule.Box(at, at), free)
    try:
        return "" if all(problem.holds(x, k, "") for k in problem.chosen) else _NO_POINT
    except Refused as refused:
        return f"the certificate proves the bound, not the point: {refused.reason}"


def _not_certified(found: Minimum, why: str) -> Minimum:
    """With what is missing in place of the proof."""
    if found.verdict is Verdict.UNKNOWN:
        return replace(found, status=f"{found.status} Not certified: {why}.")
    return replace(found, verdict=Verdict.NOT_CERTIFIED, status=f"The gap is closed, but not certified: {why}.")
