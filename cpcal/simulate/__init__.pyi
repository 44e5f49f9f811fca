from .campaigns import (
    simulate,
    true_robot,
)
from .studies import (
    reached_poses,
    simulate_study,
)

__all__ = [
    "reached_poses",
    "simulate",
    "simulate_study",
    "true_robot",
]
