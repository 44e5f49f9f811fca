"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cpcal.checker import POSE_SET_SUFFIX, RESULT_NAME, Accepted
from cpcal.cli.checked import checked_certificate, legs_beside
from cpcal.cli.claims import tell
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.errors import InputError, Problem
from cpcal.files.run_folder import ACCURACY, COMPARED, FITTED, HANDEYE, HANDEYE_WRONG, ROBUST, RUN, unfinished

KINDS = (RUN, ROBUST, COMPARED, FITTED, ACCURACY, HANDEYE, HANDEYE_WRONG)  # of folders with certificates


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
        accepted = _verified(target, talk) if target.is_dir() else _certificate(target, talk) is not None
    record("verified", target=str(target), accepted=bool(accepted and same))
    raise typer.Exit(0 if accepted and same else 1)


def _verified(folder: Path, talk: Talk) -> bool:
    """A folder, by what it holds; what other verbs write is loaded where it is found."""
    heads = [kind.head for kind in KINDS if (folder / kind.head).exists()]
    if len(heads) > 1:
        talk.say(
            f"{folder.name}: REFUSED, {' and '.join(heads)} are the answers of two commands, which share no folder"
        )
        return False
    if heads == [HANDEYE.head]:
        from cpcal.handeye.verify_hand_eye import verify_hand_eye

        return _all_accepted(verify_hand_eye(folder), talk)
    if heads == [HANDEYE_WRONG.head]:
        from cpcal.handeye.verify_hand_eye import verify_wrong_images

        return _all_accepted(verify_wrong_images(folder), talk)
    if heads == [RUN.head]:
        with legs_beside(folder) as legs:
            from cpcal.cli.verified_folders import run_verified  # while the legs are being checked

            return run_verified(folder, legs, talk)
    from cpcal.cli import verified_folders

    if heads == [ROBUST.head]:
        return verified_folders.robust_verified(folder, talk)
    if not heads and any(folder.glob(f"*/{RUN.head}")):
        return verified_folders.campaigns_verified(folder, lambda run: _verified(run, talk), talk)
    claimed = {path.name: _certificate(path, talk) for path in _certificates(folder, heads)}
    proved = {name: accepted for name, accepted in claimed.items() if accepted is not None}
    return verified_folders.others_verified(folder, proved, talk) and len(proved) == len(claimed)


def _same_campaign(target: Path, campaign: Path, talk: Talk) -> bool:
    """Whether the run's campaign, or hand-eye study, is the one in the folder. Raises InputError."""
    if any((target / kind.head).exists() for kind in (HANDEYE, HANDEYE_WRONG)):
        from cpcal.handeye.hand_eye_files import load_hand_eye

        if load_hand_eye(target) == load_hand_eye(campaign):
            return True
        talk.say("study: REFUSED, the hand-eye study is another one")
        return False
    from cpcal.files import campaign_sha256, load_campaign, load_campaign_json

    kept = load_campaign_json(target if target.is_dir() else target.parent)
    if campaign_sha256(kept) == campaign_sha256(load_campaign(campaign)):
        return True
    talk.say("campaign.json: REFUSED, the campaign is another one: its SHA-256 differs")
    return False


def _certificates(folder: Path, heads: list[str]) -> list[Path]:
    """Those of a folder without result.json. Raises InputError where there is nothing to check."""
    found = sorted(folder.glob("*.cert.jsonl"))
    if unfinished(folder):
        what = f"holds no {RESULT_NAME}: a run into it is at work, or was killed"
        raise InputError([Problem(str(folder), what, "wait for it, or run certify again")])
    if not found and not heads:
        what = f"holds neither {RESULT_NAME} nor a certificate (*.cert.jsonl)"
        raise InputError([Problem(str(folder), what, "name the folder of a run, or a certificate in it")])
    return found


def _certificate(path: Path, talk: Talk) -> Accepted | None:
    """What one certificate proves by itself; None where it is refused. Raises InputError where it cannot be read."""
    began = time.monotonic()
    accepted = checked_certificate(path)
    if isinstance(accepted, str):
        talk.say(f"{path.name}: REFUSED, {accepted}")
        return None
    tell(talk, path.name, accepted, time.monotonic() - began)
    return accepted


def _all_accepted(found: list[tuple[bool, str]], talk: Talk) -> bool:
    """Whether all statements are; says each."""
    for _, sentence in found:
        talk.say(sentence)
    return all(accepted for accepted, _ in found)
