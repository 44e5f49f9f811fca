"""The command line of the checker. Exit status: 0 proved, 1 refused, 2 nothing to check, 3 an error of the checker."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Sequence
from fractions import Fraction as F
from pathlib import Path

from .certificate import Accepted, check
from .files import ACCURACY_NAME, POSE_SET_SUFFIX, STUDY_NAME, WORK
from .readers import Refused, Unusable
from .run import RESULT_NAME, RobustChecked, check_run

PROVED, REFUSED, UNUSABLE, INTERNAL = 0, 1, 2, 3


def main(arguments: Sequence[str]) -> int:
    """Check a run, or one certificate of it; the exit status."""
    parser = argparse.ArgumentParser("checker", description="Check the certificates of a run in exact arithmetic.")
    parser.add_argument("target", type=Path, help="the folder of a run, or a certificate (*.cert.jsonl)")
    parser.add_argument("--campaign", type=Path, help="the campaign.json that a certificate speaks of")
    parser.add_argument("--work", type=int, help="what the check may cost, in tenths of a microsecond, about")
    given = parser.parse_args(arguments)
    try:
        if given.target.name.endswith(POSE_SET_SUFFIX) or any(given.target.glob("*" + POSE_SET_SUFFIX)):
            return _pose_sets(given.target, given.work or 0)
        if (given.target / STUDY_NAME).is_file():
            return _hand_eye(given.target, given.work or 0)
        if (given.target / ACCURACY_NAME).is_file():
            return _accuracy(given.target, given.work or 0)
        if given.target.is_dir():
            return _runs(given.target, given.work or 0)
        print(f"PROVED: {stated(check(given.target, given.campaign, work=given.work or WORK))}")
        return PROVED
    except Refused as reason:
        print(f"REFUSED: {reason}")
        return REFUSED
    except Unusable as reason:
        print(f"Nothing to check: {reason}.", file=sys.stderr)
        return UNUSABLE
    except Exception:
        traceback.print_exc()
        print("The checker itself failed: this says nothing of the certificate.", file=sys.stderr)
        return INTERNAL


def _runs(folder: Path, work: int) -> int:
    """A run, or the runs of several models or campaigns: all are looked at, and the worst decides."""
    inner = sorted(path.parent for path in folder.glob(f"[!.]*/{RESULT_NAME}"))  # no draft of a run that was killed
    if (folder / RESULT_NAME).exists() or not inner:
        return _run(folder, work)
    worst = PROVED
    for run in inner:
        print(f"{run.name}:")
        try:
            worst = max(worst, _run(run, work))
        except Refused as reason:
            print(f"REFUSED: {reason}")
            worst = REFUSED
    return worst


def _run(folder: Path, work: int) -> int:
    legs = check_run(folder, work=work)
    for leg in legs:
        claims = _outliers(leg.robust) if leg.robust else "" if leg.accepted is None else stated(leg.accepted)
        said = (
            f"REFUSED: {leg.refused}" if leg.refused is not None else f"PROVED: {claims}" if claims else "not certified"
        )
        print(f"leg {leg.leg}: {said}")
    print("Not judged here: whether the measurements determine the parameters; `cpcal verify` computes that again.")
    if any(leg.refused is not None for leg in legs):
        return REFUSED
    if not any(leg.accepted or (leg.robust and leg.robust.certified) for leg in legs):
        raise Unusable("no leg of the run is certified")
    return PROVED


def _outliers(leg: RobustChecked) -> str:
    """Of a leg of whose measurements some may be wrong."""
    found = [] if leg.lo is None else [f"eps >= {_down(leg.lo)}"]
    found += [] if leg.hi is None else [f"eps <= {-_down(-leg.hi)} without {', '.join(leg.left_out) or 'none'}"]
    return "; ".join([*found, f"at most {leg.outliers} wrong"]) if found else ""


def _hand_eye(folder: Path, work: int) -> int:
    from .hand_eye import check_hand_eye

    found = check_hand_eye(folder, work=work)
    for _, sentence in found:
        print(sentence)
    print("Not judged here: whether the centre of the box is the least-squares answer; `cpcal verify` computes that.")
    return PROVED if all(accepted for accepted, _ in found) else REFUSED


def _accuracy(folder: Path, work: int) -> int:
    from .platform import check_accuracy

    for _, sentence in check_accuracy(folder, work=work):
        print(sentence)
    return PROVED


def _pose_sets(target: Path, work: int) -> int:
    from .sight import check_pose_set, check_pose_sets

    found = check_pose_sets(target, work=work) if target.is_dir() else [check_pose_set(target, work=work or WORK)]
    for one in found:
        radii = "no pose" if one.radii is None else f"position and rotation +-{[-_down(-v) for v in one.radii]}"
        print(f"{one.name}: {f'REFUSED: {one.refused}' if one.refused else f'PROVED: {radii}, {one.digest[:16]}'}")
    return REFUSED if any(one.refused for one in found) else PROVED


def stated(accepted: Accepted) -> str:
    """The claims, in numbers that lie on the safe side of what is proved."""
    claims, out = accepted.claims, []
    if claims.infeasible:
        out.append("no solution" + ("" if claims.cap is None else f" up to {_down(claims.cap)}"))
    elif claims.eps_lo is not None:
        out.append(f"eps >= {_down(claims.eps_lo)}")
    if claims.eps_hi is not None:
        out.append(f"eps <= {-_down(-claims.eps_hi)}")
    if claims.point is not None:
        holds, fails = len(claims.point.holds), len(claims.point.fails)
        out.append(f"the point satisfies {holds} of {accepted.count}, fails {fails}")
    if claims.enclosure is not None:
        out.append("the enclosure holds all solutions")
    return "; ".join(out) or "nothing is claimed"


def _down(value: F) -> float:
    """Cut to nine decimals, downward."""
    return (value * 10**9).__floor__() / 10**9
