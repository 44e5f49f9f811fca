"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from cpcal.checker import Accepted, Refused, Unusable, check
from cpcal.checker.files import KINDS, POSE_SET_SUFFIX
from cpcal.checker.run import RESULT_NAME, answer, certificates_of, check_kind, head_of, leg_checks
from cpcal.cli.claims import VACUOUS, NothingCertifiedError, Statement, told
from cpcal.cli.verbs import Status, Talk, argument, option
from cpcal.common.errors import unusable
from cpcal.files.run_folder import ACCURACY, HANDEYE, RUN, unfinished
from cpcal.solver.execution.executors import START

T = TypeVar("T")
_NAME = "name the folder of a run, or a certificate"
_PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1

# ------------------------------------------------------------------------------------------------------------------
# Certificates and legs, checked again by the exact checker.


@contextmanager
def _beside(checks: Sequence[Callable[[], T]]) -> Iterator[Callable[[], list[T]]]:
    """Checks are done by a process for each processor while in the block; what is given waits for what they find.

    They are forked where nothing but the checker is loaded yet: to load it once more takes a tenth of a second.
    """
    alone = sys.platform == "linux" and "numpy" not in sys.modules and threading.active_count() == 1
    context: Any = multiprocessing.get_context("fork" if alone else START)
    context.set_forkserver_preload(["cpcal.checker.run"])
    count = min(len(checks), _PROCESSORS) if _PROCESSORS > 1 else 0
    begun = []
    try:
        for k in range(count):
            pipe, there = context.Pipe(duplex=False)
            process = context.Process(target=answer, args=(checks[k::count], there))
            with suppress(OSError):
                process.start()
                begun.append((k, process, pipe))
            there.close()

        def answers() -> list[T]:
            found: list[T | None] = [None] * len(checks)
            for k, _, pipe in begun:
                with suppress(EOFError, OSError):
                    found[k::count] = pipe.recv()
            # of a lost process, here
            return [check() if one is None else one for one, check in zip(found, checks, strict=True)]

        yield answers
    finally:
        for _, process, _ in begun:
            process.kill()
            process.join()


def _center(run: Path) -> list[Statement]:
    from cpcal.questions.hand_eye import verify_center  # where it is done

    return [verify_center(run)]


def _accuracy(folder: Path) -> list[Statement]:
    """Its file is one that cpcal reads, whatever in it nobody proves. Raises Refused."""
    from cpcal.cli.verified import read
    from cpcal.questions.accuracy import load_accuracy

    read(load_accuracy, folder)
    return []


# with arrays, beside what the checker does
_COMPUTED: dict[str, Callable[[Path], list[Statement]]] = {HANDEYE.head: _center, ACCURACY.head: _accuracy}


def checked_certificates(folder: Path) -> dict[str, Accepted | str]:
    """What each certificate of a folder proves, or why it is refused; all share one budget. Raises InputError."""
    try:
        among = certificates_of(folder)
    except Refused as reason:
        return {folder.name: str(reason)}
    found = dict[str, Accepted | str]()
    for name in sorted(among.names):
        try:
            found[name] = among.accepted(name)
        except Refused as reason:
            found[name] = str(reason)
        except Unusable as reason:
            raise unusable(str(folder / name), str(reason), _NAME) from None
    return found


# ------------------------------------------------------------------------------------------------------------------
# Whatever a folder holds, or one file of it: statements. What other verbs write is loaded where it is found.


