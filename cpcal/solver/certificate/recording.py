"""Records a minimisation as a certificate: the steps as they are found, then what they prove together."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from functools import partial
from io import BytesIO, StringIO
from pathlib import Path
from typing import IO, BinaryIO

import numpy as np

from cpcal.checker import Refused
from cpcal.checker.certificate import check_lines, problem_of
from cpcal.checker.files import WORK, Budget, Lines, leg_work
from cpcal.checker.leg import POINT_WORK
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Problem, Unknowns
from cpcal.common import errors
from cpcal.common.errors import InputError
from cpcal.common.files import StrPath, replacing
from cpcal.solver.certificate.exact_network import Statement, exact_box, number
from cpcal.solver.certificate.float_rows import at_point, failing, stretchings
from cpcal.solver.certificate.prover import Claims, WeightProver, claims, line, written
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.checkpoint_file import Checkpoint, Line
from cpcal.solver.execution.stopping import asked
from cpcal.solver.interval import Box
from cpcal.solver.optimize.bound import Minimum, Saved
from cpcal.solver.search.search import Event, EventKind

# ------------------------------------------------------------------------------------------------------------------
# Nobody is given a certificate that `cpcal verify` would refuse: it is checked before it is written.
#
# A whole check costs as much as the search. Of legs and of poses, whose claims are of one kind, it is made only where
# its work may come near the limit; of a minimisation of constraints that the certificate states itself, always.

_LEGS = 6  # of a run, for whose legs a check has its budget
_WORK_A_BYTE = 100  # of the steps; 18 to 60 were seen, the most with uncertain readings
_NEAR = 2  # an estimate within this factor of the limit is not trusted


class UncheckableError(InputError):
    """The checker refuses the certificate, mostly because its check takes too much work; it was not written."""


def check_affordable(where: str, lines: BinaryIO, problem: Problem, domain: Box, claims: Claims) -> None:
    """Raise UncheckableError where the checker would refuse these lines, which are for the file `where`."""
    most = WORK if problem.model is None else leg_work(_LEGS, problem.count)
    points = 0 if claims["point"] is None else problem.count
    needed = _NEAR * (_WORK_A_BYTE * lines.seek(0, 2) + POINT_WORK * points)
    if needed <= most and (problem.model is not None or problem.objective is None):
        return
    lines.seek(0)
    counted = Lines(lines, Budget(most))
    root = exact_box(domain)

    def formed(header: Line) -> tuple[Problem, ExactBox]:
        return (problem, root) if "campaign" in header else problem_of(header, counted, Path(where), None)

    try:
        check_lines(counted, formed)
    except Refused as refused:
        remedy = "use fewer measurements or constraints, or a wider gap; or leave the certificate out"
        if refused.code != "limit":
            remedy = "this is an error of ours, please report it; leave the certificate out"
        raise UncheckableError([errors.Problem(where, f"would be refused: {refused.reason}", remedy)]) from None


_CALLS = {"calls": "boxes by serial, lowest, step"}  # how steps are taken down
_ROOM = "make room, or name another folder for temporary files by TMPDIR; what was found stays"


class Recording(AbstractContextManager["Recording"]):
    """Steps of one search, kept in a temporary file until `write`; use it in a `with` block.

    There a box is called by the serial number of the node that first stood for it, so that nothing about the boxes that
    wait is in memory; `write` gives them their names, in order.
    """

    def __init__(self, statement: Statement, domain: Box) -> None:
        self._statement, self._domain = statement, domain
        self.problem, self.prover = statement.problem, WeightProver(statement)
        self._lost: OSError | None = None
        self._steps: IO[str] = StringIO()
        try:
            self._steps = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            self._lost = error

    def __exit__(self, *_: object) -> None:
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

    def event(self, event: Event) -> None:
        """Take down what became of a node, as long as there is space.

        Each step with the least objective of its box, for one that turns out worse than the claim is left out.
        """
        name, box, o = event.node.serial, event.node.box, self.problem.objective
        taken = [(box, step | {"exclude" if "weights" in step else "pass": name}) for step in event.decision.proof]
        if event.kind is EventKind.PRUNED and not taken:  # cut away by the incumbent, which is just below it
            cap = None if o is None else number(np.nextafter(box.lo[o], -np.inf))
            taken.append((box, {"pass": name, "cap": cap, "rows": [], "bounds": []}))
        if event.kind is EventKind.CONTRACTED:
            taken.append((box, {"same": name, "as": event.children[0].serial}))
        elif event.kind is EventKind.SPLIT:
            first, second = event.children
            i = int(np.flatnonzero(first.box.hi != second.box.hi)[0])
            cut = {"unknown": i, "at": number(first.box.hi[i]), "into": [first.serial, second.serial]}
            taken.append((event.contraction.box, {"split": name, **cut}))
        if self._lost is None:
            try:
                self._steps.seek(0, os.SEEK_END)  # `saved` may have read
                for of, step in taken:
                    self._steps.write(line([None if o is None else float(of.lo[o]), step]))
            except OSError as error:
                self._lost = error

    def saved(self) -> Iterator[Line]:
        """All that was taken down, as lines of JSON, for `restore`."""
        yield _CALLS
        self._steps.seek(0)
        yield from ({"step": text} for text in self._steps)

    def restore(self, lines: Iterable[Line]) -> None:
        """Stand where another recording of the same search stood. Raises KeyError, TypeError, ValueError."""
        head, *steps = lines
        if head != _CALLS:
            raise ValueError("its steps are those of an older version")
        try:
            self._steps.seek(0)
            self._steps.truncate()
            self._steps.writelines(str(step["step"]) for step in steps)
        except OSError as error:
            self._lost = error

    def follow(self, steps: Sequence[Line]) -> None:
        """Begin with what was saved of a search that left one box, where this one begins."""
        last = max((json.loads(one["step"])[-1].get("as", 0) for one in steps[1:]), default=0)
        self.restore([*steps, {"step": line([None, {"same": last, "as": 0}])}])

    def _useful_steps(self, cap: float | None) -> Iterator[str]:
        """The steps on boxes that reach down to `cap`, their boxes named in order; rows and weights as they stand."""
        names, fresh = {0: 0}, 1  # of the boxes that are open
        self._steps.seek(0)
        for text in self._steps:
            head, rows, rest = text.partition(',"rows":')
            lowest, step = json.loads(f"{head}}}]" if rows else head)
            kind = next(word for word in ("pass", "exclude", "split", "same") if word in step)
            name = names.get(step[kind]) if kind == "pass" else names.pop(step[kind], None)
            if kind == "same" and name is not None:
                names[step["as"]] = name
            if kind == "same" or name is None or (cap is not None and lowest > cap):
                continue
            step[kind] = name
            if cap is not None and step.get("cap") is not None and float.fromhex(step["cap"]) < cap:
                step["cap"] = number(cap)  # of a box whose objective was proved to be lower
            if kind == "split":
                into = [fresh, fresh + 1]
                names |= zip(step["into"], into, strict=True)
                step["into"], fresh = into, fresh + 2
            said = line(step)
            yield f"{said[:-2]}{rows}{rest[:-2]}\n" if rows else said  # each is closed by a bracket and the line's end

    def content(self, name: str, claims: Claims) -> bytes:
        """The certificate, for a file of that name. Raises UncheckableError where the checker would refuse it,
        InputError where its steps could not be kept."""
        if not self.whole:
            assert self._lost is not None
            what = f"no room for the steps of a proof ({self._lost.strerror or self._lost})"
            raise InputError([errors.Problem(name, what, _ROOM)])
        claims = with_readings(self.problem, claims)
        cap, whole = None if claims["cap"] is None else float.fromhex(claims["cap"]), BytesIO()
        whole.writelines(line(first).encode() for first in self._statement.header(self._domain))
        whole.write(line(claims).encode())
        whole.writelines(map(str.encode, self._useful_steps(cap)))
        check_affordable(name, whole, self.problem, self._domain, claims)
        return whole.getvalue()

    def write(self, path: StrPath, claims: Claims) -> Path:
        """The certificate, all or nothing. Raises as `content` does, and InputError where it cannot be written."""
        with replacing(path) as out:
            out.write(self.content(Path(path).name, claims))
        return Path(path)


def claims_of(found: Minimum, domain: Box, objective: str, *, lower_only: bool = False) -> Claims:
    """What a minimisation over `domain` has proved, or its lower bound alone, and then nothing of what is above it."""
    lowest, highest = domain[objective].lo, domain[objective].hi
    cap = min(found.lo if lower_only else found.hi, found.hi, highest)
    witness = None if lower_only else found.witness
    return claims(
        cap,
        refuted=found.witness is None and found.lo == np.inf,
        lo=None if lowest == highest else min(found.lo, cap),  # None: one value of the objective was asked about
        hi=None if witness is None else found.hi,
        enclosure=None if lower_only or found.enclosure.is_empty else found.enclosure,
        point=None if witness is None else witness.point,
    )


def with_readings(problem: Problem, claims: Claims) -> Claims:
    """Claims with the readings by which the point is a solution, and the rows by which it fails."""
    point = claims["point"]
    if point is None:
        return claims
    x = _point(point)
    holds = problem.chosen if point["holds"] == "all" else point["holds"]
    signs = [] if point["factor"] is not None else stretchings(problem, x, holds)
    rows = (failing(problem, x, k) for k in point["fails"])
    fails = [written(row) for row in rows if row is not None]
    return claims | {
        "point": point | {"readings": signs if any(set(one) - {"0"} for one in signs) else None, "fails": fails}
    }


def _point(claimed: Claims) -> Unknowns:
    return at_point([float.fromhex(v) for v in claimed["at"]])


# ------------------------------------------------------------------------------------------------------------------
# What a minimisation keeps on disk while it works, so that another call can go on from there to the same answer.

_LONG = 1.0  # seconds: a search that is not done twice


class SearchKeeper(Checkpoint):
    """Keeps where one minimisation stands, and its recording; at the end too, if boxes are left then."""

    def __init__(
        self, path: StrPath | None, of: Mapping[str, str], recording: Recording | None, *, resume: bool
    ) -> None:
        super().__init__(path, of, resume=resume)
        self._recording = recording

    def resumed(self) -> Saved | None:
        """Where to go on, the recording brought there; None to begin. Raises InputError."""

        def read(lines: list[Line]) -> Saved:
            found = Saved.from_lines([line["search"] for line in lines if "search" in line])
            steps = [line for line in lines if "search" not in line]
            if (self._recording is None) != (not steps):
                raise ValueError("it was kept with certificates, or without, and this run is not")
            if self._recording is not None:
                self._recording.restore(steps)
            return found

        return self.restored(read)

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


def certified(recording: Recording, path: StrPath, found: Minimum, domain: Box, name: str) -> Minimum:
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
    return found


def _unsaid(problem: Problem, claims: Claims) -> str:
    """Why a certificate cannot say that the claimed point satisfies every constraint exactly; empty where it can."""
    if claims["point"] is None:
        return ""
    x = _point(claims["point"])
    try:
        return "" if problem.unproved(x, [(k, "") for k in problem.chosen]) is None else _NO_POINT
    except Refused as refused:
        return f"the certificate proves the bound, not the point: {refused.reason}"


def _not_certified(found: Minimum, why: str) -> Minimum:
    """With what is missing in place of the proof."""
    if found.verdict is Verdict.UNKNOWN:
        return replace(found, status=f"{found.status} Not certified: {why}.")
    return replace(found, verdict=Verdict.NOT_CERTIFIED, status=f"The gap is closed, but not certified: {why}.")
