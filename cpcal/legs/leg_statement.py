"""One leg of a campaign as a certificate states it."""

from __future__ import annotations

import numpy as np

from cpcal.checker.leg import Measurement, leg_problem
from cpcal.files import campaign_sha256
from cpcal.legs.equation import exactly_read, leg_network
from cpcal.legs.models import PLAIN, LegModel, built_in
from cpcal.robot import Campaign
from cpcal.solver.certificate.exact_network import NotStated, network_statement
from cpcal.solver.certificate.statement import LegStatement, Statement
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network.restrict import restricted


def exact_measurement(campaign: Campaign, leg: int, k: int) -> Measurement:
    """Row k (from 0) of a campaign for one leg (from 1) in exact numbers: what the checker reads from campaign.json."""
    length, width = float(campaign.length[k, leg - 1]), float(campaign.length_radius[k, leg - 1])
    widths = (*campaign.position_radius[k].tolist(), *campaign.rotation_radius[k].tolist(), width)
    return Measurement(campaign.quaternion[k].tolist(), campaign.position[k].tolist(), length, widths)


def leg_statement(
    campaign: Campaign, leg: int, only: tuple[int, ...] | None = None, model: str = PLAIN.name
) -> LegStatement:
    """Leg `leg` (from 1) with all measurements, or with `only` those (numbers from 0, ascending).

    `model` is the name of one that comes with cpcal: those the checker knows.
    """
    problem = leg_problem(lambda k: exact_measurement(campaign, leg, k), len(campaign), model, only)
    return LegStatement(problem, campaign_sha256(campaign), leg, only)


def model_statement(
    campaign: Campaign, leg: int, model: LegModel, domain: Box, only: tuple[int, ...] | None = None
) -> Statement | None:
    """What a certificate says: for a model that comes with cpcal the leg, for others the constraints themselves.

    `domain` holds the parameters and, last, eps. None where constraints have no exact polynomial form, as those of a
    user-defined model with uncertain readings.
    """
    if built_in(model):
        return leg_statement(campaign, leg, only, model.name)
    if not exactly_read(campaign, leg):
        return None
    box, eps = Box(model.parameters, domain.lo[:-1], domain.hi[:-1]), (float(domain.lo[-1]), float(domain.hi[-1]))
    engine = get_arithmetic("float64")  # nothing that is stated depends on it
    network = leg_network(campaign, leg, box, engine=engine, eps=eps, model=model, stated=True)
    if only is not None:
        network = restricted(network, [np.array(only, dtype=np.intp)] * len(network.constraints))
    try:
        return network_statement(network, "eps", f"leg {leg}, model {model.name}, campaign {campaign_sha256(campaign)}")
    except NotStated:
        return None
