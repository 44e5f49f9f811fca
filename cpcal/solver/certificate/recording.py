"""Records a minimisation as a certificate: the steps as they are found, then what they prove together."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from cpcal.checker.problem import Problem
from cpcal.common import errors
from cpcal.common.atomic import replacing
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.certificate.affordable import check_affordable
from cpcal.solver.certificate.readings import at_point, failing, stretchings
from cpcal.solver.certificate.statement import Statement, limits, number
from cpcal.solver.certificate.writer import WeightProver, line, written
from cpcal.solver.interval import Box
from cpcal.solver.optimize import Minimum
from cpcal.solver.search import Event, EventKind

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
    return claims | {"point": point | {"readings": signs if any(map(_moved, signs)) else None, "fails": fails}}


def _moved(signs: str) -> bool:
    return set(signs) != {"0"} and bool(signs)


def _valid(point: npt.NDArray[np.float64]) -> dict[str, Any]:
    return {"at": [number(v) for v in point], "holds": "all", "fails": []}
