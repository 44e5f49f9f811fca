"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cpcal import plugins
from cpcal.calibration import PARAMETERS, least_squares, leg_box, leg_network, solves_exactly
from cpcal.errors import InputError, Problem
from cpcal.interfaces import Limits, Verdict
from cpcal.interval import Arithmetic, get_arithmetic
from cpcal.network import ConstraintNetwork
from cpcal.optimize import Bracket, Minimum, irreducible, minimize, run
from cpcal.optimize import support as find_support
from cpcal.result import LegResult, Result
from cpcal.robot import Campaign
from cpcal.version import __version__

Floats = npt.NDArray[np.float64]
Progress = Callable[[int, Bracket], None]

CENTERS = ("fit", "nominal")
SUPPORTS = ("few", "irreducible")

_SUPPORT_NODES = (
    3  # at most for each proof that a few measurements suffice: a convenience must not cost more than the answer
)


def certify(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    gap: float = 1e-6,
    time_limit: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
    eps: float | None = None,
    support: str = "few",
    progress: Progress | None = None,
) -> Result:
    """For every leg the smallest eps for which some x satisfies all N equations, bracketed by proofs.

    "Satisfies" means: for every measurement THERE EXISTS a reading in its set with `|g(x, M_k)| <= eps`.
    x ranges over all parameters within `delta` mm of the center: "fit" (least squares) or "nominal". `legs` counts
    from 1 (default: all). `gap` is relative, `time_limit` in seconds per leg. With `eps` (mm) the question is instead
    whether S(eps) is empty. `progress` is called with (leg, Bracket) as the brackets shrink.

    `support` "irreducible" leaves out of each leg's support every measurement that the proof can do without; "few" does
    not try.

    Ctrl-C ends it with what is proved so far. Raises InputError, PluginError.
    """
    _check(campaign, legs, delta, center, gap, time_limit, eps)
    if support not in SUPPORTS:
        raise InputError([Problem("support", f"{support!r} is not known", f"use one of {', '.join(SUPPORTS)}")])
    engine = get_arithmetic(arithmetic)
    for name in contractors:
        plugins.load(name)
    done: list[LegResult] = []
    interrupted = False
    for leg in legs or range(1, campaign.legs + 1):
        limits = Limits(seconds=time_limit, gap=gap)
        try:
            middle = least_squares(campaign, leg) if center == "fit" else _nominal(campaign, leg)
            found, interrupted = _one_leg(
                campaign,
                leg,
                middle,
                delta,
                tuple(contractors),
                engine,
                eps,
                limits,
                support == "irreducible",
                progress,
            )
        except KeyboardInterrupt:
            interrupted = True
            break
        done.append(found)
        if interrupted:
            break
    return Result(
        campaign.robot.name,
        campaign.sha256,
        len(campaign),
        PARAMETERS,
        delta,
        center,
        gap,
        eps,
        tuple(contractors),
        arithmetic,
        __version__,
        tuple(done),
        interrupted,
    )


def _nominal(campaign: Campaign, leg: int) -> Floats:
    robot, k = campaign.robot, leg - 1
    return np.concatenate([robot.base[k], robot.mobile[k], [robot.offset[k]]])


def _one_leg(
    campaign: Campaign,
    leg: int,
    middle: Floats,
    delta: float,
    contractors: tuple[str, ...],
    engine: Arithmetic,
    eps: float | None,
    limits: Limits,
    fewest: bool,
    progress: Progress | None,
) -> tuple[LegResult, bool]:
    """The result of one leg, and whether the user interrupted it."""
    box = leg_box(middle, delta)
    # A leg is longer than eps, which bounds eps.
    longest = float(np.nextafter(np.min(campaign.length[:, leg - 1]) + box.hi[6], np.inf))
    domain = (0.0, max(longest, 0.0)) if eps is None else (eps, eps)
    network = leg_network(campaign, leg, box, engine=engine, eps=domain)
    start = np.append(middle, 0.0 if eps is None else eps)

    def solve(net: ConstraintNetwork, limits: Limits, tell: Callable[[Bracket], None] | None) -> Minimum:
        contractor = plugins.build(net, contractors, objective="eps", arithmetic=engine.name)
        return run(minimize(net, "eps", contractor, engine=engine, limits=limits, start=start), tell)

    found = solve(network, limits, None if progress is None else lambda bracket: progress(leg, bracket))
    short = replace(limits, nodes=_SUPPORT_NODES)
    few = find_support(network, "eps", found, limits.gap, lambda net: solve(net, short, None))
    if fewest:
        few = irreducible(network, found, few, limits.gap, lambda net: solve(net, short, None))
    return _leg_result(campaign, leg, middle, found, few, eps)


def _leg_result(
    campaign: Campaign, leg: int, middle: Floats, found: Minimum, few: tuple[int, ...], eps: float | None
) -> tuple[LegResult, bool]:
    ids, enclosure = campaign.measurement_ids, found.enclosure
    result = LegResult(
        leg,
        found.verdict,
        _sentence(campaign, leg, found, eps),
        found.lo,
        found.hi,
        None if found.witness is None else tuple(float(v) for v in found.witness.point[:7]),
        tuple(float(v) for v in middle),
        type(enclosure)(PARAMETERS, enclosure.lo[:7], enclosure.hi[:7]),
        found.floor,
        tuple(ids[k] for k in few),
        found.nodes,
        found.programs,
        found.seconds,
    )
    return result, found.interrupted


def _sentence(campaign: Campaign, leg: int, found: Minimum, eps: float | None) -> str:
    if eps is not None:
        return {
            Verdict.PROVED: f"Some x in the box satisfies all equations to within {eps:g} mm for some readings: "
            "proved.",
            Verdict.REFUTED: f"No x in the box, with legs longer than {eps:g} mm, satisfies all equations "
            f"to within {eps:g} mm for any readings: proved.",
            Verdict.UNKNOWN: f"Stopped before it was known if any x satisfies the equations to within {eps:g} mm.",
        }[found.verdict]
    if found.witness is not None and found.hi == 0.0:
        how = "proved in exact arithmetic" if solves_exactly(campaign, leg, found.witness.point[:7]) else "proved"
        return f"The model is not refuted: some x satisfies every equation exactly for some readings: {how}."
    return found.status


def _check(
    campaign: Campaign,
    legs: Sequence[int] | None,
    delta: float,
    center: str,
    gap: float,
    time_limit: float | None,
    eps: float | None,
) -> None:
    """All problems with the options at once."""
    wrong: list[Problem] = []
    for leg in legs or ():
        if not 1 <= leg <= campaign.legs:
            wrong.append(Problem("legs", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}"))
    if legs is not None and len(set(legs)) < len(legs):
        wrong.append(Problem("legs", "a leg is named twice", "name each once"))
    if not (np.isfinite(delta) and delta >= 0.0):
        wrong.append(Problem("delta", f"{delta} is no half-width", "give a number of mm, 0 or more"))
    if center not in CENTERS:
        wrong.append(Problem("center", f"{center!r} is not known", f"use one of {', '.join(CENTERS)}"))
    if not 0.0 <= gap < 1.0:
        wrong.append(Problem("gap", f"{gap} is no relative gap", "give a number from 0 to below 1, such as 1e-6"))
    if time_limit is not None and not time_limit > 0.0:
        wrong.append(Problem("time_limit", f"{time_limit} is no time", "give a positive number of seconds"))
    if eps is not None and not (np.isfinite(eps) and eps >= 0.0):
        wrong.append(Problem("eps", f"{eps} is no tolerance", "give a number of mm, 0 or more"))
    if wrong:
        raise InputError(wrong)
