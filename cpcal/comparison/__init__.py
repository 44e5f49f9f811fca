"""Models side by side: which of them the measurements refute at a tolerance, each with the proof of it."""

from cpcal.comparison.campaigns import COMPARED, compare
from cpcal.comparison.networks import compare_networks
from cpcal.comparison.table import COMPARISON_NAME, Comparison, Entry, load_comparison, save_comparison

__all__ = [
    "COMPARED",
    "COMPARISON_NAME",
    "Comparison",
    "Entry",
    "compare",
    "compare_networks",
    "load_comparison",
    "save_comparison",
]
