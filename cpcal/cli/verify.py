"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from fractions import Fraction as F
from pathlib import Path

from cpcal.checker import (
    POSE_SET_SUFFIX,
    RESULT_NAME,
    Accepted,
    LegChecked,
    Refused,
    Unusable,
    certificates_of,
    check,
    leg_checks,
)
from cpcal.cli.options import ORIGINAL_CAMPAIGN, Status, argument, option
from cpcal.cli.terminal import Talk, record
from cpcal.common.errors import InputError, printable, unusable
from cpcal.common.numbers import bracket_text, inner_text, plain_gap, short
from cpcal.files.run_folder import ACCURACY, HANDEYE, RUN, unfinished
from cpcal.solver.execution.executors import executor_for

Statement = tuple[bool, str]  # whether it is accepted, and a sentence

# ------------------------------------------------------------------------------------------------------------------
# What an accepted certificate proves, in sentences; every number rounded to the side that stays proved.


def told(name: str, accepted: Accepted | str) -> Iterator[Statement]:
    """What a certificate proves, and how much work the check was; or why it is refused."""
    if isinstance(accepted, str):
        yield False, f"{name}: REFUSED, {accepted}"
    else:
        yield from ((True, f"{name}: {sentence}: PROVED, {accepted.steps} steps") for sentence in sentences(accepted))


def sentences(accepted: Accepted) -> list[str]:
    """One for each claim: absence is stated of a part of the box at most, existence of all of it."""
    claims, cap = accepted.claims, accepted.claims.cap
    if accepted.leg is not None:
        name, unit = "|g|", " mm"
        for_any = " for any readings in their sets, with legs longer than that"
        for_some, longer = " for some readings in their sets", ", with legs longer than that,"
        every = "x of the certificate's box"
        thing, of_all = _inside(accepted) or every, _equations(accepted)
    else:
        name = "" if accepted.objective is None else printable(accepted.unknowns[accepted.objective])
        unit = for_any = for_some = longer = ""
        thing = every = "point of the box"
        of_all = f"all {accepted.count} constraints"

    def goal(sign: str, value: F | None) -> str:
        """What none reaches, with the digits of the bracket; or, "attained", what is reached."""
        if value is None or not name:
            return ""
        if sign == "attained":
            return f" with {name} <= {bracket_text(value, value)[1]}{unit}"
        hi = claims.eps_hi
        text = short(bracket_text(value, value)[0]) if hi is None else bracket_text(value, hi)[0]
        return f" with {name} {sign} {text}{unit}"

    out = []
    if claims.infeasible:
        out.append(f"No {thing} satisfies {of_all}{goal('<=', cap)}{for_any}")
    elif claims.eps_lo is not None:
        out.append(f"No {thing} satisfies {of_all}{goal('<', claims.eps_lo)}{for_any}")
    if claims.eps_hi is not None:
        out.append(f"Some {every} satisfies {of_all}{goal('attained', claims.eps_hi)}{for_some}")
    elif (point := claims.point) is not None:
        eps = None if accepted.objective is None else point.at[accepted.objective]
        holds = f"satisfies {len(point.holds)}{goal('attained', eps)}{for_some}"
        out.append(
            f"The point given satisfies {of_all}{goal('attained', eps)}{for_some}"
            if point.holds == accepted.chosen
            else f"Of {of_all} the point given {holds}, and it fails {len(point.fails)}{goal('<=', eps)}{for_any}"
        )
    if claims.enclosure is not None:
        reached = " as well as that one" if cap is not None and cap == claims.eps_hi else goal("<=", cap)
        sides = [side for k, side in enumerate(zip(*claims.enclosure, strict=True)) if k != accepted.objective]
        lengths = sides if accepted.leg is None else sides[:7]
        lo, hi = max(lengths, key=lambda side: side[1] - side[0], default=(F(0), F(0)))
        others = (
            zip(map(printable, accepted.unknowns[7:-1]), sides[7:], strict=True) if accepted.leg is not None else ()
        )
        out.append(
            f"Every {every} that satisfies them{reached}{for_some}{longer} lies in the enclosure, whose sides are at "
            f"most {plain_gap(lo, hi)}{unit} long"
            + "".join(f", {name} in {_range(bracket_text(*side))}" for name, side in others)
        )
    return out


