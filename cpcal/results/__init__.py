"""What certification found, as plain data, and its files."""

from cpcal.results.comparison import (
    COMPARISON_NAME,
    Comparison,
    Entry,
    load_comparison,
    save_comparison,
)
from cpcal.results.projection import (
    Projection,
    Projections,
)
from cpcal.results.result import (
    LegResult,
    ModelNote,
    Result,
    load_result,
    model_of,
    save_result,
)
from cpcal.results.verified_point import (
    VerifiedPoint,
)

__all__ = [
    "COMPARISON_NAME",
    "Comparison",
    "Entry",
    "LegResult",
    "ModelNote",
    "Projection",
    "Projections",
    "Result",
    "VerifiedPoint",
    "load_comparison",
    "load_result",
    "model_of",
    "save_comparison",
    "save_result",
]
