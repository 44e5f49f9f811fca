"""A certificate for the answer about one leg: the search once more, each step proved by the checker's own rule."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cpcal import plugins
from cpcal.calibration import leg_box, leg_network
from cpcal.errors import CpcalError
from cpcal.interfaces import Limits, Verdict
from cpcal.interval import Box, get_arithmetic
from cpcal.optimize.bounding import Bounding
from cpcal.proof.campaign import ExactCampaign
from cpcal.proof.checker import FORMAT
from cpcal.proof.writer import Certifying, line, number
from cpcal.result import LegResult, Result
from cpcal.robot import Campaign
from cpcal.search import EventKind, LargestFirst, Search


def write_certificate(
    campaign: Campaign,
    folder: str | os.PathLike[str],
    result: Result,
    leg: LegResult,
    path: str | os.PathLike[str],
    *,
    seconds: float | None = None,
) -> Path:
    """Prove the answer about `leg` once more and write the certificate to `path`, all or nothing.

    Bracket and enclosure, or that a given eps is refuted. `folder` holds the campaign's files, whose SHA-256 goes
    into it. The lower bound that is claimed is what the exact rule proves, within the gap of the result or, after
    `seconds`, as far as it got. Raises CpcalError where there is nothing to certify.
    """
    if not certifiable(leg):
        raise CpcalError(f"leg {leg.leg}: neither a proved point nor a refutation is there to be certified")
    exact = ExactCampaign(Path(folder), leg.leg)
    box = leg_box(leg.center, result.delta)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as steps:
        kept, cap = [], _cap(result, leg)
        for item in _steps(campaign, exact, result, leg, box, seconds):
            if isinstance(item, Box):
                kept.append(item)
            else:
                cap = min(cap, float.fromhex(item.get("cap", number(cap))))
                steps.write(line(item))
        target = Path(path)
        partial = target.with_name(f".{target.name}.partial")
        with partial.open("w", encoding="utf-8") as out:
            out.write(line(_header(exact, leg, box, _cap(result, leg))))
            out.write(line(_claims(result, leg, kept, cap)))
            steps.seek(0)
            out.writelines(steps)
            if leg.point is not None:
                out.write(line({"point": [number(value) for value in leg.point]}))
        partial.replace(target)
    return target


def certifiable(leg: LegResult) -> bool:
    """Whether there is a proved point or a refutation."""
    return leg.point is not None or leg.verdict is Verdict.REFUTED


def _cap(result: Result, leg: LegResult) -> float:
    return leg.eps_hi if leg.point is not None or result.eps is None else result.eps


def _header(exact: ExactCampaign, leg: LegResult, box: Box, cap: float) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "campaign": exact.sha256,
        "leg": leg.leg,
        "measurements": len(exact),
        "lo": [number(v) for v in box.lo],
        "hi": [number(v) for v in box.hi],
        "cap": number(cap),
    }


def _claims(result: Result, leg: LegResult, kept: list[Box], cap: float) -> dict[str, Any]:
    hull = None
    for box in kept:
        hull = box if hull is None else hull.hull(box)
    lowest = min([float(box.lo[7]) for box in kept] + [cap])
    enclosure = (
        None if hull is None else {"lo": [number(v) for v in hull.lo[:7]], "hi": [number(v) for v in hull.hi[:7]]}
    )
    attained = None if leg.point is None else number(_cap(result, leg))
    return {"cap": number(cap), "eps_lo": number(lowest), "enclosure": enclosure, "eps_hi": attained}


def _steps(
    campaign: Campaign,
    exact: ExactCampaign,
    result: Result,
    leg: LegResult,
    box: Box,
    seconds: float | None,
) -> Iterator[dict[str, Any] | Box]:
    """The steps of the proof as they are found, and the boxes that stay open."""
    engine = get_arithmetic("float64")
    network = leg_network(campaign, leg.leg, box, engine=engine, eps=(0.0, _cap(result, leg)))
    inner = plugins.build(network, ("lifted",), objective="eps")
    contractor = Certifying(inner, exact.measurement)
    domain = network.domain
    strategy = LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=("eps",))
    limits = Limits(seconds=seconds, gap=result.gap)
    clock = limits.clock()
    bounding = Bounding(network, 7, contractor, strategy, limits, engine)
    if leg.point is not None:
        bounding.propose(np.append(np.asarray(leg.point), leg.eps_hi))
    search = Search([domain], bounding, bounding, lambda node: float(node.box.lo[7]))
    names, fresh = {0: 0}, 1
    for event in search:
        name = names.pop(event.node.serial)
        # a node that the incumbent cuts away altogether never came to the contractor
        record = contractor.record or {"cap": number(bounding.hi), "bounds": []}
        contractor.record = None
        yield {"exclude" if "weights" in record else "pass": name, **record}
        if event.kind is EventKind.CONTRACTED:
            names[event.children[0].serial] = name
        elif event.kind is EventKind.KEPT:
            yield event.contraction.box
        elif event.kind is EventKind.SPLIT:
            first, second = event.children
            i = int(np.flatnonzero(first.box.hi != second.box.hi)[0])
            yield {"split": name, "unknown": i, "at": number(first.box.hi[i]), "into": [fresh, fresh + 1]}
            names[first.serial], names[second.serial] = fresh, fresh + 1
            fresh += 2
        if clock.over():
            break
    yield from (node.box for node in search.pending)