def _equations(accepted: Accepted) -> str:
    leg = f"of leg {accepted.leg}"
    if accepted.model not in (None, "plain"):
        leg += f" in the {printable(str(accepted.model))} model"
    if len(accepted.chosen) == accepted.count:
        return f"all {accepted.count} equations {leg}"
    return f"the equations {leg} for measurements {', '.join(map(str, accepted.chosen))} (from 0)"


def _inside(accepted: Accepted) -> str | None:
    """The box of all unknowns but the objective, rounded inward; None where nothing would be left of a side."""
    inner = [inner_text(lo, hi) for lo, hi in zip(accepted.lo[:-1], accepted.hi[:-1], strict=True)]
    if any(F(lo) > F(hi) for lo, hi in inner):
        return None
    names = map(printable, accepted.unknowns[:-1])
    return f"x with {', '.join(f'{name} in {_range(side)}' for name, side in zip(names, inner, strict=True))}"


def _range(texts: tuple[str, str]) -> str:
    return f"[{', '.join(map(short, texts))}]"


# ------------------------------------------------------------------------------------------------------------------
# Certificates and legs, checked again by the exact checker.


@contextmanager
def legs_beside(run: Path) -> Iterator[Callable[[], list[LegChecked]]]:
    """The legs of a run are checked, on all processors, while in the block; what is given waits for what is found.

    It raises Refused and Unusable.
    """
    try:
        checks = leg_checks(run)
    except (Refused, Unusable) as reason:
        why = reason

        def refuse() -> list[LegChecked]:
            raise why

        yield refuse
        return
    count = min(len(checks), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1)
    with executor_for(count) as (executor, _):
        begun = [executor.submit(_done, checks[k::count]) for k in range(count)]

        def answers() -> list[LegChecked]:
            found: list[LegChecked | None] = [None] * len(checks)
            for k, future in enumerate(begun):
                with suppress(BrokenExecutor):
                    found[k::count] = future.result()
            return [one or check() for one, check in zip(found, checks, strict=True)]  # of a lost worker, here

        yield answers


def _done(checks: Sequence[Callable[[], LegChecked]]) -> list[LegChecked]:
    return [one() for one in checks]


def checked_certificates(folder: Path) -> dict[str, Accepted | str]:
    """What each certificate of a folder proves, or why it is refused; all share one budget. Raises InputError."""
    try:
        among = certificates_of(folder)
    except Refused as reason:
        return {folder.name: str(reason)}
    return {name: _accepted(folder / name, lambda path: among.proved(path.name)) for name in sorted(among.names)}


def _accepted(path: Path, check: Callable[[Path], Accepted]) -> Accepted | str:
    """What a certificate proves, or why it is refused. Raises InputError where there is nothing to check."""
    try:
        return check(path)
    except Refused as reason:
        return str(reason)
    except Unusable as reason:
        raise _nothing(path, reason) from None


def _nothing(target: Path, reason: object) -> InputError:
    return unusable(str(target), str(reason), "name the folder of a run, or a certificate")


def check_all(folders: Iterable[Mapping[str, Accepted | str]]) -> tuple[bool, str]:
    """Whether all certificates of these folders are accepted, and a sentence."""
    found = [one for folder in folders for one in folder.items()]
    refused = [f"{name} ({reason})" for name, reason in found if isinstance(reason, str)]
    of = f"{len(found)} certificates"
    if refused:
        return False, f"Of {of} the checker REFUSED {len(refused)}: {'; '.join(refused)}."
    steps = sum(one.steps for _, one in found if not isinstance(one, str))
    return True, f"The checker accepted all {of} (exact arithmetic, no solver): {steps:,} steps."


# ------------------------------------------------------------------------------------------------------------------
# Whatever a folder holds, or one file of it: statements. What other verbs write is loaded where it is found.

_KINDS = (RUN, ACCURACY, HANDEYE)  # of folders with certificates


class NothingCertifiedError(InputError):
    """All that a run states is accepted, and none of it is certified."""


def statements(target: Path, sources: Sequence[Path] = ()) -> Iterator[Statement]:
    """What is accepted of a folder or a certificate, and what is refused. Raises InputError where there is nothing."""
    try:
        if target.name.endswith(POSE_SET_SUFFIX) or (target.is_dir() and any(target.glob("*" + POSE_SET_SUFFIX))):
            from cpcal.cli.verified import of_pose_sets

            yield from of_pose_sets(target, sources)
        elif target.is_dir():
            yield from _of_folder(target)
        else:
            yield from told(target.name, _accepted(target, check))
    except Unusable as reason:
        raise _nothing(target, reason) from None


