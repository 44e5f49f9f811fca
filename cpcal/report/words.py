"""What a result says, in sentences, and what to do about a leg. The quantifier is part of every answer."""

import math
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import CpcalError
from cpcal.common.numbers import about, at_least, at_most, stated
from cpcal.common.values import Bools, Floats, Places, floats
from cpcal.models import PLAIN, LegModel, ModelResiduals, fit_model, leg_model
from cpcal.questions import LegResult, Result, Uncertified, status_of, verdict_of
from cpcal.questions.verdict import plain_side
from cpcal.report.section import Mark, Words, verdict
from cpcal.robot import Campaign

QUANTIFIER = (
    "To explain the data, or satisfy the equations, to within eps means: for every measurement there exists a reading "
    "in its set at which the leg equation is off by at most eps."
)
LONGER = "The model takes each leg to be longer than eps."
SHORT_QUANTIFIER = (
    "Fails: whatever the readings are, no parameters do. Passes: the recommended parameters do for all readings."
)
FRAME = (
    "a: base joint centre, in the base frame of the campaign's poses; b: mobile joint centre, in their mobile frame; "
    "l: length offset."
)


class Overall(NamedTuple):
    """The verdict on the robot: its `kind` is that of a leg's verdict."""

    kind: str
    word: str


def overall(result: Result) -> Overall | None:
    """Pass or fail of all legs together; None where no tolerance was given."""
    if result.options.tolerance is None or not result.legs:
        return None
    verdicts = [verdict_of(result, leg) for leg in result.legs]
    if any(verdict.kind == "unexplained" for verdict in verdicts):
        return Overall("unexplained", "FAIL")
    if all(verdict.passes for verdict in verdicts) and not result.interrupted:
        return Overall("explained", "PASS")
    return Overall("undecided", "UNDECIDED")


def leg_sentence(result: Result, leg: LegResult) -> str:
    """The answer for one leg, without its number: the verdict, what was proved, and whether that can be checked."""
    verdict = verdict_of(result, leg)
    said = [verdict.sentence]
    if verdict.kind != "undetermined":
        said.append(status_of(result, leg))
    if leg.not_certified:
        said.append(f"Not certified: {leg.not_certified}.")
    return " ".join(said)


def claim(
    words: Words, what: str, leg: LegResult | None = None, value: float | str | None = None, parameter: str = ""
) -> Mark:
    """Words that state what a certificate claims, exactly `value`: the page compares them."""
    data = {} if leg is None else {"leg": str(leg.leg)}
    data["claim"] = what
    if parameter:
        data["parameter"] = parameter
    if value is not None:
        data["value"] = value.hex() if isinstance(value, float) else value
    return Mark(words, data=data)


def claimed_by(certificate: str | None, words: str, *what: Any) -> Words:
    """The words as a claim where a certificate holds it, else plain."""
    return words if certificate is None else claim(words, *what)


def badge(result: Result, leg: LegResult) -> Mark:
    found, asked = verdict_of(result, leg), result.options.tolerance
    return verdict(
        found.word, found.kind, leg=str(leg.leg), claim="verdict", value="" if asked is None else asked.hex()
    )


def thresholds(result: Result, leg: LegResult) -> Words:
    """Below which tolerance the leg fails, from which on it passes: proved, with the digits that the verdict needs."""
    if result.options.eps is not None:
        return verdict_of(result, leg).sentence.removesuffix(".")
    lo, passes, asked = leg.bracket.lo, leg.passes_from, result.options.tolerance
    fails: Words = "Fits within the stated reading uncertainty"
    if math.isinf(lo):
        fails = "No parameters fit"
    elif lo > 0.0:
        fails = ("Fails below ", claim(plain_side(at_least, lo, asked), "eps_lo", leg, lo), " mm")
    if passes is None:
        return (fails, ", not shown to pass")
    return (
        fails,
        ", passes from ",
        claimed_by(passes.certificate, plain_side(at_most, passes.eps, asked), "passes.eps", leg, passes.eps),
        " mm",
    )


