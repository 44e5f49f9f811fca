"""How large the model error of each leg is over the workspace: an estimate, in floating point. Nothing of it is proved.

The certificate of accuracy ASSUMES one number a leg: some parameters satisfy the leg's equation to within eps at the
calibration poses and at every pose of the workspace. eps* of the calibration poses alone is too small for that: the
parameters were chosen for these poses. So the least error is computed for more and more of all poses known, drawn at
random, and its growth is carried on: see `Growth.suggested`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.values import Floats, Indices
from cpcal.models import leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit

SHARES = (0.25, 0.5, 1.0)  # of the poses
_DRAWS = 4  # of each share
_FEWEST = 9  # poses: with fewer eight unknowns explain them whatever they are


@dataclass(frozen=True)
class Growth:
    """Least errors of one leg in mm, each the mean over draws of `poses` poses, the last of all of them.

    `least`: with the readings in their sets that suit best. `centered`: with the readings as they are, so that the
    noise counts as model error too.
    """

    leg: int
    poses: tuple[int, ...]
    least: tuple[float, ...]
    centered: tuple[float, ...]

    @property
    def suggested(self) -> float:
        """mm: the least error of the readings as they are with all poses, and twice what the last doubling added.

        Readings as they are, for sets that are wide hide model errors of their own size.
        """
        added = self.centered[-1] - self.centered[-2] if len(self.centered) > 1 else self.centered[-1]
        return self.centered[-1] + 2.0 * max(added, 0.0)


def growth(campaigns: Sequence[Campaign], leg: int, *, center: Sequence[float], delta: float, seed: int = 1) -> Growth:
    """Of the poses of several campaigns of one robot, all in the same frames: calibration and validation."""
    whole = joined_campaign(campaigns)
    count, rng = len(whole), np.random.default_rng(seed)
    networks = [_network(part, leg, center, delta) for part in (whole, exactly(whole))]
    sizes = sorted({min(max(round(share * count), _FEWEST), count) for share in SHARES})
    found: list[tuple[float, float]] = []
    for size in sizes:
        draws = 1 if size == count else _DRAWS
        rows = [np.sort(rng.permutation(count)[:size]) for _ in range(draws)]
        errors = [[_least_error(network, chosen, center) for chosen in rows] for network in networks]
        found.append((float(np.mean(errors[0])), float(np.mean(errors[1]))))
    return Growth(leg, tuple(sizes), tuple(f[0] for f in found), tuple(f[1] for f in found))


def joined_campaign(campaigns: Sequence[Campaign]) -> Campaign:
    """All measurements as one campaign, named by the number of their campaign and their own names."""
    first = campaigns[0]
    pose = [f"{k}.{name}" for k, c in enumerate(campaigns) for name in c.pose]
    run = [name for c in campaigns for name in c.run]
    return Campaign.of(
        first.robot,
        np.concatenate([c.position for c in campaigns]),
        np.concatenate([c.quaternion for c in campaigns]),
        np.concatenate([c.length for c in campaigns]),
        pose=pose,
        run=run,
        position_radius=np.concatenate([c.position_radius for c in campaigns]),
        rotation_radius=np.concatenate([c.rotation_radius for c in campaigns]),
        length_radius=np.concatenate([c.length_radius for c in campaigns]),
    )


def exactly(campaign: Campaign) -> Campaign:
    """The same readings, without sets around them."""
    c = campaign
    return Campaign.of(c.robot, c.position, c.quaternion, c.length, pose=c.pose, run=c.run, exact=True)


def chebyshev(campaign: Campaign, leg: int, start: Sequence[float], delta: float) -> tuple[Floats, float]:
    """Parameters (7,) near `start` whose largest error over the campaign is (locally) least, and that error in mm.

    The readings are those in their sets that suit best.
    """
    network = _network(campaign, leg, start, delta)
    point = _fitted(network, np.asarray(start, np.float64))
    return point[:-1], max(float(point[-1]), 0.0)


def _network(campaign: Campaign, leg: int, center: Sequence[float], delta: float) -> ConstraintNetwork:
    box = leg_box(np.asarray(center, np.float64), delta)
    return leg_network(campaign, leg, box, engine=get_arithmetic("float64"), eps=(0.0, np.inf))


def _least_error(network: ConstraintNetwork, rows: Indices, center: Sequence[float]) -> float:
    part = restricted(network, [rows] * len(network.constraints))
    return max(float(_fitted(part, np.asarray(center, np.float64))[-1]), 0.0)


def _fitted(network: ConstraintNetwork, start: Floats) -> Floats:
    objective = network.names.index("eps")
    return fit(Rows(network), objective, network.domain, np.append(start, 0.0))
