"""Whether a result, which may come from a file, is of this campaign and can be shown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from cpcal.errors import InputError, Problem, printable
from cpcal.results import LegResult, Result
from cpcal.robot import Campaign


def check_match(campaign: Campaign, result: Result) -> None:
    """Raises InputError when the result is of another campaign, or when its fields are not what they should be."""
    if result.campaign_sha256 != campaign.sha256:
        what = f"is of another campaign (sha256 {printable(str(result.campaign_sha256))}, not {campaign.sha256})"
        raise InputError([Problem("result", what, "give the campaign that was certified, or certify this one")])
    wrong = [Problem("result", f"has a field that makes no sense: {name}", "certify again") for name in _wrong(result)]
    seen: set[int] = set()
    for leg in result.legs:
        if not isinstance(leg.leg, int) or not 1 <= leg.leg <= campaign.legs or leg.leg in seen:
            what = f"names a leg that is not there, or twice: {printable(str(leg.leg))}"
            wrong.append(Problem("result", what, f"use legs 1 to {campaign.legs}, each once"))
            continue
        seen.add(leg.leg)
        what = f"leg {leg.leg} has a field that makes no sense"
        wrong += [
            Problem("result", f"{what}: {name}", "certify again") for name in _wrong_leg(leg, len(result.parameters))
        ]
    if wrong:
        raise InputError(wrong)


def _wrong(result: Result) -> Iterator[str]:
    yield from _unlike(str, result, ("robot", "center", "arithmetic", "version"))
    yield from _unlike((int, float), result, ("delta", "gap"))
    if not isinstance(result.eps, int | float | None):
        yield "eps"
    if not _texts(result.contractors):
        yield "contractors"
    if result.parameters != result.model.parameters:
        yield "parameters"


def _wrong_leg(leg: LegResult, size: int) -> Iterator[str]:
    yield from _unlike(str, leg, ("status",))
    yield from _unlike(int, leg, ("nodes", "programs"))
    yield from _unlike((int, float), leg, ("floor", "seconds"))
    if leg.point is not None and not (len(leg.point) == size and all(map(math.isfinite, leg.point))):
        yield "point"
    if len(leg.center) != size:
        yield "center"
    if not _texts(leg.support):
        yield "support"


def _unlike(kind: type | tuple[type, ...], owner: Any, names: Iterable[str]) -> Iterator[str]:
    for name in names:
        if not isinstance(getattr(owner, name), kind):
            yield name


def _texts(values: Iterable[Any]) -> bool:
    return all(isinstance(value, str) for value in values)
