"""From repeated measurements to a campaign of their means, with reading sets taken from their scatter.

The centres are means of a configuration's readings: positions and leg readings as they are, rotations by
`mean_rotations`. What the half-widths stand for is a choice that changes their size by sqrt(r):

    of="single"   how far a single reading lies from its true value: the paper's choice (section 5.1.1)
    of="mean"     how far the mean of r readings does: sigma / sqrt(r), and by the central limit theorem nearly normal

For the standard errors of a fit to the means (`Noise.of`) only the second is right; the first overstates them.

Neither knows of errors that all readings of a configuration share, and no mean is free of them: their deviations are
given as `shared` and added in quadrature. Where the robot itself scatters, the repeats'
deviations are not the readings' errors: give those as `sigma` (`Repeatability.noise_sigma`).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from cpcal.calibration.statistics import campaign_deviations, group_means, grouped, mean_rotations
from cpcal.calibration.tolerance import Method, half_widths
from cpcal.common.arrays import Floats, Ints
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Campaign, Uncertainty

Of = Literal["single", "mean"]


def averaged(
    campaign: Campaign,
    method: Method = "sigma",
    *,
    of: Of = "single",
    factor: float = 3.0,
    coverage: float = 0.95,
    confidence: float = 0.95,
    keep: npt.ArrayLike | None = None,
    sigma: npt.ArrayLike | None = None,
    shared: npt.ArrayLike | None = None,
) -> Campaign:
    """One measurement for each pose of the campaign: means over its runs, in the order of the poses' first readings.

    method, factor, coverage, confidence   as of `half_widths`
    of      whose half-widths: of "single" readings, or of the "mean" (method "sigma" only: nothing distribution-free is
            known of means that is not known of single readings)
    keep    (N,) which measurements to use, as of `Screening.keep`; left out: all
    sigma   (6 + n,) standard deviations of a reading's channels, mm and rad, in place of those of the repeats (method
            "sigma" only); then nothing need be repeated
    shared  (N, 6) standard deviations of an error of the poses that all measurements share, mm and rad (method "sigma"
            only): repeats neither show it nor make it smaller, so it enters in full, whichever half-widths are asked

    The new campaign's `run` is "mean", and its provenance says how it was made. Raises InputError when nothing is
    repeated, or for options without a meaning.
    """
    if of not in ("single", "mean"):
        raise InputError([Problem("option of", f"has no meaning: {of!r}", "give 'single' or 'mean'")])
    if of == "mean" and method != "sigma":
        what = f"'mean' has no meaning with method {method!r}"
        raise InputError([Problem("option of", what, 'use method="sigma", or half-widths of "single" readings')])
    used = campaign if keep is None else kept(campaign, keep)
    if sigma is None:
        widths = half_widths(campaign_deviations(used), method, factor=factor, coverage=coverage, confidence=confidence)
    else:
        widths = factor * _sigmas(sigma, method, campaign.legs)
    group, names = grouped(used.pose, repeated=sigma is None)
    repeats = np.bincount(group)
    shrink = np.sqrt(repeats[:, None]) if of == "mean" else np.ones((len(names), 1))
    radii = widths / shrink
    if shared is not None:
        radii[:, :6] = np.hypot(radii[:, :6], factor * _shared(shared, method, campaign, keep, group))
    said = _said((len(group), len(names)), method, of, factor, coverage, confidence)
    said += "" if shared is None else "; errors of camera and target that all images share are counted in full"
    return Campaign.of(
        campaign.robot,
        group_means(used.position, group, len(names)),
        mean_rotations(used.quaternion, group, len(names)),
        group_means(used.length, group, len(names)),
        pose=names,
        run=["mean"] * len(names),
        uncertainty=_declared(radii.max(axis=0), factor if method == "sigma" else None),
        position_radius=radii[:, :3],
        rotation_radius=radii[:, 3:6],
        length_radius=radii[:, 6:],
        provenance={**campaign.provenance, "averaged": said},
    )


def _declared(widths: Floats, factor: float | None) -> Uncertainty:
    """What holds for all rows: the largest half-widths, as standard deviations when they are multiples of such."""
    values = widths if factor is None else widths / factor
    return Uncertainty(values[:3], values[3:6], values[6:], factor)


def _sigmas(sigma: npt.ArrayLike, method: Method, legs: int) -> Floats:
    values = np.asarray(sigma, dtype=np.float64)
    if method != "sigma" or values.shape != (6 + legs,) or not (np.isfinite(values) & (values >= 0.0)).all():
        what = f"has the shape {values.shape}, with method {method!r}"
        raise InputError([Problem("option sigma", what, f'give {6 + legs} numbers >= 0, with method="sigma"')])
    return values


def _shared(
    shared: npt.ArrayLike, method: Method, campaign: Campaign, keep: npt.ArrayLike | None, group: Ints
) -> Floats:
    """(K, 6) of each configuration: the root mean square of its rows'."""
    values = np.asarray(shared, dtype=np.float64)
    if method != "sigma" or values.shape != (len(campaign), 6) or not (np.isfinite(values) & (values >= 0.0)).all():
        what = f"has the shape {values.shape}, with method {method!r}"
        raise InputError([Problem("option shared", what, f'give ({len(campaign)}, 6) >= 0, with method="sigma"')])
    used = values if keep is None else values[np.asarray(keep)]
    return np.asarray(np.sqrt(group_means(used**2, group, int(group.max()) + 1)))


def kept(campaign: Campaign, keep: npt.ArrayLike) -> Campaign:
    """The measurements with a true value in `keep` (N,), declared exact: half-widths come from the scatter."""
    mask = np.asarray(keep)
    if mask.shape != (len(campaign),) or mask.dtype != np.bool_:
        what = f"has the shape {mask.shape} and the type {mask.dtype}"
        raise InputError([Problem("option keep", what, f"give {len(campaign)} truth values")])
    rows = np.flatnonzero(mask).tolist()
    return Campaign.of(
        campaign.robot,
        campaign.position[rows],
        campaign.quaternion[rows],
        campaign.length[rows],
        pose=[campaign.pose[k] for k in rows],
        run=[campaign.run[k] for k in rows],
        exact=True,
    )


def _said(counts: tuple[int, int], method: Method, of: Of, factor: float, coverage: float, confidence: float) -> str:
    sets = {
        "sigma": f"{factor:g} standard deviations",
        "extreme": "the largest error seen",
        "tolerance": f"{coverage:g} of the errors with confidence {confidence:g}, from order statistics",
    }[method]
    whose = "single readings" if of == "single" else "the means"
    return f"{counts[0]} readings of {counts[1]} configurations; half-widths of {whose}: {sets}"