def refusals(folder: Path) -> list[str]:
    """Why a folder is refused: no sentence where all of it is accepted. Raises InputError."""
    refused: list[str] = []
    with suppress(NothingCertifiedError):  # its last statement
        refused.extend(sentence for accepted, sentence in statements(folder) if not accepted)
    return refused


def _of_folder(folder: Path) -> Iterator[Statement]:
    heads = [kind.head for kind in _KINDS if (folder / kind.head).exists()]
    try:
        if len(heads) > 1:
            raise Refused(f"{' and '.join(heads)} are the answers of two commands, which share no folder")
        if heads == [HANDEYE.head]:
            from cpcal.questions.hand_eye import verify_hand_eye

            yield from verify_hand_eye(folder)
        elif heads == [ACCURACY.head]:
            from cpcal.cli.verified import of_accuracy

            yield from of_accuracy(folder)
        elif heads == [RUN.head]:
            with legs_beside(folder) as legs:
                from cpcal.cli.verified import of_run  # while the legs are being checked

                yield from of_run(folder, legs)
        elif runs_in(folder):
            from cpcal.cli.verified import of_runs

            yield from of_runs(folder)
        else:
            _there(folder)
            for name, accepted in checked_certificates(folder).items():
                yield from told(name, accepted)
    except Refused as reason:
        name = heads[0] if len(heads) == 1 else folder.name
        yield False, f"{name}: REFUSED, {str(reason).removeprefix(f'{name} ')}"


def runs_in(folder: Path) -> list[Path]:
    """The runs of many campaigns, or of one in several models; no draft of a run that was killed."""
    return sorted(path.parent for path in folder.glob(f"[!.]*/{RUN.head}"))


def _there(folder: Path) -> None:
    """Raises InputError where a folder without result.json has nothing to check."""
    if unfinished(folder):
        what = f"holds no {RESULT_NAME}: a run into it is at work, or was killed"
        raise unusable(str(folder), what, "wait for it, or run certify again")
    if not any(folder.glob("*.cert.jsonl")):
        raise _nothing(folder, f"holds neither {RESULT_NAME} nor a certificate (*.cert.jsonl)")


def _other_campaign(target: Path, campaign: Path) -> Iterator[Statement]:
    """Whether the run's campaign, or hand-eye study, is another than the one in the folder. Raises InputError."""
    if (target / HANDEYE.head).exists():
        from cpcal.models.hand_eye import load_hand_eye, load_study_json

        if load_study_json(target) != load_hand_eye(campaign):
            yield False, "study: REFUSED, the hand-eye study is another one"
        return
    from cpcal.files import campaign_sha256, load_campaign, load_campaign_json

    folder, asked = target if target.is_dir() else target.parent, campaign_sha256(load_campaign(campaign))
    inner = [] if (folder / RESULT_NAME).exists() else runs_in(folder)
    for run in inner or [folder]:
        if campaign_sha256(load_campaign_json(run)) != asked:
            name = f"{run.name}/" * (run != folder) + "campaign.json"
            yield False, f"{name}: REFUSED, the campaign is another one: its SHA-256 differs"


# ------------------------------------------------------------------------------------------------------------------
# The verb.


def verify(
    target: Path = argument("RUN|CERTIFICATE", "A run, or one certificate in it."),
    campaign: Path | None = ORIGINAL_CAMPAIGN,
    source: list[Path] | None = option(
        None, "Of pose sets: a camera.toml or target.toml that must be the one they name.", "FILE"
    ),
    *,
    talk: Talk,
) -> Status:
    """Check a RUN, or one CERTIFICATE, against the campaign.json beside the certificates.

    A hand-eye run is checked likewise against the study that it holds, pose sets from their pixels on.

    Every number that the run's result.json states must be claimed by a certificate, and every certificate must be
    accepted; a leg that is not certified is named. The checker forms every polynomial again from the campaign's
    numbers, or from the constraints that the certificate states, in exact rational arithmetic; it uses no solver and no
    rounding. docs/certificate-format.md says what a certificate claims and when it is accepted.
    """
    good = True
    for stated in ([] if campaign is None else _other_campaign(target, campaign), statements(target, source or [])):
        for accepted, sentence in stated:
            talk.say(sentence)
            good = good and accepted
    record("verified", target=str(target), accepted=good)
    return Status.ANSWERED if good else Status.UNKNOWN