def leg_lines(result: Result, leg: LegResult, found: "Advice") -> Words:
    """A leg on the first screen: one line where it passes, else the culprit and the next step, and a second line."""
    reduced, left_out = leg.reduced, leg.bracket.left_out
    plain = result.options.tolerance is None and verdict_of(result, leg).kind in ("bounded", "explained")
    head: list[Words] = [Mark(f"Leg {leg.leg}", "leg", f"#leg-{leg.leg}"), ": "]
    head += [] if plain else [badge(result, leg)]
    head += [" without measurement ", claim(", ".join(left_out), "left_out", leg)] if left_out else []
    limits = thresholds(result, leg)
    if not found.short:
        return (head, ". " if len(head) > 2 else "", limits, ".")
    second: Words = (limits, ". ", found.more)
    if reduced is not None and reduced.factor > 0.0:
        factor = claimed_by(reduced.certificate, at_least(reduced.factor), "reduced.factor", leg, reduced.factor)
        second = (second, "Pass with ", factor, " times the stated uncertainty.")
    elif reduced is not None and leg.bracket.lo > 0.0:
        second = (second, " The best of sensors would not help.")
    first = found.short.removeprefix("because of ") if plain else f" {found.short}"
    return (head, first, ".", Mark(second, "second"))


def notices(result: Result, legs: int) -> str:
    """What stands above all answers: sentences on a user-defined model, on an interrupted run, and on legs of so many
    that nothing was asked of; empty where there is nothing to say."""
    done, every = {leg.leg for leg in result.legs}, range(1, legs + 1)
    asked = result.options.legs or every
    said = [result.model.not_compared] * bool(result.model.not_compared)
    if result.interrupted:
        said.append("Interrupted: what is shown was proved until then.")
        missing = ", ".join(str(leg) for leg in asked if leg not in done)
        said += [f"There is nothing on leg {missing}."] if missing else []
    others = ", ".join(str(leg) for leg in every if leg not in asked)
    said += [f"Not asked about, and not judged: leg {others}."] if others else []
    return " ".join(said)


def uncertified_legs(result: Result) -> str:
    """A sentence on the legs whose certificate was asked for and is missing, and why; empty where there is none."""
    without = [leg for leg in result.legs if not leg.certified and leg.not_certified is not Uncertified.NOT_ASKED]
    each = ", ".join(f"leg {leg.leg} ({leg.not_certified})" for leg in without)
    return f"Not certified: {each}." if without else ""


# ------------------------------------------------------------------------------------------------------------------
# What a result rests on, in words: the model, the box, the reading sets.

_CENTERS = {
    "fit": "the leg's least-squares fit",
    "plain": "the leg's least-squares fit of the plain model",
    "nominal": "the nominal parameters in the campaign",
}


def assumptions(campaign: Campaign, result: Result) -> dict[str, str]:
    """Paragraphs by their headings."""
    asked = result.options
    center = _CENTERS.get(asked.center, "the center listed with it")
    extra = ", ".join(f"{p.name} within ±{stated(p.half_width)} {p.unit}" for p in result.model.extra)
    return {
        "Model": _model(result),
        "Reading sets": _readings(campaign),
        "Parameters": (
            f"{FRAME} Each of the seven parameters of a leg is looked for within ±{stated(asked.delta)} mm of "
            f"{center}{f', and the extra parameters about 0: {extra}' if extra else ''}. Nothing is said of parameters "
            "outside this box."
        ),
        "Arithmetic": (
            f"Every bound is derived in outward-rounded arithmetic by the contractors "
            f"{', '.join(asked.contractors)}; no answer of a linear-programming solver is trusted. Lower bounds are "
            "printed rounded down and upper bounds rounded up. Figures are drawn in plain floating point."
        ),
    }


def _model(result: Result) -> str:
    if result.model.not_compared:  # no formula is known to be its own
        return f"{result.model.not_compared} Its error eps is how far they are from being met, in mm. {LONGER}"
    if result.model.name == PLAIN.name:
        said = (
            "A leg with base joint centre a, mobile joint centre b and length offset l satisfies "
            "‖P + R b − a‖ = L + l at every pose (P, R) and reading L."
        )
    else:
        said = (
            f"{result.model.name}: with v = P + R b − a, the vector from a leg's base joint centre a to its mobile one "
            f"b, the length ‖v‖ is {result.model.summary}."
        )
    return f"{said} Its error eps is the largest difference of the two sides, in mm. {LONGER}"


