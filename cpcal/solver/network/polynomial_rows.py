"""The polynomial form of a network: all rows that have one, over one list of shared monomials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial import (
    MOST_PAIRS,
    Expander,
    NotPolynomial,
    PolynomialArray,
    pairs,
)
from cpcal.solver.network.rewrite import ReadingSets, Row, one_sided_rows, rewritten
from cpcal.solver.network.term_operations import Monomial


@dataclass(frozen=True)
class PolynomialSystem:
    """K inequalities `sum_m coefficients[:, k, m] * monomials[m] <= 0` in n variables.

    `coefficients` has shape (1 + J, K, M) (see `coefficient`); monomial 0 is 1 and with a monomial all its
    divisors are listed. `guards` (1 + J, K, G) over `guard_monomials` (positions in `monomials`) are the
    guards of the rows in `guarded` (K,). `origin` (K, 2) holds constraint and element of each row, `part` which of
    the rows made from that constraint it belongs to.
    """

    names: tuple[str, ...]
    monomials: tuple[Monomial, ...]
    coefficients: IntervalArray
    guarded: npt.NDArray[np.bool_]
    guard_monomials: npt.NDArray[np.intp]
    guards: IntervalArray
    origin: npt.NDArray[np.intp]
    part: npt.NDArray[np.intp]
    leftover: tuple[tuple[int, str], ...]


Expanded = tuple[Row, PolynomialArray, PolynomialArray | None]


class PolynomialForms:
    """The polynomial forms of one network for any parts of its reading sets; what they share is done once.

    Rows that are not expanded at `deadline` (of time.monotonic()) have none.
    """

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic, deadline: float = math.inf) -> None:
        self._network, self._engine, self._deadline = network, engine, deadline
        self._first = one_sided_rows(network)
        self._parts = [rewritten(row, engine) for row in self._first]
        self._expander: Expander | None = None

    def __getstate__(self) -> dict[str, object]:
        """Without the expander: its operations do not pickle, and it is made again where it is wanted."""
        return self.__dict__ | {"_expander": None}

    def _expanded(self, sets: Sequence[ReadingSets] | None) -> tuple[list[Expanded], list[tuple[int, str]]]:
        """All rows with their polynomials and guards, and what was left over and why."""
        expanded: list[Expanded] = []
        leftover: list[tuple[int, str]] = []
        if self._expander is None:
            roots = tuple(row.expr for row in self._first)
            self._expander = Expander(self._network, self._engine, roots, self._deadline)
        monomials, size = set[Monomial](), 0
        for k, parts in enumerate(self._parts):
            for part in parts:
                try:
                    body, *guards = self._forms_of(part, sets[k] if sets else {})
                    more = {m for p in (body, *guards) for m in p.monomials} - monomials
                    if size + pairs(more) > MOST_PAIRS:
                        raise NotPolynomial("with the other rows, too many products")
                    monomials, size = monomials | more, size + pairs(more)
                    expanded.append((part, body, guards[0] if guards else None))
                except NotPolynomial as reason:
                    leftover.append((part.constraint, str(reason)))
        return expanded, leftover

    def _forms_of(self, part: Row, sets: ReadingSets) -> list[PolynomialArray]:
        """Of a row, and of its guard if it has one. Raises NotPolynomial."""
        assert self._expander is not None
        roots = [root for root in (part.guard, part.expr) if root is not None]
        forms = [self._expander.expand(root) for root in roots]
        return (self._expander.again(roots, sets) if sets else forms)[::-1]

    def on(self, sets: Sequence[ReadingSets] | None = None) -> PolynomialSystem:
        """All rows that have a polynomial form, over one list of shared monomials.

        `sets` may give, for each one-sided row, smaller reading sets that decide it (see `monotone`).
        """
        rows, leftover = self._expanded(sets)
        return _system(self._network, rows, leftover)


def polynomial_form(
    network: ConstraintNetwork,
    engine: Arithmetic,
    sets: Sequence[ReadingSets] | None = None,
    deadline: float = math.inf,
) -> PolynomialSystem:
    """`PolynomialForms` for one collection of reading sets."""
    return PolynomialForms(network, engine, deadline).on(sets)


def _system(network: ConstraintNetwork, rows: list[Expanded], leftover: list[tuple[int, str]]) -> PolynomialSystem:
    polynomials = [p for _, q, g in rows for p in (q, g) if p is not None]
    monomials = _closed({m for p in polynomials for m in p.monomials})
    slots = max((p.coefficients.shape[0] for p in polynomials), default=1)
    column = {m: k for k, m in enumerate(monomials)}
    guard_columns = sorted({column[m] for _, _, g in rows if g is not None for m in g.monomials})
    blocks, guards, origins, guarded = [], [], [], []
    for row, q, g in rows:
        count = int(np.prod(q.shape))
        blocks.append(_dense(q, monomials, count, slots))
        guards.append(_dense(g, tuple(monomials[k] for k in guard_columns), count, slots))
        elements = np.arange(count) if row.elements is None else row.elements
        origins.append(np.stack([np.full(count, row.constraint), elements], axis=1))
        guarded.append(np.full(count, g is not None))
    return PolynomialSystem(
        names=network.names,
        monomials=monomials,
        coefficients=_joined(blocks, slots, len(monomials)),
        guarded=np.concatenate([np.zeros(0, dtype=bool), *guarded]),
        guard_monomials=np.array(guard_columns, dtype=np.intp),
        guards=_joined(guards, slots, len(guard_columns)),
        origin=np.concatenate([np.zeros((0, 2), dtype=np.intp), *origins]),
        part=_parts([(row.constraint, int(np.prod(q.shape))) for row, q, _ in rows]),
        leftover=tuple(leftover),
    )


def _parts(blocks: list[tuple[int, int]]) -> npt.NDArray[np.intp]:
    """For every row the number of its block among those of its constraint; blocks are (constraint, rows)."""
    seen: dict[int, int] = {}
    out = [np.zeros(0, dtype=np.intp)]
    for constraint, count in blocks:
        out.append(np.full(count, seen.setdefault(constraint, 0), dtype=np.intp))
        seen[constraint] += 1
    return np.concatenate(out)


def _closed(monomials: set[Monomial]) -> tuple[Monomial, ...]:
    """All divisors of the given monomials, by degree, then by variables."""
    out: set[Monomial] = {()}
    todo = list(monomials)
    while todo:
        m = todo.pop()
        if m not in out:
            out.add(m)
            todo += [m[:k] + m[k + 1 :] for k in range(len(m))]
    return tuple(sorted(out, key=lambda m: (len(m), m)))


def _dense(p: PolynomialArray | None, monomials: tuple[Monomial, ...], count: int, slots: int) -> IntervalArray:
    """Coefficients (1 + J, M, K)."""
    lo, hi = np.zeros((2, slots, len(monomials), count))
    if p is not None:
        place, c = {m: k for k, m in enumerate(monomials)}, p.coefficients
        columns = [place[m] for m in p.monomials]
        full = c.broadcast_to((*c.shape[:2], *p.shape)).reshape((*c.shape[:2], count))
        lo[: c.shape[0], columns], hi[: c.shape[0], columns] = full.lo, full.hi
    return IntervalArray(lo, hi)


def _joined(blocks: list[IntervalArray], slots: int, size: int) -> IntervalArray:
    """Coefficients (1 + J, K, M) of all rows: those of a monomial stand side by side in memory."""
    nothing = np.zeros((slots, size, 0))
    lo = np.concatenate([nothing, *(b.lo for b in blocks)], axis=2)
    hi = np.concatenate([nothing, *(b.hi for b in blocks)], axis=2)
    return IntervalArray(lo.transpose(0, 2, 1), hi.transpose(0, 2, 1))
