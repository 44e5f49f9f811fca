"""The house is kept in order: small files, small functions, and no two things of one name in different rooms."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("cpcal", "contractors", "benchmarks", "tests")
FILES = sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py"))
NAMELESS = {"__init__.py", "__main__.py", "conftest.py"}
# the checker is copied alone, and a page and a verb stand for what they show: their names are those of the rooms below
APART = ("cpcal.checker", "cpcal.cli", "cpcal.report")


def place(file: Path) -> str:
    return file.relative_to(ROOT).as_posix()


def room(file: Path) -> str:
    """A folder of cpcal, or one of the other folders."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:2] if parts[0] == "cpcal" else parts[:1])


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def functions(file: Path) -> Iterable[tuple[str, int]]:
    """Every function of a file with its lines; a docstring is not counted."""
    waiting: list[ast.AST] = [tree(file)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.expr):
            continue  # no function is stated within
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            told = node.body[0] if ast.get_docstring(node, clean=False) is not None else None
            text = 0 if told is None or told.end_lineno is None else told.end_lineno - told.lineno + 1
            assert node.end_lineno is not None
            yield node.name, node.end_lineno - node.lineno + 1 - text


def shared(places: Iterable[tuple[str, Path]]) -> dict[str, list[str]]:
    """Names with the places in different rooms that have them."""
    named: dict[str, dict[str, str]] = defaultdict(dict)
    for name, file in places:
        if not room(file).startswith(APART):
            named[name][room(file)] = place(file)
    return {name: sorted(rooms.values()) for name, rooms in named.items() if len(rooms) > 1}


def test_no_file_has_more_than_300_lines() -> None:
    lines = {place(file): len(file.read_text(encoding="utf-8").splitlines()) for file in FILES}
    assert {name: count for name, count in lines.items() if count > 300} == {}


def test_no_function_has_more_than_60_lines() -> None:
    long = {f"{place(file)}: {name}": count for file in FILES for name, count in functions(file) if count > 60}
    assert long == {}


def test_no_two_files_of_different_rooms_share_a_name() -> None:
    assert shared((file.name, file) for file in FILES if file.name not in NAMELESS) == {}


def test_no_two_classes_of_different_rooms_share_a_name() -> None:
    found = [
        (node.name, file)
        for file in FILES
        for node in tree(file).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and room(file) != "tests"
    ]
    assert shared(found) == {}


@pytest.mark.parametrize("folder", sorted({file.parent for file in (ROOT / "tests").rglob("test_*.py")}), ids=place)
def test_tests_follow_the_packages(folder: Path) -> None:
    """Each folder of tests is named as the folder that it tests; the checker's are parted by what a file claims."""
    kinds = {"valid", "forged", "malformed"}
    tested = folder.relative_to(ROOT / "tests")
    if tested.parts[:1] == ("checker",) and set(tested.parts[1:]) <= kinds:
        tested = Path("checker")
    outside = {Path(), Path("contractors"), Path("benchmarks")}
    assert tested in outside or (ROOT / "cpcal" / tested).is_dir()