def _readings(campaign: Campaign) -> str:
    if campaign.exact:
        return "Every reading (position, rotation, length) is taken as exact: each set is one point."
    radii = campaign.position_radius, campaign.rotation_radius, campaign.length_radius
    position, rotation, length = (
        ", ".join(
            about(lo) if lo == hi else f"{about(lo)} to {about(hi)}"
            for lo, hi in zip(of.min(axis=0), of.max(axis=0), strict=True)
        )
        for of in radii
    )
    sets = campaign.uncertainty
    how = "" if sets is None or sets.factor is None else f", which are {stated(sets.factor)} stated standard deviations"
    return (
        f"Position: the stated one ± ({position}) mm in x, y, z. Rotation: the stated one turned by a "
        f"rotation vector within ± ({rotation}) rad in the base frame. Leg lengths: the stated ones "
        f"± ({length}) mm, leg by leg. (Rounded here; the campaign has the exact half-widths{how}.)"
    )


# ------------------------------------------------------------------------------------------------------------------
# The least-squares fit of a leg, which stands beside what was proved, and what to do: which measurements to look at
# first, and the next step. Estimates in floating point: help for a person, no proof.


class Fitted(NamedTuple):
    """Its parameters (n,), residuals (N,) in mm at the centres of the reading sets, and their Jacobian (N, n)."""

    x: Floats
    residuals: Floats
    jacobian: Floats


