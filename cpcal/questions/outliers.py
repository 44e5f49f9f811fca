"""The smallest model error of a leg when up to q of its measurements may be wrong, nobody knows which.

A proof that no eps below some target will do rests on the few measurements that have a weight in it, its *support*. It
holds whatever is left out elsewhere. So leaving out q measurements can allow a smaller eps only if every support known
loses one of its own: if the q measurements meet all of them. The search therefore goes in turns:

- a set of at most q measurements that meets all supports known is left out, and the others are searched up to the
  target: either that is refuted, which gives one more support, or a point is found, which lowers the target;
- when no set of q measurements meets all supports (found out exactly), the target is proved whichever are left out.

This is the exchange on supports, without trying the members of each one after the other: every turn settles all sets
of q measurements that miss the new support. The proof is the family of refutations: see `checker.robust_claim`.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cpcal.common.values import Floats
from cpcal.models import leg_box, model_statement
from cpcal.questions.bracket import (
    Answered,
    PreparedLeg,
    network_of,
    of_measurements,
    prepared_leg,
    searched,
    the_lower_bound,
    written,
)
from cpcal.questions.question import Question
from cpcal.questions.result import LegBracket, LegResult, Uncertified, Work
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.execution.stopping import Reason, Stopped, asked
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit
from cpcal.solver.optimize.minimum import Bracket, Minimum, hitting_set

MARGIN = 1e-5  # relative, below eps_hi: what is proved of every choice of outliers
SMALLEST = 1e-9  # mm, likewise
_ACTIVE = 1e-6  # mm: rows this near to the largest decide a fit


@dataclass(frozen=True)
class _Support:
    """Measurements that alone prove eps >= lo, and the certificate of that."""

    members: frozenset[int]
    lo: float
    certificate: str | None


def robust_leg(question: Question, leg: int) -> LegResult:
    """The bracket of leg `leg` when some of its measurements may be wrong; with certificates where they are asked for.

    A search that ends at the limits leaves the bracket open, as does one that cannot refute the target.
    """
    began, options, ids = time.monotonic(), question.options, question.campaign.measurement_ids
    question = replace(question, place=None, checkpoints=None)
    center, supports = question.center(leg), list[_Support]()
    without = guessed(question, leg, center)
    best = _searched(prepared_leg(question, leg, center=center, only=_others(question, without))).minimum
    target, searches = best.hi, 1
    while best.witness is not None and time.monotonic() - began < (options.time_limit or np.inf):
        target = min(target, best.hi - max(MARGIN * best.hi, SMALLEST))
        if target <= 0.0:  # no error is smaller
            break
        left_out = hitting_set([one.members for one in supports], options.outliers)
        if left_out is None:
            break
        if question.progress is not None:
            question.progress(leg, Bracket(0.0, best.hi, searches, 0, time.monotonic() - began))
        part = prepared_leg(question, leg, center=center, only=_others(question, left_out), highest=target)
        found = _searched(part, f".{len(supports) + 1:03d}")
        searches += 1
        if found.minimum.witness is not None:  # it lies below the target, and so below the best
            best, without = found.minimum, left_out
        else:
            target = min(target, found.minimum.lo)
            supports.append(_Support(_members(found.minimum, part), target, found.certificate))
    settled = hitting_set([one.members for one in supports], options.outliers) is None
    lo = min((one.lo for one in supports), default=0.0) if settled else 0.0
    at_point = None if best.witness is None else _point_certificate(question, leg, center, without, best)
    # a family that some choice meets proves nothing, and leaves no files
    proofs = all_or_none(question, [*(one.certificate for one in supports), *(() if settled else (None,))])
    closed = best.witness is not None and best.hi - lo <= 2.0 * max(MARGIN * best.hi, SMALLEST)
    lost = Uncertified.NOT_ASKED if question.certificates is None else Uncertified.NOTHING_PROVED
    return LegResult(
        leg=leg,
        bracket=LegBracket(
            verdict=Verdict.PROVED if closed else Verdict.UNKNOWN,
            lo=float(lo),
            hi=np.inf if best.witness is None else float(best.hi),
            point=None if best.witness is None else tuple(map(float, best.witness.point[:-1])),
            center=tuple(map(float, center[:7])),
            enclosure=leg_box(center, options.delta, question.model),
            proofs=proofs,
            point_certificate=at_point,
            left_out=() if best.witness is None else tuple(ids[k] for k in sorted(without)),
        ),
        not_certified=Uncertified.NOTHING if proofs or at_point else lost,
        extra=tuple(map(float, center[7:])),
        work=Work(nodes=searches, seconds=time.monotonic() - began),
    )


def guessed(question: Question, leg: int, center: Floats) -> frozenset[int]:
    """Measurements to leave out first: one after the other that whose loss lowers a local fit most."""
    whole, start = network_of(question, leg, center), np.append(center, 0.0)
    without: frozenset[int] = frozenset()

    def fitted(without: frozenset[int], start: Floats) -> tuple[Floats, list[int]]:
        """A local minimiser of the others' eps, and the measurements that decide it."""
        only = _others(question, without)
        network = whole if only is None else of_measurements(whole, only)
        rows = Rows(network)
        point = fit(rows, network.names.index("eps"), network.domain, start)
        # each one-sided row of a leg has an element for every measurement
        kept = range(len(question.campaign)) if only is None else only
        excess = rows.linearize(point).values.reshape(-1, len(kept)).max(axis=0)
        return point, [kept[k] for k in np.flatnonzero(excess >= -_ACTIVE)]

    for _ in range(question.options.outliers):
        start, active = fitted(without, start)
        trials = [(float(fitted(without | {k}, start)[0][-1]), k) for k in active]
        if not trials:
            break
        without |= {min(trials)[1]}
    return without


