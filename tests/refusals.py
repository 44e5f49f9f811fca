"""What files are refused for."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cpcal.common.errors import InputError


def refused(load: Callable[[Path], object], file: Path, text: str) -> list[tuple[int | None, str]]:
    """(line, what) of every problem of a file with that text; each has a remedy and names the file."""
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(file)
    assert all(problem.remedy and problem.where == str(file) for problem in caught.value.problems)
    return [(problem.line, problem.what) for problem in caught.value.problems]
