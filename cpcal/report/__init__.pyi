from .figures import errors_svg
from .run_page import bounds_table, outliers_section, parameters_section, render, residuals_drawing, write_report
from .words import FRAME, LONGER, QUANTIFIER, leg_sentence, notices

__all__ = [
    "FRAME",
    "LONGER",
    "QUANTIFIER",
    "bounds_table",
    "errors_svg",
    "leg_sentence",
    "notices",
    "outliers_section",
    "parameters_section",
    "render",
    "residuals_drawing",
    "write_report",
]
