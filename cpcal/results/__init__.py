"""What certification found, as plain data, and its files."""

from cpcal.results.comparison import (
    COMPARISON_NAME,
    Comparison,
    Entry,
    comparison_text,
    load_comparison,
    save_comparison,
)
from cpcal.results.options import ARITHMETICS, CENTERS, METHODS, SUPPORTS, Options
from cpcal.results.projection import Projection, Projections
from cpcal.results.result import (
    RESULT_NAME,
    CampaignNote,
    LegResult,
    ModelNote,
    Result,
    load_result,
    model_of,
    result_text,
    save_result,
)
from cpcal.results.verified_point import VerifiedPoint

__all__ = [
    "ARITHMETICS",
    "CENTERS",
    "COMPARISON_NAME",
    "METHODS",
    "RESULT_NAME",
    "SUPPORTS",
    "CampaignNote",
    "Comparison",
    "Entry",
    "LegResult",
    "ModelNote",
    "Options",
    "Projection",
    "Projections",
    "Result",
    "VerifiedPoint",
    "comparison_text",
    "load_comparison",
    "load_result",
    "model_of",
    "result_text",
    "save_comparison",
    "save_result",
]
