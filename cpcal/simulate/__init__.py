"""Simulated campaigns and studies of robots that are imperfect by choice."""

from cpcal.simulate.campaigns import (
    simulate,
    true_robot,
)
from cpcal.simulate.studies import (
    simulate_study,
)

__all__ = [
    "simulate",
    "simulate_study",
    "true_robot",
]
