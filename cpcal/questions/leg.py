"""One leg: its bracket, few measurements that prove it, ranges of its parameters; with outliers."""

import time
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker.rule import hitting_set
from cpcal.common.values import ArrayLike, Floats, Indices, Json, Names, Places
from cpcal.models import built_in, exactly_read, leg_box, model_statement, of_measurements
from cpcal.questions.bracket import (
    Answered,
    PreparedLeg,
    by_timeout,
    network_of,
    prepared_leg,
    searched,
    the_answer,
    the_enclosure,
    written,
)
from cpcal.questions.data_check import determination
from cpcal.questions.question import Question
from cpcal.questions.recommended import conformity
from cpcal.questions.result import LegBracket, LegResult, Options, Ranges, Uncertified, Work
from cpcal.solver.certificate.prover import Claims
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.execution.stopping import Reason, Stopped, asked
from cpcal.solver.interval import Box
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.bound import Alone, Bracket, Minimum, support
from cpcal.solver.optimize.local import Known, fit
from cpcal.solver.optimize.witness import Prepared, Witness

# at most for each try if a few measurements suffice: a convenience must not cost more than the answer
_SUPPORT_NODES = 3


def certify_leg(question: Question, leg: int) -> tuple[LegResult, bool]:
    """The result of one leg, and whether the user interrupted it."""
    if question.options.outliers:
        return robust_leg(question, leg), asked() is not None
    prepared, options = prepared_leg(question, leg), question.options
    center, eps = prepared.center, options.eps or 0.0
    start, tell = np.append(center, eps), None if question.progress is None else partial(question.progress, leg)
    best, begun = _begun(prepared, start)
    if options.method == "bound":
        answer = searched(prepared, the_answer, begun=begun, best=best, start=start, tell=tell)
    else:
        answer = by_timeout(prepared, start, tell)
    found, few = answer.minimum, _support(prepared, answer.minimum)
    stopped, lo = found.interrupted or asked() is not None, float(found.lo)
    if options.eps is not None:  # of that one alone something is said
        lo = eps if found.verdict is Verdict.REFUTED else 0.0
    result = _leg_result(
        prepared,
        found,
        {
            "verdict": found.verdict,
            "lo": lo,
            "enclosure": Box(question.model.parameters, found.enclosure.lo[:-1], found.enclosure.hi[:-1]),
            "certificate": answer.certificate,
        },
        support=few,
        not_certified=_not_certified(question, leg, answer),
        work=Work(
            nodes=found.nodes,
            programs=found.programs,
            seconds=found.seconds,
            pending=found.pending,
            floor=float(found.floor),
            trials=answer.trials,
        ),
    )
    if options.ranges:
        result = replace(result, ranges=ranges_of(prepared, result, begun, stopped=stopped))
    return result, stopped or asked() is not None


def _leg_result(part: PreparedLeg, found: Minimum, proved: Json, **others: Any) -> LegResult:
    """What was found with the measurements of `part`, and what these say beside; `proved`: fields of the bracket."""
    question, center = part.question, part.center
    point = None if found.witness is None else found.witness.point[:-1]
    campaign = question.campaign if part.only is None else question.campaign.rows(part.only)
    at = center if point is None else point
    return LegResult(
        leg=part.leg,
        bracket=LegBracket(
            hi=float(found.hi),
            point=None if point is None else tuple(map(float, point)),
            center=tuple(map(float, center[:7])),
            **proved,
        ),
        **conformity(part, proved["lo"]),
        extra=tuple(map(float, center[7:])),
        determination=determination(campaign, part.leg, at, question.model) if question.options.delta else None,
        **others,
    )


def _support(leg: PreparedLeg, found: Minimum) -> Names:
    """Few measurements that give the lower bound by themselves."""
    question, limits, best = leg.question, leg.question.limits, Known(found.witness, 0)
    if question.options.support == "none":
        return ()

    def alone(elements: Indices, enough: float) -> Alone:
        """The lower bound by a part of the measurements, up to what is enough; the best point of all is theirs too."""
        part, few = leg.alone(tuple(elements.tolist())), replace(limits, nodes=_SUPPORT_NODES)
        eps = part.domain["eps"]
        below = part.domain.replace("eps", hi=min(max(enough, eps.lo), eps.hi))
        least = searched(part, domain=below, limits=few, best=best, enclose=False).minimum
        better = least.witness if least.hi < found.hi else None
        return Alone(least.lo, None if better is None else better.point, least.interrupted)

    ids = question.campaign.measurement_ids
    return tuple(ids[k] for k in support(leg.problem, found, limits.gap, alone))


def _not_certified(question: Question, leg: int, answer: Answered) -> Uncertified:
    """Why there is no certificate."""
    if answer.certificate is not None or answer.lost:
        return answer.lost
    if question.certificates is None:
        return Uncertified.NOT_ASKED
    if answer.minimum.interrupted:
        return Uncertified.INTERRUPTED
    if not built_in(question.model) and not exactly_read(question.campaign, leg):
        return Uncertified.MODEL
    return Uncertified.NOTHING_PROVED


