from .campaigns import simulate, simulate_study, true_robot

__all__ = ["simulate", "simulate_study", "true_robot"]
