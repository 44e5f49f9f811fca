"""The house is kept in order: tests stand where what they test stands."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def place(folder: Path) -> str:
    return folder.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("folder", sorted({file.parent for file in (ROOT / "tests").rglob("test_*.py")}), ids=place)
def test_tests_follow_the_packages(folder: Path) -> None:
    """Each folder of tests is named as the folder that it tests; the checker's are parted by what a file claims."""
    kinds = {"valid", "forged", "malformed"}
    tested = folder.relative_to(ROOT / "tests")
    if tested.parts[:1] == ("checker",) and set(tested.parts[1:]) <= kinds:
        tested = Path("checker")
    outside = {Path(), Path("contractors"), Path("benchmarks")}
    assert tested in outside or (ROOT / "cpcal" / tested).is_dir()


def test_a_refusal_is_tested_with_its_reason() -> None:
    """Each `pytest.raises` has a `match`, or gives its error a name that is read. Two exceptions have no words."""
    without = []
    for file in sorted((ROOT / "tests").rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        tree = ast.parse(text if "pytest.raises" in text else "")
        read = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        for item in (item for node in ast.walk(tree) if isinstance(node, ast.With) for item in node.items):
            call, name = item.context_expr, item.optional_vars
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "pytest.raises":
                silent = ast.unparse(call.args[0]) in ("KeyboardInterrupt", "StopIteration")
                named = isinstance(name, ast.Name) and name.id in read
                if not (silent or named or any(keyword.arg == "match" for keyword in call.keywords)):
                    without.append(f"{place(file)}:{call.lineno}")
    assert not without
