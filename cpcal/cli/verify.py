"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from cpcal.accuracy.findings import ACCURACY_NAME, load_accuracy
from cpcal.certify.fits import FITS_NAME, load_fits
from cpcal.certify.recomputed import stated_otherwise
from cpcal.checker import ROBUST_NAME, Accepted, Refused, Unusable, check
from cpcal.cli.checked import checked_certificate, checked_legs, result_of
from cpcal.cli.claims import sentences
from cpcal.cli.pose_sets import is_pose_set, verify_pose_sets
from cpcal.cli.robust import robust_verified
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import nearest
from cpcal.files import campaign_sha256, load_campaign, load_campaign_json
from cpcal.files.run_folder import HANDEYE, HANDEYE_WRONG, unfinished
from cpcal.handeye.hand_eye_files import load_hand_eye
from cpcal.handeye.verify_hand_eye import verify_hand_eye
from cpcal.handeye.verify_wrong_images import verify_wrong_images
from cpcal.report import REPORT_NAME
from cpcal.results import (
    COMPARISON_NAME,
    INFORMATION,
    RESULT_NAME,
    Entry,
    Uncertified,
    information,
    load_comparison,
)

_AGAIN = {  # what to do about a run in which no leg is certified
    Uncertified.INTERRUPTED: "again, without a limit that ends it too early",
    Uncertified.UNWRITTEN: "again, into a folder that has room",
    Uncertified.UNCHECKABLE: "fewer measurements at a time",
}


@talking
def verify(
    target: Annotated[Path, typer.Argument(metavar="RUN|CERTIFICATE", help="A run, or one certificate in it.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the original campaign, to compare the run's with."),
    ] = None,
    source: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Of pose sets: a camera.toml or target.toml that must be the one they name."),
    ] = None,
    *,
    talk: Talk,
) -> None:
    """Check a RUN, or one CERTIFICATE, against the campaign.json beside the certificates.

    A run of `cpcal handeye` is checked likewise against the study that it holds, pose sets from their pixels on.

    Every number that the run's result.json states must be claimed by a certificate, and every certificate must be
    accepted; a leg that is not certified is named. The checker forms every polynomial again from the campaign's
    numbers, or from the constraints that the certificate states, in exact rational arithmetic; it uses no solver and no
    rounding. docs/certificate-format.md says what a certificate claims and when it is accepted.
    """
    same = campaign is None or _same_campaign(target, campaign, talk)
    if is_pose_set(target):
        accepted = verify_pose_sets(target, source or [], talk)
    elif not target.is_dir():
        accepted = _certificate(target, talk)
    elif (target / HANDEYE.head).exists():
        accepted = _all_accepted(verify_hand_eye(target), talk)
    elif (target / HANDEYE_WRONG.head).exists():
        accepted = _all_accepted(verify_wrong_images(target), talk)
    elif (target / ROBUST_NAME).exists():
        accepted = robust_verified(target, talk)
    elif (target / RESULT_NAME).exists():
        accepted = _run(target, talk)
    else:
        found = [_certificate(path, talk) for path in _certificates(target)]
        accepted = all(found) and _as_stated(target, talk)
    record("verified", target=str(target), accepted=bool(accepted and same))
    raise typer.Exit(0 if accepted and same else 1)


def _same_campaign(target: Path, campaign: Path, talk: Talk) -> bool:
    """Whether the run's campaign, or hand-eye study, is the one in the folder. Raises InputError."""
    if any((target / kind.head).exists() for kind in (HANDEYE, HANDEYE_WRONG)):
        if load_hand_eye(target) == load_hand_eye(campaign):
            return True
        talk.say("study: REFUSED, the hand-eye study is another one")
        return False
    kept = load_campaign_json(target if target.is_dir() else target.parent)
    if campaign_sha256(kept) == campaign_sha256(load_campaign(campaign)):
        return True
    talk.say("campaign.json: REFUSED, the campaign is another one: its SHA-256 differs")
    return False


def _run(run: Path, talk: Talk) -> bool:
    """All legs of a run. Raises InputError where there is nothing to check."""
    if unfinished(run):
        talk.say("Another run into this folder is at work, or was killed: these are the answers before it.")
    result = result_of(run)
    legs = result if isinstance(result, str) else checked_legs(run)
    if isinstance(legs, str) or isinstance(result, str):
        talk.say(f"{RESULT_NAME}: REFUSED, {legs}")
        return False
    wrong = list(stated_otherwise(load_campaign_json(run), result))
    for sentence in wrong:
        talk.say(f"{RESULT_NAME}: REFUSED, {sentence}")
    if result.interrupted:
        talk.say("The run was interrupted: legs may be missing.")
    for leg, found in zip(legs, result.legs, strict=True):
        if leg.refused is not None:
            talk.say(f"leg {leg.leg}: REFUSED, {leg.refused}")
        elif leg.accepted is None:
            talk.say(f"leg {leg.leg}: NOT CERTIFIED, {found.not_certified}")
        ranges = None if found.ranges is None else found.ranges.certificate
        support = None if found.support_proof is None else found.support_proof.certificate
        for name, accepted in ((leg.certificate, leg.accepted), (support, leg.support), (ranges, leg.ranges)):
            if accepted is not None and name is not None:
                _tell(talk, name, accepted)
        for sentence in information(result.options, found):
            talk.say(f"leg {leg.leg}: {sentence}")
    talk.say(INFORMATION)
    if (run / REPORT_NAME).exists():
        talk.say(f"{REPORT_NAME} is not read here: `cpcal report` checks a run and writes its page again.")
    if not any(leg.accepted or leg.refused for leg in legs):
        remedy = next((_AGAIN[found.not_certified] for found in result.legs if found.not_certified in _AGAIN), "again")
        raise InputError([Problem(str(run), "holds no leg that is certified", f"certify {remedy}")])
    return not wrong and all(leg.refused is None for leg in legs)


