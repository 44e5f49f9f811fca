"""Problem files by their suffix: .bch and .mbx are Minibex, .nl is AMPL's."""

from __future__ import annotations

from pathlib import Path

from cpcal.common.errors import InputError, Problems
from cpcal.common.errors import Problem as Wrong
from cpcal.common.files import small_file
from cpcal.problems.minibex import read_minibex
from cpcal.problems.nl import read_nl
from cpcal.problems.problem import StatedProblem

MOST = 2**26  # bytes
READERS = {".bch": read_minibex, ".mbx": read_minibex, ".nl": read_nl}


def load_problem(path: Path) -> StatedProblem:
    """The problem in a file. Raises InputError that names file and line."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        what = "is neither Minibex (.bch, .mbx) nor AMPL's .nl"
        raise InputError([Wrong(str(path), what, "give it the suffix of what it is")])
    problems = Problems()
    content = small_file(path, problems, "give a file of a problem", most=MOST)
    problems.raise_any()
    try:
        text = (content or b"").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError([Wrong(str(path), "is no UTF-8 text", "save it as UTF-8 text")]) from None
    return reader(text, str(path))
