"""The support: few measurements that prove the lower bound by themselves."""

from __future__ import annotations

import pytest

import cpcal
from cpcal.robot import Campaign


def only(campaign: Campaign, ids: tuple[str, ...]) -> Campaign:
    keep = [k for k, name in enumerate(campaign.measurement_ids) if name in ids]
    return Campaign.of(
        campaign.robot,
        campaign.position[keep],
        campaign.quaternion[keep],
        campaign.length[keep],
        position_radius=campaign.position_radius[keep],
        rotation_radius=campaign.rotation_radius[keep],
        length_radius=campaign.length_radius[keep],
    )


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_the_support_alone_forces_the_bound(factor: float) -> None:
    campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=factor)
    leg = cpcal.certify(campaign, legs=[2]).legs[0]
    assert 0 < len(leg.support) <= 20
    few = only(campaign, leg.support)
    # the same box: the fit of the few would be elsewhere, so look wide around it
    alone = cpcal.certify(few, legs=[2], delta=300.0, center="nominal", gap=1e-5).legs[0]
    assert alone.bracket.lo == pytest.approx(leg.bracket.lo, rel=1e-4)


def test_nothing_supports_a_bound_of_zero() -> None:
    campaign = cpcal.simulate(seed=3, joint_error=0.0, factor=3.0, truncate=2.9)
    leg = cpcal.certify(campaign, legs=[1]).legs[0]
    assert leg.not_refuted
    assert leg.support == ()


def test_a_refuted_tolerance_names_who_refutes_it() -> None:
    campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0)
    leg = cpcal.certify(campaign, legs=[1], eps=0.4).legs[0]
    assert leg.bracket.verdict is cpcal.Verdict.REFUTED
    assert 0 < len(leg.support) <= 64
    assert leg.bracket.lo == 0.4


def test_an_unknown_support_is_refused() -> None:
    with pytest.raises(cpcal.InputError, match="use one of few, none"):
        cpcal.certify(cpcal.simulate(seed=1), support="all")
