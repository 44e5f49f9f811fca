"""What a person reads of a result: numbers rounded to the proved side, sentences, one HTML page."""

from cpcal.report.page import REPORT_NAME, write_page, write_report
from cpcal.report.sensitivity import reading_sensitivity
from cpcal.report.table import Table, result_table
from cpcal.report.words import LONGER, QUANTIFIER, center_sentence, leg_sentence, missing_legs

__all__ = [
    "LONGER",
    "QUANTIFIER",
    "REPORT_NAME",
    "Table",
    "center_sentence",
    "leg_sentence",
    "missing_legs",
    "reading_sensitivity",
    "result_table",
    "write_page",
    "write_report",
]
