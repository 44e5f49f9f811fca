"""Folders without a result.json: what compare.json, fits.json and accuracy.json state, against what is proved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cpcal.accuracy.findings import ACCURACY_NAME, load_accuracy
from cpcal.certify.fits import FITS_NAME, load_fits
from cpcal.certify.recomputed import leg_stated_otherwise, speaks_of
from cpcal.checker import Accepted, Refused, Unusable, check
from cpcal.cli.talk import Talk
from cpcal.common.errors import InputError, Problem
from cpcal.files import campaign_sha256, load_campaign_json
from cpcal.results import COMPARISON_NAME, Entry, load_comparison


def as_stated(folder: Path, talk: Talk) -> bool:
    """Whether the accepted certificates claim what the folder's compare.json, fits.json or accuracy.json states.

    Raises InputError.
    """
    wrong = [*_other_comparison(folder, talk), *other_fits(folder), *_other_sets(folder, talk)]
    for line in wrong:
        talk.say(f"{line}: REFUSED, states other numbers than are proved")
    return not wrong


def _other_comparison(folder: Path, talk: Talk) -> Iterator[str]:
    if not (folder / COMPARISON_NAME).exists():
        return
    comparison = load_comparison(folder)
    options, campaign = comparison.options, None
    if options is not None:  # of legs, not of the user's networks
        campaign = load_campaign_json(folder)
        if campaign_sha256(campaign) != comparison.campaign_sha256:
            yield f"{COMPARISON_NAME}, of another campaign"
            return
    elif comparison.campaign_sha256 is not None:
        yield f"{COMPARISON_NAME}, without options"
        return
    for entry in comparison.entries:
        if entry.certificate is None:
            talk.say(f"{entry.subject}, {entry.model}: NOT CERTIFIED, {entry.not_certified}")
            continue
        accepted = _claimed(folder, entry.certificate)
        if _stated(entry) != _proved(accepted):
            yield f"{entry.subject}, {entry.model}"
        elif campaign is not None and options is not None:
            wrong = leg_stated_otherwise(comparison, entry, accepted, campaign, options.delta)
            if wrong is not None:
                yield f"{entry.subject}, {entry.model}, {wrong}"
        elif accepted.leg is not None:
            yield f"{entry.subject}, {entry.model}, by the certificate of a leg"


Numbers = tuple[float, float, tuple[tuple[float, float], ...] | None]  # eps_lo, eps_hi, the enclosure at eps_hi


def _stated(entry: Entry) -> Numbers:
    box = entry.enclosure
    sides = None if box.is_empty else tuple((float(lo), float(hi)) for lo, hi in zip(box.lo, box.hi, strict=True))
    return entry.eps_lo, entry.eps_hi, sides


def _proved(accepted: Accepted) -> Numbers:
    claims, inf = accepted.claims, float("inf")
    lo = inf if claims.infeasible else float(claims.eps_lo or 0)
    hi = inf if claims.eps_hi is None else float(claims.eps_hi)
    if claims.enclosure is None or (claims.eps_hi is not None and claims.cap != claims.eps_hi):
        return lo, hi, None
    pairs = enumerate(zip(*claims.enclosure, strict=True))
    return lo, hi, tuple((float(a), float(b)) for k, (a, b) in pairs if k != accepted.objective)


def _other_sets(folder: Path, talk: Talk) -> Iterator[str]:
    """Of the sets of parameters on which the bounds of an accuracy run rest."""
    if not (folder / ACCURACY_NAME).exists():
        return
    found = load_accuracy(folder)
    for box in found.boxes:
        if box.certificate is None:
            talk.say(f"set of leg {box.leg}: NOT CERTIFIED")
            continue
        accepted = _claimed(folder, box.certificate)
        claims = accepted.claims
        lo, hi = (tuple(map(float, side[:-1])) for side in claims.enclosure or ((None,), (None,)))
        proved = (accepted.leg, None if claims.cap is None else float(claims.cap), lo, hi)
        if claims.infeasible != (not box.lo) or proved != (box.leg, box.eps, box.lo, box.hi):
            yield f"set of leg {box.leg}"
        elif not speaks_of(accepted, found.delta):
            yield f"set of leg {box.leg}, of another box"
    said = "the certificates prove the sets of parameters; no certificate holds the bounds of poses and cells."
    talk.say(f"{ACCURACY_NAME}: {said}")


def other_fits(folder: Path) -> Iterator[str]:
    if not (folder / FITS_NAME).exists():
        return
    for name, fits in load_fits(folder).both:
        for fit in fits:
            accepted = _claimed(folder, fit.certificate)
            point = accepted.claims.point
            found = (0, 0) if point is None else (len(point.holds), len(point.fails))
            if (accepted.leg, *found) != (fit.leg, fit.verified.holds, fit.verified.fails):
                yield f"{name}, leg {fit.leg}"


def _claimed(folder: Path, name: str) -> Accepted:
    """The claims of a certificate in the folder. Raises InputError for one that is missing or refused."""
    try:
        return check(folder / Path(name).name)
    except (Unusable, Refused) as reason:
        raise InputError([Problem(str(folder / name), str(reason), "run the command again that wrote it")]) from None
