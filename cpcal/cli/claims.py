"""What an accepted certificate proves, in sentences: every number is rounded to the side that stays proved."""

from collections.abc import Callable
from fractions import Fraction as F

from cpcal.checker import Accepted
from cpcal.common.errors import InputError, printable
from cpcal.common.numbers import at_least, at_most, bracket_text, gap_text, short

Statement = tuple[bool, str]  # whether it is accepted, and a sentence

VACUOUS = "PROVED, which says nothing"  # of a claim that holds of every leg


def told(name: str, accepted: Accepted | str) -> Statement:
    """What a certificate proves, and how much work the check was; or why it is refused."""
    if isinstance(accepted, str):
        return False, f"{name}: REFUSED, {accepted}"
    said, every = sentences(accepted), len(accepted.chosen) == accepted.count
    if not said:
        return True, f"{name}: {VACUOUS}"
    of = f"points that satisfy all {accepted.count} constraints"
    if accepted.leg is not None:
        model = "" if accepted.model in (None, "plain") else f", model {printable(str(accepted.model))}"
        some = f"measurements {', '.join(str(k + 1) for k in accepted.chosen)}" if not every else ""
        of = f"leg {accepted.leg}{model}, {some or f'all {accepted.count} measurements'}"
    return True, f"{name}: {of}: {'; '.join(said)}: PROVED, {accepted.steps} steps"


def sentences(accepted: Accepted) -> list[str]:
    """One for each claim that says something: absence is stated of the certificate's box."""
    claims, cap = accepted.claims, accepted.claims.cap
    is_leg = accepted.leg is not None
    name = "|g|" if is_leg else "" if accepted.objective is None else printable(accepted.unknowns[accepted.objective])
    unit, whatever, some = (" mm", ", whatever the readings", ", for some readings") if is_leg else ("", "", "")

    def goal(sign: str, value: F | None, text: Callable[..., str] = at_least) -> str:
        """What none reaches; or what is reached, which is rounded up."""
        return "" if value is None or not name else f" with {name} {sign} {short(text(value, 7))}{unit}"

    out = []
    if claims.infeasible:
        out.append(f"none in the box{goal('<=', cap)}{whatever}")
    elif claims.eps_lo:
        out.append(f"none in the box{goal('<', claims.eps_lo)}{whatever}")
    if claims.eps_hi is not None:
        out.append(f"some in the box{goal('<=', claims.eps_hi, at_most)}{some}")
    elif (point := claims.point) is not None:
        if point.factor is not None:
            times = f" with {short(at_least(point.factor, 7))} times the half-widths" * (point.factor != 1)
            some = f", for ALL readings{times}"
        eps = None if accepted.objective is None else point.at[accepted.objective]
        here, holds = f"{goal('<=', eps, at_most)}{some}", len(point.holds)
        out.append(
            f"the point given{here}"
            if point.holds == accepted.chosen
            else f"the point given holds at {holds} of {len(accepted.chosen)}{here}, and fails at {len(point.fails)}"
            f"{goal('<=', eps)}{whatever}"
        )
    if claims.enclosure is not None:
        reached = "" if cap is not None and cap == claims.eps_hi else goal("<=", cap)
        sides = [side for k, side in enumerate(zip(*claims.enclosure, strict=True)) if k != accepted.objective]
        lo, hi = max(sides[:7] if is_leg else sides, key=lambda side: side[1] - side[0], default=(F(0), F(0)))
        others = zip(map(printable, accepted.unknowns[7:-1]), sides[7:], strict=True) if is_leg else ()
        ranges = (f", {name} in [{', '.join(map(short, bracket_text(*side)))}]" for name, side in others)
        out.append(f"all{reached} within sides of {gap_text(lo, hi)}{unit}{''.join(ranges)}")
    return out


class NothingCertifiedError(InputError):
    """All that a run states is accepted, and none of it is certified."""
