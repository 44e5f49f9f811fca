from .leg_section import reading_sensitivity
from .page import write_page, write_report
from .result_table import ResultTable, result_table
from .words import FRAME, LONGER, QUANTIFIER, center_sentence, leg_sentence, notices

__all__ = [
    "FRAME",
    "LONGER",
    "QUANTIFIER",
    "ResultTable",
    "center_sentence",
    "leg_sentence",
    "notices",
    "reading_sensitivity",
    "result_table",
    "write_page",
    "write_report",
]