def statements(target: Path, *, verbose: bool = False) -> Iterator[Statement]:
    """What is accepted of a folder or a certificate, and what is refused; `verbose`: what nobody proves, too.

    Raises InputError where there is nothing.
    """
    head = ""
    try:
        if target.name.endswith(POSE_SET_SUFFIX) or any(target.glob(f"*{POSE_SET_SUFFIX}")):
            from cpcal.cli.verified import of_pose_sets

            yield from of_pose_sets(target)
        elif (head := head_of(target)) in KINDS:
            with _beside([partial(_COMPUTED[head], target)] if head in _COMPUTED else []) as computed:
                yield from check_kind(target, head)
                yield from chain.from_iterable(computed())
        elif head:
            if unfinished(target):
                yield True, "Another run into this folder is at work, or was killed: these are the answers before it."
            with _beside(leg_checks(target)) as legs:
                from cpcal.cli.verified import of_run  # while the legs are being checked

                yield from of_run(target, legs, verbose=verbose)
        elif runs := runs_in(target):
            for run in runs:
                yield True, f"{run.name}:"
                yield from statements(run, verbose=verbose)
        elif not target.is_dir():
            yield told(target.name, check(target))
        elif unfinished(target):
            what = f"holds no {RESULT_NAME}: a run into it is at work, or was killed"
            raise unusable(str(target), what, "wait for it, or run certify again")
        elif not any(target.glob("*.cert.jsonl")):
            raise Unusable(f"holds neither {RESULT_NAME} nor a certificate (*.cert.jsonl)")
        else:
            for name, accepted in checked_certificates(target).items():
                yield told(name, accepted)
    except Refused as reason:
        name = head or target.name
        yield False, f"{name}: REFUSED, {str(reason).removeprefix(f'{name} ')}"
    except Unusable as reason:
        raise unusable(str(target), str(reason), _NAME) from None


def refusals(folder: Path) -> list[str]:
    """Why a folder is refused: no sentence where all of it is accepted. Raises InputError."""
    refused = list[str]()
    with suppress(NothingCertifiedError):  # its last statement
        refused.extend(sentence for accepted, sentence in statements(folder) if not accepted)
    return refused


def runs_in(folder: Path) -> list[Path]:
    """The runs of one campaign in several models, or of one hand-eye study; no draft of a run that was killed."""
    return sorted(path.parent for kind in (RUN, HANDEYE) for path in folder.glob(f"[!.]*/{kind.head}"))


def _other_campaign(target: Path, campaign: Path) -> Iterator[Statement]:
    """Whether the run's campaign, or hand-eye study, is another than the one in the folder. Raises InputError."""
    if runs := [run for run in (target, *runs_in(target)) if (run / HANDEYE.head).exists()]:
        from cpcal.models.hand_eye import load_hand_eye, load_study_json

        studies = [load_hand_eye(campaign), *map(load_study_json, runs)]
        if target not in runs:  # of both questions: half-widths are the run's own
            studies = [replace(study.exactly(), provenance={}) for study in studies]
        if any(study != studies[0] for study in studies):
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
    campaign: Path | None = option(None, "Folder of the original campaign, to compare the run's with.", "CAMPAIGN"),
    *,
    talk: Talk,
) -> Status:
    """Check a RUN, or one CERTIFICATE, against the campaign.json beside the certificates.

    A hand-eye run is checked likewise against the study that it holds, pose sets from their pixels on.

    Every number that the run's result.json states must be claimed by a certificate, and every certificate must be
    accepted; a leg that is not certified is named. The checker forms every polynomial again from the campaign's
    numbers, or from the constraints that the certificate states, in exact rational arithmetic; it uses no solver, and
    rounds nothing but outward. docs/certificate-format.md says what a certificate claims and when it is accepted.
    """
    said = []
    for one in chain(
        [] if campaign is None else _other_campaign(target, campaign), statements(target, verbose=talk.verbose)
    ):
        said.append(one)
        if talk.verbose or VACUOUS not in one[1]:
            talk.say(one[1])
    good = all(accepted for accepted, _ in said)
    end = "; nothing is refused" if good else ": there is no verdict"
    if good and (target / RUN.head).is_file():
        from cpcal.cli.verified import verdict_words

        end = f"; {verdict_words(target)}"
    talk.say(f"{_count(said)}{end}", style="bold")
    return Status.ANSWERED if good else Status.UNKNOWN


def _count(said: Sequence[Statement]) -> str:
    held = sum("PROVED" in sentence for accepted, sentence in said if accepted)
    refused = sum(not accepted for accepted, _ in said)
    thing = "certificates" if any(".cert.jsonl" in sentence for _, sentence in said) else "proofs"
    return f"{held} of {held + refused} {thing} hold" + f", {refused} REFUSED" * bool(refused)
