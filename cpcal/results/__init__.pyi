from .comparison import (
    COMPARISON_NAME,
    Comparison,
    Entry,
    load_comparison,
    save_comparison,
)
from .projection import (
    Projection,
    Projections,
)
from .result import (
    LegResult,
    ModelNote,
    Result,
    load_result,
    model_of,
    save_result,
)
from .verified_point import (
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