def all_or_none(question: Question, names: Collection[str | None]) -> tuple[str, ...]:
    """Certificates that prove something together; none, and no files, where one is missing: the others prove less."""
    found = tuple(name for name in names if name is not None)
    if len(found) == len(names):
        return found
    for name in found:
        assert question.certificates is not None
        (question.certificates / name).unlink()
    return ()


def _others(question: Question, without: frozenset[int]) -> tuple[int, ...] | None:
    """All measurements but these; None for all."""
    return tuple(k for k in range(len(question.campaign)) if k not in without) if without else None


def _members(found: Minimum, part: PreparedLeg) -> frozenset[int]:
    """The measurements with a weight in some step."""
    kept = part.only or range(len(part.question.campaign))
    return frozenset(kept[k] for _, k in found.rows)


def _searched(part: PreparedLeg, file: str | None = None) -> Answered:
    """The least eps of a part of the measurements; with a `file` a certificate, where no point was found."""
    limits = Limits(seconds=part.question.options.time_limit, gap=0.1 * MARGIN, gap_absolute=0.1 * SMALLEST)
    found = searched(
        part,
        None if file is None else lambda f, domain: None if f.witness is not None else the_lower_bound(f, domain),
        file=file or "",
        limits=limits,
        start=np.append(part.center, 0.0),
        enclose=False,
    )
    if found.minimum.interrupted:  # its bracket is of no use to the next search
        raise Stopped(asked() or Reason.INTERRUPTED)
    return found


def _point_certificate(
    question: Question, leg: int, center: Floats, without: frozenset[int], best: Minimum
) -> str | None:
    """The file that proves the best point, at all measurements but those left out."""
    domain, only = network_of(question, leg, center).domain, _others(question, without)
    if question.certificates is None:
        return None
    statement = model_statement(question.campaign, leg, question.model, domain, only)
    if statement is None:
        return None
    with Recording(statement, domain) as recording:
        claims = claims_of(replace(best, lo=0.0), domain, "eps") | {"enclosure": None}
        return written(question, leg, ".point", partial(recording.write, claims=claims))[0]
