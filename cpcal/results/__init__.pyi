from .comparison import COMPARISON_NAME, Comparison, Entry, comparison_text, load_comparison, save_comparison
from .options import ARITHMETICS, CENTERS, METHODS, SUPPORTS, Options
from .projection import Projection, Projections
from .result import (
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
from .verified_point import VerifiedPoint

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