# ------------------------------------------------------------------------------------------------------------------
# The ranges of a leg's parameters at a tolerance: how well its measurements determine it, each side proved.

MARGIN = 1.1  # times eps_hi: at eps_hi itself hardly more than one point is left
_SHARED = 2.0  # times eps_hi: from larger ranges on the bracket gains nothing
PREFIX = "ranges-"  # of the certificates' names


def range_eps(options: Options, hi: float, *, refuted: bool = False) -> float | None:
    """The eps asked about; else the tolerance, if the leg reaches it; else eps_hi and a tenth. None where none does."""
    if options.eps is not None:
        return None if refuted else options.eps
    if options.tolerance is not None and hi <= options.tolerance:
        return options.tolerance
    return MARGIN * hi if hi < np.inf else None


def ranges_of(
    prepared: PreparedLeg, leg: LegResult, begun: Answered | None = None, *, stopped: bool = False
) -> Ranges | None:
    """The ranges of a leg that has its bracket.

    `begun`: the enclosure in which the bracket was sought; where it is of another eps, another one is found, unless the
    user has `stopped` the work.
    """
    question, bracket, found = prepared.question, leg.bracket, begun
    eps = range_eps(question.options, bracket.hi, refuted=bracket.verdict is Verdict.REFUTED)
    if eps is not None and question.options.eps is not None:  # they are what was asked
        return None if bracket.enclosure.is_empty else Ranges(eps, bracket.enclosure, bracket.certificate)
    if begun is None or begun.minimum.hi != eps:
        found = None if stopped else _enclosed(prepared, bracket.point or (), eps)
    if eps is None or found is None or found.minimum.interrupted:
        (question.certificates or {}).pop(f"{PREFIX}leg{leg.leg}.cert.jsonl", None)
        return None
    box = found.minimum.enclosure
    return Ranges(eps, Box(question.model.parameters, box.lo[:-1], box.hi[:-1]), found.certificate)


def _enclosed(prepared: PreparedLeg, point: ArrayLike, eps: float | None) -> Answered | None:
    """All parameters that reach an eps, as the point does, in one box. None where the legs are too short for it."""
    question, domain = prepared.question, prepared.domain
    if eps is None or not domain["eps"].lo <= eps <= domain["eps"].hi:
        return None
    return searched(
        prepared,
        the_enclosure,
        file=f"{PREFIX}leg{prepared.leg}",
        domain=domain.replace("eps", hi=eps),
        limits=replace(question.limits, gap_absolute=np.inf),  # no bracket is sought
        best=Known(Witness(np.append(point, eps), eps), 0),
    )


def _begun(prepared: PreparedLeg, start: Floats) -> tuple[Known | None, Answered | None]:
    """The best point of the first fit, and the enclosure that the ranges are going to state, where they are asked for.

    The search for the bracket goes on there: so its first steps, which are the same, are found and checked once.
    """
    question, options = prepared.question, prepared.question.options
    if not (options.ranges and options.method == "bound" and options.eps is None and built_in(question.model)):
        return None, None
    first = searched(prepared, limits=replace(question.limits, nodes=0), start=start).minimum
    if first.witness is None:
        return None, None
    found, eps = None, range_eps(options, first.hi)
    if eps is not None and eps <= _SHARED * first.hi:
        found = _enclosed(prepared, first.witness.point[:-1], eps)
    if found is not None and (found.minimum.interrupted or not (found.steps or question.certificates is None)):
        found = None
    return Known(first.witness, 1), found


# ------------------------------------------------------------------------------------------------------------------
# The smallest model error of a leg when up to q of its measurements may be wrong, nobody knows which.
#
# A proof that no eps below some target will do rests on the few measurements that have a weight in it, its *support*.
# It holds whatever is left out elsewhere. So leaving out q measurements can allow a smaller eps only if every support
# known loses one of its own: if the q measurements meet all of them. The search therefore goes in turns:
#
# - a set of at most q measurements that meets all supports known is left out, and the others are searched up to the
#   target: either that is refuted, which gives one more support, or a point is found, which lowers the target;
# - when no set of q measurements meets all supports (found out exactly), the target is proved whichever are left out.
#
# This is the exchange on supports, without trying the members of each one after the other: every turn settles all
# sets of q measurements that miss the new support. The proof is the family of refutations, as `checker.run` reads it.

_BELOW = 1e-5  # relative, below eps_hi: what is proved of every choice of outliers
_SMALLEST = 1e-9  # mm, likewise
_ACTIVE = 1e-6  # mm: rows this near to the largest decide a fit


class _Refutation(NamedTuple):
    """Measurements that alone prove eps >= lo, and the certificate of that."""

    members: frozenset[int]
    lo: float
    certificate: str | None


