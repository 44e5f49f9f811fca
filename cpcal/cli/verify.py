"""`cpcal verify`: runs and certificates checked again, in exact arithmetic and without a solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction as F
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpcal.checker import (
    POSE_SET_SUFFIX,
    RESULT_NAME,
    Accepted,
    LegChecked,
    Point,
    Refused,
    Unusable,
    check,
    leg_checks,
)
from cpcal.cli.options import Status, Talk, record
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.numbers import bracket_text, inner_text, nearest, plain_gap, short
from cpcal.files.run_folder import ACCURACY, COMPARED, FITTED, HANDEYE, HANDEYE_WRONG, RUN, unfinished
from cpcal.solver.execution.forked import side_by_side

if TYPE_CHECKING:
    from cpcal.questions import Result

# ------------------------------------------------------------------------------------------------------------------
# What an accepted certificate proves, in sentences; every number rounded to the side that stays proved.

Hull = tuple[tuple[F, ...], tuple[F, ...]]


def tell(talk: Talk, name: str, accepted: Accepted, seconds: float | None = None) -> None:
    """Say what a certificate proves, and how much work the check was."""
    work = f"{accepted.steps} steps" + ("" if seconds is None else f", {nearest(seconds, 1)} s")
    for sentence in sentences(accepted):
        talk.say(f"{name}: {sentence}: PROVED, {work}")


def sentences(accepted: Accepted) -> list[str]:
    """One for each claim."""
    claims = accepted.claims
    words = _LegWords(accepted) if accepted.leg is not None else _NetworkWords(accepted)
    out = []
    if claims.infeasible:
        out.append(words.infeasible(claims.cap))
    elif claims.eps_lo is not None:
        out.append(words.none_below(claims.eps_lo))
    if claims.eps_hi is not None:
        out.append(words.attained(claims.eps_hi))
    elif claims.point is not None:
        out.append(words.verified(claims.point))
    if claims.enclosure is not None:
        out.append(words.enclosed(claims.cap, claims.enclosure))
    return out


class _NetworkWords:
    """Absence is stated of a part of the box at most, existence of all of it, whatever the rounding."""

    thing = every = "point of the box"
    for_any = for_some = longer = ""

    def __init__(self, accepted: Accepted) -> None:
        self.accepted = accepted
        self.all = f"all {accepted.count} constraints"
        objective = accepted.objective
        self.name = "" if objective is None else printable(accepted.unknowns[objective])
        self.unit = ""

    def down(self, sign: str, value: F | None) -> str:
        """A goal that none reaches, or that all who reach it share something."""
        if value is None:
            return ""
        hi = self.accepted.claims.eps_hi  # the digits are those of the bracket, as in the table of a result
        text = short(bracket_text(value, value)[0]) if hi is None else bracket_text(value, hi)[0]
        return self._goal(sign, text)

    def up(self, value: F | None) -> str:
        """A goal that is reached."""
        return "" if value is None else self._goal("<=", bracket_text(value, value)[1])

    def _goal(self, sign: str, text: str) -> str:
        return f" with {self.name} {sign} {text}{self.unit}" if self.name else ""

    def infeasible(self, cap: F | None) -> str:
        return f"No {self.thing} satisfies {self.all}{self.down('<=', cap)}{self.for_any}"

    def none_below(self, lo: F) -> str:
        return f"No {self.thing} satisfies {self.all}{self.down('<', lo)}{self.for_any}"

    def attained(self, hi: F) -> str:
        return f"Some {self.every} satisfies {self.all}{self.up(hi)}{self.for_some}"

    def verified(self, point: Point) -> str:
        objective = self.accepted.objective
        eps = None if objective is None else point.at[objective]
        if point.holds == self.accepted.chosen:
            return f"The point given satisfies {self.all}{self.up(eps)}{self.for_some}"
        return (
            f"Of {self.all} the point given satisfies {len(point.holds)}{self.up(eps)}{self.for_some}, "
            f"and it fails {len(point.fails)}{self.down('<=', eps)}{self.for_any}"
        )

    def enclosed(self, cap: F | None, hull: Hull) -> str:
        shared = cap is not None and cap == self.accepted.claims.eps_hi
        goal = " as well as that one" if shared else self.down("<=", cap)
        lo, hi = max(self.sides(hull), key=lambda side: side[1] - side[0], default=(F(0), F(0)))
        return (
            f"Every {self.every} that satisfies them{goal}{self.for_some}{self.longer} lies in the enclosure, "
            f"whose sides are at most {plain_gap(lo, hi)}{self.unit} long{self.others(hull)}"
        )

    def sides(self, hull: Hull) -> list[tuple[F, F]]:
        """Of the enclosure, but for the objective."""
        return [side for k, side in enumerate(zip(*hull, strict=True)) if k != self.accepted.objective]

    def others(self, hull: Hull) -> str:
        """The ranges of unknowns that are no lengths."""
        return ""


class _LegWords(_NetworkWords):
    for_any = " for any readings in their sets, with legs longer than that"
    for_some = " for some readings in their sets"
    longer = ", with legs longer than that,"
    every = "x of the certificate's box"

    def __init__(self, accepted: Accepted) -> None:
        super().__init__(accepted)
        self.name, self.unit = "|g|", " mm"
        count, chosen = accepted.count, accepted.chosen
        leg = f"of leg {accepted.leg}"
        if accepted.model not in (None, "plain"):
            leg += f" in the {printable(str(accepted.model))} model"
        self.all = (
            f"all {count} equations {leg}"
            if len(chosen) == count
            else f"the equations {leg} for measurements {', '.join(map(str, chosen))} (from 0)"
        )
        self.thing = self._ranges() or self.every

    def _ranges(self) -> str | None:
        """The box of all unknowns but the objective, rounded inward; None where nothing would be left of a side."""
        of = self.accepted
        inner = [inner_text(lo, hi) for lo, hi in zip(of.lo[:-1], of.hi[:-1], strict=True)]
        if any(F(lo) > F(hi) for lo, hi in inner):
            return None
        names = map(printable, of.unknowns[:-1])
        return f"x with {', '.join(f'{name} in {_range(side)}' for name, side in zip(names, inner, strict=True))}"

    def sides(self, hull: Hull) -> list[tuple[F, F]]:
        return super().sides(hull)[:7]

    def others(self, hull: Hull) -> str:
        extra = [printable(name) for name in self.accepted.unknowns[7:-1]]
        return "".join(
            f", {name} in {_range(bracket_text(*side))}"
            for name, side in zip(extra, super().sides(hull)[7:], strict=True)
        )


def _range(texts: tuple[str, str]) -> str:
    return f"[{', '.join(map(short, texts))}]"


# ------------------------------------------------------------------------------------------------------------------
# Runs and certificates, checked again by the exact checker, and what it raises in the words of the command line.

Legs = list[LegChecked] | str  # or why the run is refused as a whole


@contextmanager
def legs_beside(run: Path) -> Iterator[Callable[[], Legs]]:
    """The legs of a run are checked, on all processors, while in the block; what is given waits for what is found.

    It raises InputError where there is nothing to check.
    """
    try:
        checks = leg_checks(run)
    except Refused as reason:
        refused = str(reason)
        yield lambda: refused
        return
    except Unusable as reason:
        unusable = InputError([Problem(str(run), str(reason), "name the folder of a run")])

        def refuse() -> Legs:
            raise unusable

        yield refuse
        return
    with side_by_side(checks) as answers:
        yield answers


def checked_legs(run: Path) -> Legs:
    """The legs of a run. Raises InputError where there is nothing to check."""
    with legs_beside(run) as legs:
        return legs()


def result_of(run: Path) -> Result | str:
    """What the result.json of a run states, or why it is none. Raises InputError where there is no such file."""
    from cpcal.questions import load_result

    try:
        return load_result(run)
    except InputError as error:
        if not (run / RESULT_NAME).is_file():
            raise
        return "; ".join(problem.what for problem in error.problems)


def checked_certificate(path: Path) -> Accepted | str:
    """What a certificate proves, or why it is refused. Raises InputError where there is nothing to check."""
    try:
        return check(path)
    except Refused as reason:
        return str(reason)
    except Unusable as reason:
        raise InputError([Problem(str(path), str(reason), "name the folder of a run, or a certificate")]) from None


def check_all(certificates: Iterable[Path]) -> tuple[bool, str]:
    """Whether all certificates are accepted, each for the campaign.json beside it, and a sentence."""
    steps, files = 0, list(certificates)
    refused = []
    for path in files:
        try:
            steps += check(path).steps
        except (Refused, Unusable) as reason:
            refused.append(f"{path.name} ({reason})")
    of = f"{len(files)} certificates"
    if refused:
        return False, f"Of {of} the checker REFUSED {len(refused)}: {'; '.join(refused)}."
    return True, f"The checker accepted all {of} (exact arithmetic, no solver): {steps:,} steps."


KINDS = (RUN, COMPARED, FITTED, ACCURACY, HANDEYE, HANDEYE_WRONG)  # of folders with certificates


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
) -> Status:
    """Check a RUN, or one CERTIFICATE, against the campaign.json beside the certificates.

    A hand-eye run is checked likewise against the study that it holds, pose sets from their pixels on.

    Every number that the run's result.json states must be claimed by a certificate, and every certificate must be
    accepted; a leg that is not certified is named. The checker forms every polynomial again from the campaign's
    numbers, or from the constraints that the certificate states, in exact rational arithmetic; it uses no solver and no
    rounding. docs/certificate-format.md says what a certificate claims and when it is accepted.
    """
    same = campaign is None or _same_campaign(target, campaign, talk)
    if target.name.endswith(POSE_SET_SUFFIX) or (target.is_dir() and any(target.glob("*" + POSE_SET_SUFFIX))):
        from cpcal.cli.verified import verify_pose_sets

        accepted = verify_pose_sets(target, source or [], talk)
    else:
        accepted = _verified(target, talk) if target.is_dir() else _certificate(target, talk) is not None
    record("verified", target=str(target), accepted=bool(accepted and same))
    return Status.ANSWERED if accepted and same else Status.UNKNOWN


def _verified(folder: Path, talk: Talk) -> bool:
    """A folder, by what it holds; what other verbs write is loaded where it is found."""
    heads = [kind.head for kind in KINDS if (folder / kind.head).exists()]
    if len(heads) > 1:
        talk.say(
            f"{folder.name}: REFUSED, {' and '.join(heads)} are the answers of two commands, which share no folder"
        )
        return False
    if heads == [HANDEYE.head]:
        from cpcal.handeye.verify import verify_hand_eye

        return _all_accepted(verify_hand_eye(folder), talk)
    if heads == [HANDEYE_WRONG.head]:
        from cpcal.handeye.verify import verify_wrong_images

        return _all_accepted(verify_wrong_images(folder), talk)
    if heads == [RUN.head]:
        with legs_beside(folder) as legs:
            from cpcal.cli.verified import run_verified  # while the legs are being checked

            return run_verified(folder, legs, talk)
    from cpcal.cli import verified

    if not heads and any(folder.glob(f"*/{RUN.head}")):
        return verified.campaigns_verified(folder, lambda run: _verified(run, talk), talk)
    claimed = {path.name: _certificate(path, talk) for path in _certificates(folder, heads)}
    proved = {name: accepted for name, accepted in claimed.items() if accepted is not None}
    return verified.others_verified(folder, proved, talk) and len(proved) == len(claimed)


def _same_campaign(target: Path, campaign: Path, talk: Talk) -> bool:
    """Whether the run's campaign, or hand-eye study, is the one in the folder. Raises InputError."""
    if any((target / kind.head).exists() for kind in (HANDEYE, HANDEYE_WRONG)):
        from cpcal.handeye.files import load_hand_eye

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