def _certificates(folder: Path) -> list[Path]:
    """Those of a folder without result.json. Raises InputError where there are none."""
    found = sorted(folder.glob("*.cert.jsonl"))
    if unfinished(folder):
        what = f"holds no {RESULT_NAME}: a run into it is at work, or was killed"
        raise InputError([Problem(str(folder), what, "wait for it, or run certify again")])
    if not found:
        what = f"holds neither {RESULT_NAME} nor a certificate (*.cert.jsonl)"
        raise InputError([Problem(str(folder), what, "name the folder of a run, or a certificate in it")])
    return found


def _certificate(path: Path, talk: Talk) -> bool:
    """One certificate by itself. Raises InputError where it cannot be read."""
    began = time.monotonic()
    accepted = checked_certificate(path)
    if isinstance(accepted, str):
        talk.say(f"{path.name}: REFUSED, {accepted}")
        return False
    _tell(talk, path.name, accepted, time.monotonic() - began)
    return True


def _tell(talk: Talk, name: str, accepted: Accepted, seconds: float | None = None) -> None:
    work = f"{accepted.steps} steps" + ("" if seconds is None else f", {nearest(seconds, 1)} s")
    for sentence in sentences(accepted):
        talk.say(f"{name}: {sentence}: PROVED, {work}")


def _as_stated(folder: Path, talk: Talk) -> bool:
    """Whether the accepted certificates claim what the folder's compare.json, fits.json or accuracy.json states.

    Raises InputError.
    """
    wrong = [*_other_comparison(folder, talk), *other_fits(folder), *_other_sets(folder, talk)]
    for line in wrong:
        talk.say(f"{line}: REFUSED, states other numbers than are proved")
    return not wrong


def _other_comparison(folder: Path, talk: Talk) -> Iterator[str]:
    if not (folder / COMPARISON_NAME).exists():
        return
    comparison = load_comparison(folder)
    for entry in comparison.entries:
        if entry.certificate is None:
            talk.say(f"{entry.subject}, {entry.model}: NOT CERTIFIED, {entry.not_certified}")
            continue
        accepted = _claimed(folder, entry.certificate)
        of_legs = accepted.campaign == comparison.campaign_sha256 and accepted.leg is not None
        if of_legs and (entry.subject, entry.model) != (f"leg {accepted.leg}", accepted.model):
            yield f"{entry.subject}, {entry.model}, by the certificate of another"
        elif _stated(entry) != _proved(accepted):
            yield f"{entry.subject}, {entry.model}"


Numbers = tuple[float, float, tuple[tuple[float, float], ...] | None]  # eps_lo, eps_hi, the enclosure at eps_hi


def _stated(entry: Entry) -> Numbers:
    box = entry.enclosure
    sides = None if box.is_empty else tuple((float(lo), float(hi)) for lo, hi in zip(box.lo, box.hi, strict=True))
    return entry.eps_lo, entry.eps_hi, sides


def _proved(accepted: Accepted) -> Numbers:
    claims, inf = accepted.claims, float("inf")
    lo = inf if claims.infeasible else float(claims.eps_lo or 0)
    hi = inf if claims.eps_hi is None else float(claims.eps_hi)
    if claims.enclosure is None or (claims.eps_hi is not None and claims.cap != claims.eps_hi):
        return lo, hi, None
    pairs = enumerate(zip(*claims.enclosure, strict=True))
    return lo, hi, tuple((float(a), float(b)) for k, (a, b) in pairs if k != accepted.objective)


def _other_sets(folder: Path, talk: Talk) -> Iterator[str]:
    """Of the sets of parameters on which the bounds of an accuracy run rest."""
    if not (folder / ACCURACY_NAME).exists():
        return
    for box in load_accuracy(folder).boxes:
        if box.certificate is None:
            talk.say(f"set of leg {box.leg}: NOT CERTIFIED")
            continue
        accepted = _claimed(folder, box.certificate)
        claims = accepted.claims
        lo, hi = (tuple(map(float, side[:-1])) for side in claims.enclosure or ((None,), (None,)))
        proved = (accepted.leg, None if claims.cap is None else float(claims.cap), lo, hi)
        if claims.infeasible != (not box.lo) or proved != (box.leg, box.eps, box.lo, box.hi):
            yield f"set of leg {box.leg}"
    said = "the certificates prove the sets of parameters; no certificate holds the bounds of poses and cells."
    talk.say(f"{ACCURACY_NAME}: {said}")


def other_fits(folder: Path) -> Iterator[str]:
    if not (folder / FITS_NAME).exists():
        return
    for name, fits in load_fits(folder).both:
        for fit in fits:
            accepted = _claimed(folder, fit.certificate)
            point = accepted.claims.point
            found = (0, 0) if point is None else (len(point.holds), len(point.fails))
            if (accepted.leg, *found) != (fit.leg, fit.verified.holds, fit.verified.fails):
                yield f"{name}, leg {fit.leg}"


def _claimed(folder: Path, name: str) -> Accepted:
    """The claims of a certificate in the folder. Raises InputError for one that is missing or refused."""
    try:
        return check(folder / Path(name).name)
    except (Unusable, Refused) as reason:
        raise InputError([Problem(str(folder / name), str(reason), "run the command again that wrote it")]) from None


def _all_accepted(found: list[tuple[bool, str]], talk: Talk) -> bool:
    """Whether all statements are; says each."""
    for _, sentence in found:
        talk.say(sentence)
    return all(accepted for accepted, _ in found)
