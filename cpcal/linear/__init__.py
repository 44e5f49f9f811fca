"""Polyhedra: linear programs that propose, rigorous bounds that dispose."""

from cpcal.linear.glop import Glop
from cpcal.linear.lazy import LazyRows
from cpcal.linear.rigorous import lower_bound

__all__ = ["Glop", "LazyRows", "lower_bound"]
