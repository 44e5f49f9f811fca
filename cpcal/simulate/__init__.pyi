from .campaigns import (
    simulate,
    true_robot,
)
from .studies import (
    simulate_study,
)

__all__ = [
    "simulate",
    "simulate_study",
    "true_robot",
]