def robust_leg(question: Question, leg: int) -> LegResult:
    """The bracket of leg `leg` when some of its measurements may be wrong; with certificates where they are asked for.

    A search that ends at the limits leaves the bracket open, as does one that cannot refute the target.
    """
    began, options, ids = time.monotonic(), question.options, question.campaign.measurement_ids
    center, supports = question.center(leg), list[_Refutation]()
    without = guessed(question, leg, center)
    best = _searched(prepared_leg(question, leg, center=center, only=_others(question, without))).minimum
    target, searches = best.hi, 1
    while best.witness is not None and time.monotonic() - began < (options.time_limit or np.inf):
        target = min(target, best.hi - max(_BELOW * best.hi, _SMALLEST))
        if target <= 0.0:  # no error is smaller
            break
        left_out = hitting_set([one.members for one in supports], options.outliers)
        if left_out is None:
            break
        if question.progress is not None:
            question.progress(leg, Bracket(0.0, best.hi, searches, 0, time.monotonic() - began))
        part = prepared_leg(question, leg, center=center, only=_others(question, left_out), highest=target)
        found = _searched(part, f"leg{leg}.{len(supports) + 1:03d}")
        searches += 1
        if found.minimum.witness is not None:  # it lies below the target, and so below the best
            best, without = found.minimum, left_out
        else:
            target = min(target, found.minimum.lo)
            kept = part.only or range(len(ids))  # those with a weight in some step
            members = frozenset(kept[k] for _, k in found.minimum.rows)
            supports.append(_Refutation(members, target, found.certificate))
    settled = hitting_set([one.members for one in supports], options.outliers) is None
    lo = min((one.lo for one in supports), default=0.0) if settled else 0.0
    whole, at_point = network_of(question, leg, center), None
    without = frozenset() if best.witness is None else without  # without a point nothing is known to be wrong
    only = _others(question, without)
    if best.witness is not None and question.certificates is not None:
        statement = model_statement(question.campaign, leg, question.model, whole.domain, only)
        if statement is not None:  # of all measurements but those left out
            with Recording(statement, whole.domain) as recording:
                said = claims_of(replace(best, lo=0.0), whole.domain, "eps") | {"enclosure": None}
                at_point = written(question, f"leg{leg}.point", recording, said)[0]
    proofs = tuple(one.certificate for one in supports if one.certificate is not None)
    if not settled or len(proofs) < len(supports):  # a family that some choice meets proves nothing
        for name in proofs:
            del (question.certificates or {})[name]
        proofs = ()
    closed = best.witness is not None and best.hi - lo <= 2.0 * max(_BELOW * best.hi, _SMALLEST)
    lost = Uncertified.NOT_ASKED if question.certificates is None else Uncertified.NOTHING_PROVED
    return _leg_result(
        PreparedLeg(question, leg, center, Prepared(of_measurements(whole, only), "eps"), [], only),
        best,
        {
            "enclosure": leg_box(center, options.delta, question.model),
            "verdict": Verdict.PROVED if closed else Verdict.UNKNOWN,
            "lo": float(lo),
            "proofs": proofs,
            "point_certificate": at_point,
            "left_out": tuple(ids[k] for k in sorted(without)),
        },
        not_certified=Uncertified.NOTHING if proofs or at_point else lost,
        work=Work(nodes=searches, seconds=time.monotonic() - began),
    )


def guessed(question: Question, leg: int, center: Floats) -> frozenset[int]:
    """Measurements to leave out first: one after the other that whose loss lowers a local fit most."""
    whole, start = network_of(question, leg, center), np.append(center, 0.0)
    without: frozenset[int] = frozenset()

    def fitted(without: frozenset[int], start: Floats) -> tuple[Floats, list[int]]:
        """A local minimiser of the others' eps, and the measurements that decide it."""
        only = _others(question, without)
        network = of_measurements(whole, only)
        rows = Rows(network)
        point = fit(rows, network.names.index("eps"), network.domain, start)
        # each one-sided row of a leg has an element for every measurement
        kept = range(len(question.campaign)) if only is None else only
        excess = rows.linearize(point).values.reshape(-1, len(kept)).max(axis=0)
        return point, [kept[k] for k in np.flatnonzero(excess >= -_ACTIVE)]

    for _ in range(question.options.outliers):
        start, active = fitted(without, start)
        if start[-1] <= 0.0:  # what is left fits as it is: nothing more is wrong
            break
        trials = [(float(fitted(without | {k}, start)[0][-1]), k) for k in active]
        if not trials:
            break
        without |= {min(trials)[1]}
    return without


def _others(question: Question, without: frozenset[int]) -> Places | None:
    """All measurements but these; None for all."""
    return tuple(k for k in range(len(question.campaign)) if k not in without) if without else None


def _searched(part: PreparedLeg, file: str | None = None) -> Answered:
    """The least eps of a part of the measurements; with a `file` a certificate, where no point was found."""
    limits = Limits(seconds=part.question.options.time_limit, gap=0.1 * _BELOW, gap_absolute=0.1 * _SMALLEST)

    def lower_bound(found: Minimum, domain: Box) -> Claims | None:
        nothing = found.witness is not None or found.lo <= domain["eps"].lo
        return None if nothing else claims_of(found, domain, "eps", lower_only=True)

    start, claimed = np.append(part.center, 0.0), None if file is None else lower_bound
    found = searched(part, claimed, file=file, limits=limits, start=start, enclose=False)
    if found.minimum.interrupted:  # its bracket is of no use to the next search
        raise Stopped(asked() or Reason.INTERRUPTED)
    return found
