"""`python -m cpcal.checker RUN`, or the folder itself: `python -I -S checker RUN`. The standard library is enough.

Exit status: 0 proved, 1 refused, 2 nothing to check, 3 an error of the checker.
"""

import argparse
import gc
import importlib.util
import sys
import traceback
from collections.abc import Iterator, Sequence
from fractions import Fraction as F
from pathlib import Path

if not __package__:  # the folder was run, wherever it was copied: what lies beside it is none of our business
    folder = Path(__file__).resolve().parent
    del sys.path[0]
    spec = importlib.util.spec_from_file_location("checker", folder / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    sys.modules["checker"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["checker"])
    __package__ = "checker"

from .certificate import Accepted, check
from .files import HAND_EYE_NAME, KINDS, POSE_SET_SUFFIX, WORK
from .readers import Refused, Unusable, shown
from .run import RESULT_NAME, RobustChecked, check_kind, check_run, head_of

PROVED, REFUSED, UNUSABLE, INTERNAL = 0, 1, 2, 3
_NOT_JUDGED, _COMPUTES = "Not judged here:", "`cpcal verify` computes that"


def main(arguments: Sequence[str]) -> int:
    """Check a run, or one certificate of it; the exit status."""
    parser = argparse.ArgumentParser("checker", description="Check the certificates of a run in exact arithmetic.")
    parser.add_argument("target", type=Path, help="the folder of a run, or a certificate (*.cert.jsonl)")
    parser.add_argument("--campaign", type=Path, help="the campaign.json that a certificate speaks of")
    parser.add_argument(
        "--work", type=int, default=0, help="what the check may cost, in tenths of a microsecond, about"
    )
    given, good = parser.parse_args(arguments), True
    try:
        for accepted, sentence in _statements(given.target, given.campaign, given.work or 0):
            print(sentence)
            good = good and accepted
        return PROVED if good else REFUSED
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


def _statements(target: Path, campaign: Path | None, work: int) -> Iterator[tuple[bool, str]]:
    """Sentences, and whether each is accepted; of the folder of several runs the worst decides."""
    if target.name.endswith(POSE_SET_SUFFIX) or any(target.glob("*" + POSE_SET_SUFFIX)):
        from .sight import check_pose_set, check_pose_sets

        for one in (
            check_pose_sets(target, work=work) if target.is_dir() else [check_pose_set(target, work=work or WORK)]
        ):
            radii = "no pose" if one.radii is None else f"position and rotation +-{[-_down(-v) for v in one.radii]}"
            said = f"REFUSED: {one.refused}" if one.refused else f"PROVED: {radii}, {one.digest[:16]}"
            yield not one.refused, f"{one.name}: {said}"
    elif (head := head_of(target)) == RESULT_NAME:
        yield from _legs(target, work)
    elif head:
        yield from check_kind(target, head, work=work)
        if head == HAND_EYE_NAME:
            yield True, f"{_NOT_JUDGED} whether the centre of the box is the least-squares answer; {_COMPUTES}."
    elif not target.is_dir():
        yield True, f"PROVED: {stated(check(target, campaign, work=work or WORK))}"
    else:
        found = (path.parent for name in (RESULT_NAME, *KINDS) for path in target.glob(f"[!.]*/{name}"))
        inner = sorted(set(found))  # no draft of a run that was killed
        if not inner:
            raise Unusable(f"{shown(target.name)} holds no run")
        for run in inner:
            yield True, f"{run.name}:"
            try:
                yield from _statements(run, None, work)
            except Refused as reason:
                yield False, f"REFUSED: {reason}"


def _legs(run: Path, work: int) -> Iterator[tuple[bool, str]]:
    legs = check_run(run, work=work)
    for leg in legs:
        claims = [f"{name}: {stated(accepted)}" for name, accepted in leg.proofs]
        claims = claims if leg.robust is None else [_outliers(leg.robust), *claims]
        said = f"PROVED: {'; '.join(claims)}" if claims else "not certified"
        yield leg.refused is None, f"leg {leg.leg}: {said if leg.refused is None else f'REFUSED: {leg.refused}'}"
    yield True, f"{_NOT_JUDGED} whether the measurements determine the parameters; {_COMPUTES} again."
    if not any(leg.refused is not None or leg.proofs or leg.robust for leg in legs):
        raise Unusable("no leg of the run is certified")


def _outliers(leg: RobustChecked) -> str:
    """Of a leg of whose measurements some may be wrong."""
    found = [] if leg.lo is None else [f"eps >= {_down(leg.lo)}"]
    found += [] if leg.hi is None else [f"eps <= {-_down(-leg.hi)} without {', '.join(leg.left_out) or 'none'}"]
    return "; ".join([*found, f"at most {leg.outliers} wrong"])


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
        (*_, eps), holds, fails = claims.point.at, len(claims.point.holds), len(claims.point.fails)
        said = f"the point satisfies {holds} of {accepted.count}, fails {fails}"
        if claims.point.factor is not None:
            part = "" if claims.point.factor == 1 else f" of {_down(claims.point.factor)} of the half-widths"
            said = f"the point satisfies {holds} of {accepted.count} to within {-_down(-eps)} for all readings{part}"
        out.append(said)
    if claims.enclosure is not None:
        out.append("the enclosure holds all solutions")
    return "; ".join(out) or "nothing is claimed"


def _down(value: F) -> float:
    """Cut to nine decimals, downward."""
    return (value * 10**9).__floor__() / 10**9


if __name__ == "__main__":
    gc.set_threshold(50_000)  # numbers are no garbage: to look through them takes time
    sys.exit(main(sys.argv[1:]))