def fitted(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> Fitted:
    """The fit that was the center of the box, or else one made now."""
    known = result.options.center == "fit"
    x = np.array(leg.center) if known else fit_model(campaign, leg.leg, model)
    with np.errstate(all="ignore"):  # the center of a damaged result may be anywhere
        of = ModelResiduals(campaign, leg.leg, model)
        return Fitted(x, np.nan_to_num(of.values(x)), np.nan_to_num(of.jacobian(x)))


_MOST_WRONG = 3  # measurements that are named as wrong readings
_CHANCE = 2e-3  # that one is named among normal errors
_FREEDOM = 3  # measurements more than parameters that a test of one needs
_OTHER_MODELS = ("gain", "lateral")  # the simplest first
_HELPS = 0.6  # another model is named when its largest residual is below this share of the model's own
_STEPS_OF_A_FIT = 3
_SURELY = 1.5  # times that share: a fit is not gone on with when its linearised equations leave more
_NEARLY = 1.3  # times the best: a simpler model is as good


class Advice(NamedTuple):
    """The cause and the next step, `short`, and `more`. `wrong`: measurements from 0 that look like misreadings."""

    short: str
    fit: Fitted
    more: str = ""
    wrong: Places = ()


def advise(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> Advice:
    """`model`: the result's."""
    verdict, found = verdict_of(result, leg), fitted(campaign, result, leg, model)
    kind, reduced = verdict.kind, leg.reduced
    short, more, wrong = "", "", Places()
    uncertain = "because the readings are too uncertain: measure them more precisely"
    if kind == "uncompared":
        short, more = "compare the constraints", "No program has compared those of the certificates with the model."
    elif kind == "undetermined":
        short = "because poses are too few or too similar: add poses"
        more = verdict.reason + f" Add poses that show {', '.join(verdict.names)}." * bool(verdict.names)
    elif kind == "undecided" and reduced is None:
        short = "because a limit came first: give it a longer --time-limit"
    elif kind == "undecided" and reduced is not None and reduced.factor > 0.0:
        short = uncertain
    elif kind != "explained":
        largest = float(np.max(np.abs(found.residuals)))
        wrong = misread(found, np.isin(campaign.measurement_ids, leg.bracket.left_out, invert=True))
        if wrong:
            again = ", ".join(str(k + 1) for k in wrong)
            it, plural = ("it", "") if len(wrong) == 1 else ("them", "s")
            left = _linear_fit(*(np.delete(v, wrong, axis=0) for v in (found.jacobian, found.residuals)))[1]
            ids = ", ".join(campaign.measurement_ids[k] for k in wrong)
            short = f"because of measurement{plural} {again}: measure {it} again"
            more = f"Without {ids} least squares leaves {about(left)} mm at most, not {about(largest)} mm."
        elif kind != "bounded":
            if (other := _another_model(campaign, leg, model, found.x, largest)) is not None:
                short = f"because of the leg model: use --model {other[0]}"
                more = f"Its least squares leaves {about(other[1])} mm at most, this one's {about(largest)} mm."
            elif leg.bracket.lo == 0.0:  # no error of the leg is proved
                short = uncertain
            else:
                short = "by many measurements alike: look for play, sag, or joints off axis"
                more = "No other leg model helps."
    return Advice(short, found, more, wrong)


def misread(found: Fitted, used: Bools) -> Places:
    """Measurements that the others contradict: studentised residuals from a fit without them, beyond chance in all.

    The first one to leave is the one that stands out most; of so many as leave all must stand out against the rest.
    """
    left, out = used.copy(), list[int]()
    named: Places = ()
    for _ in range(_MOST_WRONG + 1):
        freedom = int(left.sum()) - found.jacobian.shape[1]
        if freedom < _FREEDOM:
            break
        rows = found.jacobian[left]
        step = np.linalg.lstsq(rows, -found.residuals[left], rcond=1e-12)[0]
        rest = found.residuals + found.jacobian @ step
        spread = np.einsum("ij,ji->i", found.jacobian, np.linalg.pinv(rows.T @ rows, rcond=1e-12) @ found.jacobian.T)
        scale = max(float(np.sum(rest[left] ** 2)), 1e-300)
        seen = np.abs(rest) / np.sqrt(scale / freedom * (1.0 + spread))
        if out and np.all(seen[out] > student(1.0 - _CHANCE / len(used), freedom)):
            named = tuple(out)
        # inside the fit: its share of the sum of squares leaves with it
        inside = np.where(left, rest**2 / np.maximum(1.0 - spread, 1e-9), -1.0)
        out.append(int(np.argmax(inside)))
        left[out[-1]] = False
    return named


def student(chance: float, freedom: int) -> float:
    """The quantile of Student's t, to 5 %: Gaver and Kafadar, The American Statistician 38 (1984). SciPy's takes a
    tenth of a second to load."""
    normal = NormalDist().inv_cdf(chance)
    return math.sqrt(freedom * math.expm1(normal**2 * (freedom - 1.5) / (freedom - 1.0) ** 2))


def _linear_fit(rows: Floats, values: Floats) -> tuple[Floats, float]:
    """The step of least squares from linearised equations, and the largest residual that it leaves."""
    step = floats(np.linalg.lstsq(rows, -values, rcond=1e-12)[0])
    return step, float(np.max(np.abs(values + rows @ step)))


def _another_model(
    campaign: Campaign, leg: LegResult, model: LegModel, fit: Floats, own: float
) -> tuple[str, float] | None:
    """The simplest model whose fit, a few steps from the plain one's, leaves much less than its `own`, and what."""
    if model.name != PLAIN.name or len(campaign) < 2 * len(PLAIN.parameters):
        return None
    largest = {}
    for name in _OTHER_MODELS:
        other = leg_model(name)
        x = np.append(fit, np.zeros(len(other.extra)))
        try:
            residuals = ModelResiduals(campaign, leg.leg, other)
            for _ in range(_STEPS_OF_A_FIT):
                with np.errstate(all="ignore"):  # a damaged result may be anywhere
                    step, largest[name] = _linear_fit(residuals.jacobian(x), residuals.values(x))
                if largest[name] > _SURELY * _HELPS * own:
                    break
                x += step
        except (CpcalError, ValueError, np.linalg.LinAlgError):  # a fit that does not exist helps nobody
            largest.pop(name, None)
    best = min(largest.values(), default=math.inf)
    if not best < _HELPS * own:
        return None
    return next((name, most) for name, most in largest.items() if most <= _NEARLY * best)
