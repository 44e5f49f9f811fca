from .numbers import bracket_text, clean, gap_text, rounded_down, rounded_up
from .page import REPORT_NAME, write_page, write_report
from .sensitivity import reading_sensitivity
from .table import Table, result_table
from .words import LONGER, QUANTIFIER, center_sentence, leg_sentence, missing_legs

__all__ = [
    "LONGER",
    "QUANTIFIER",
    "REPORT_NAME",
    "Table",
    "bracket_text",
    "center_sentence",
    "clean",
    "gap_text",
    "leg_sentence",
    "missing_legs",
    "reading_sensitivity",
    "result_table",
    "rounded_down",
    "rounded_up",
    "write_page",
    "write_report",
]
