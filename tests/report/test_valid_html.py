"""The page is HTML by the letter: no parse error; and, where the Nu checker is at hand, nothing that it minds."""

import os
import shutil
import subprocess

import pytest
from tinyhtml5.parser import HTMLParser

VNU = os.environ.get("CPCAL_VNU_JAR")  # path of vnu.jar, for instance from `npm install vnu-jar`


def errors(text):
    parser = HTMLParser()
    parser.parse(text)
    return parser.errors


def nu(file):
    """Errors and warnings, a line each."""
    command = ["java", "-jar", VNU, "--stdout", "--format", "gnu", str(file)]
    outcome = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120, check=False)
    return [line for line in outcome.stdout.splitlines() if line]


def test_it_parses_without_an_error(page, study_page):
    assert errors(page.read_text(encoding="utf-8")) == []
    assert errors(study_page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "wrong",
    [
        "<p>no doctype",
        "<!doctype html><p><div></div></p>",
        "<!doctype html><p a=1 a=2>",
        "<!doctype html><table><p></table>",
        "<!doctype html>&nosuchthing;",
        "<!doctype html><title>x<p>",
    ],
)
def test_errors_are_found(wrong):
    assert errors(wrong) != []


@pytest.mark.peers
@pytest.mark.skipif(not VNU or shutil.which("java") is None, reason="no java, or CPCAL_VNU_JAR does not name vnu.jar")
def test_the_nu_checker_finds_nothing(page, study_page, tmp_path):
    assert nu(page) == []
    assert nu(study_page) == []
    wrong = tmp_path / "wrong.html"
    wrong.write_text("<!doctype html><html lang=en><title>x</title><ul><p>y</ul>", encoding="utf-8")
    assert any("not allowed" in line for line in nu(wrong))


def test_the_page_of_a_comparison_parses_without_an_error(comparison):
    assert errors(comparison.read_text(encoding="utf-8")) == []
