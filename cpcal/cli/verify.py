"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cpcal.certify.recomputed import stated_otherwise
from cpcal.checker import POSE_SET_SUFFIX, ROBUST_NAME, Accepted
from cpcal.cli.checked import checked_certificate, checked_legs, result_of
from cpcal.cli.claims import sentences
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.numbers import nearest
from cpcal.files import campaign_sha256, load_campaign_json
from cpcal.files.run_folder import HANDEYE, HANDEYE_WRONG, REPORT_NAME, unfinished
from cpcal.legs.models import BUILT_IN
from cpcal.report.words import missing_legs
from cpcal.results import INFORMATION, RESULT_NAME, Uncertified, information

OWN_MODEL = (
    "The checker does not know the model {}: its certificates state the constraints themselves. That these are the "
    "model's of this campaign is not checked."
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
    if target.name.endswith(POSE_SET_SUFFIX) or (target.is_dir() and any(target.glob("*" + POSE_SET_SUFFIX))):
        from cpcal.cli.verify_pose_sets import verify_pose_sets

        accepted = verify_pose_sets(target, source or [], talk)
    else:
        accepted = _verified(target, talk) if target.is_dir() else _certificate(target, talk)
    record("verified", target=str(target), accepted=bool(accepted and same))
    raise typer.Exit(0 if accepted and same else 1)


def _verified(folder: Path, talk: Talk) -> bool:
    """A folder, by what it holds; what other verbs write is loaded where it is found."""
    if (folder / HANDEYE.head).exists():
        from cpcal.handeye.verify_hand_eye import verify_hand_eye

        return _all_accepted(verify_hand_eye(folder), talk)
    if (folder / HANDEYE_WRONG.head).exists():
        from cpcal.handeye.verify_wrong_images import verify_wrong_images

        return _all_accepted(verify_wrong_images(folder), talk)
    if (folder / ROBUST_NAME).exists():
        from cpcal.cli.robust import robust_verified

        return robust_verified(folder, talk)
    if (folder / RESULT_NAME).exists():
        return _run(folder, talk)
    from cpcal.cli.other_statements import as_stated

    found = [_certificate(path, talk) for path in _certificates(folder)]
    return all(found) and as_stated(folder, talk)


def _same_campaign(target: Path, campaign: Path, talk: Talk) -> bool:
    """Whether the run's campaign, or hand-eye study, is the one in the folder. Raises InputError."""
    if any((target / kind.head).exists() for kind in (HANDEYE, HANDEYE_WRONG)):
        from cpcal.handeye.hand_eye_files import load_hand_eye

        if load_hand_eye(target) == load_hand_eye(campaign):
            return True
        talk.say("study: REFUSED, the hand-eye study is another one")
        return False
    from cpcal.files import load_campaign

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
    if result.model.name not in {model.name for model in BUILT_IN}:
        talk.say(OWN_MODEL.format(printable(result.model.name)))
    missing = missing_legs(result, load_campaign_json(run).legs)
    if missing is not None:
        talk.say(missing)
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
        if found.ranges is not None and ranges is None:
            talk.say(f"leg {leg.leg}: its ranges are NOT CERTIFIED")
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


def _all_accepted(found: list[tuple[bool, str]], talk: Talk) -> bool:
    """Whether all statements are; says each."""
    for _, sentence in found:
        talk.say(sentence)
    return all(accepted for accepted, _ in found)
