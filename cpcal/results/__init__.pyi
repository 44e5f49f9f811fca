from .comparison import COMPARISON_NAME, Comparison, Entry, comparison_text, load_comparison, save_comparison
from .determination import Determination
from .leg_sentence import INFORMATION, contractors_sentences, information, proved_sentence, status_of
from .leg_verdict import (
    Bounded,
    Explained,
    LegVerdict,
    Uncompared,
    Undecided,
    Undetermined,
    Unexplained,
    verdict_of,
    verdict_on,
)
from .options import ARITHMETICS, CENTERS, METHODS, SUPPORTS, Options
from .projection import Projection, Projections
from .ranges import Ranges
from .result import (
    RESULT_NAME,
    CampaignNote,
    LegResult,
    ModelNote,
    Result,
    Uncertified,
    load_result,
    model_of,
    result_text,
    save_result,
)
from .support_proof import SupportProof
from .verified_point import VerifiedPoint

__all__ = [
    "ARITHMETICS",
    "CENTERS",
    "COMPARISON_NAME",
    "INFORMATION",
    "METHODS",
    "RESULT_NAME",
    "SUPPORTS",
    "Bounded",
    "CampaignNote",
    "Comparison",
    "Determination",
    "Entry",
    "Explained",
    "LegResult",
    "LegVerdict",
    "ModelNote",
    "Options",
    "Projection",
    "Projections",
    "Ranges",
    "Result",
    "SupportProof",
    "Uncertified",
    "Uncompared",
    "Undecided",
    "Undetermined",
    "Unexplained",
    "VerifiedPoint",
    "comparison_text",
    "contractors_sentences",
    "information",
    "load_comparison",
    "load_result",
    "model_of",
    "proved_sentence",
    "result_text",
    "save_comparison",
    "save_result",
    "status_of",
    "verdict_of",
    "verdict_on",
]
