"""Every command of README and docs: on a line of its own it is run, page by page; within a text it is understood."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from cpcal.cli import app

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# Added to a command so that it ends soon, which changes nothing of how it is understood: the last value counts.
SHORT = {
    "simulate": ["--factor", "0"],
    "certify": ["--legs", "1", "--time-limit", "1"],
    "handeye study --simulate": ["--simulate", "5"],
    "handeye certify": ["--time-limit", "1"],
}
ELSEWHERE = {  # what needs files that a page does not make, or an installed package; and tests that run the same
    "handeye study --photos": "tests/models/test_hand_eye_runs.py",
    "handeye certify photos": "the same",
    "verify frames": "the same",
    "image": "tests/vision, tests/cli/test_images.py, tests/cli/test_pose_sets.py",
    "verify sets": "tests/cli/test_pose_sets.py",
    "accuracy": "tests/questions/test_accuracy.py",
    "import": "tests/cli/test_import.py, tests/test_documentation.py",
    "solve": "tests/problems",
    "certify campaign -o run --model stretched": "tests/models/test_leg_models.py",
    "report run": "tests/cli/test_accuracy_verb.py",
}


OWN = {"your-data"}  # pages whose commands are run by a test of their own, with the files that they need


def blocks(page: Path) -> list[list[str]]:
    """The words of commands on lines of their own: indented by four, perhaps after a $; a backslash goes on."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = re.findall(r"^    (?:\$ )?cpcal (.*)$", text, re.M)
    return [shlex.split(line, comments=True) for line in lines]


def within_texts(page: Path) -> Iterator[list[str]]:
    """The words of commands between backticks that go on after the verb; placeholders in capitals stay."""
    for text in re.findall(r"`cpcal ([a-z][^`]*)`", page.read_text(encoding="utf-8")):
        if "[" not in text and "..." not in text:
            yield shlex.split(text.replace("\n", " "))


def understood(words: list[str]) -> None:
    """Whether the verb is there and knows every option."""
    verb: Any = typer.main.get_command(app)
    context, rest = None, words
    while hasattr(verb, "get_command"):
        context = verb.make_context(rest[0], rest[:1], parent=context, resilient_parsing=True)
        verb, rest = verb.get_command(context, rest[0]), rest[1:]
        assert verb is not None, words
    known = {name for parameter in verb.get_params(context) for name in (*parameter.opts, *parameter.secondary_opts)}
    assert {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} <= known, words


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page) and page.stem not in OWN], ids=lambda page: page.stem
)
def test_the_commands_of_a_page_run_in_their_order(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = blocks(page)
    if not any(words[0] == "simulate" for words in commands):
        assert CliRunner().invoke(app, ["simulate", "deltalab", "-o", "campaign", "--factor", "0"]).exit_code == 0
    for words in commands:
        understood(words)
        if any(" ".join(words).startswith(key) for key in ELSEWHERE):
            continue
        added = next((more for key, more in SHORT.items() if " ".join(words).startswith(key)), [])
        added = [] if "--study" in words else added[2:] if "--legs" in words else added
        added = [*added, "--workers", "1"] if "--workers" in words else added
        outcome = CliRunner().invoke(app, [*words, *added], prog_name="cpcal")
        assert outcome.exit_code in (0, 1), (words, outcome.output[-500:])


def test_commands_within_texts_are_understood():
    found = [words for page in PAGES for words in within_texts(page)]
    found += [words for page in PAGES if page.stem in OWN for words in blocks(page)]
    assert len(found) > 15
    for words in found:
        understood(words)
