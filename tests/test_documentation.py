"""What the pages must keep up with."""

import re
import runpy
from pathlib import Path
from xml.etree import ElementTree

import cpcal

ROOT = Path(__file__).parent.parent


def test_the_reference_lists_every_public_name():
    listed = re.findall(r"^\.\. auto\w+:: cpcal\.(\w+)$", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.M)
    assert sorted(listed) == sorted(set(cpcal.__all__) - {"__version__"})


def test_every_page_is_in_the_site():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8").splitlines()
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= set(index)


def test_pages_name_the_formats_that_files_have_today():
    def named(*paths):
        return set(re.findall(r"\bcpcal-[a-z-]+/[0-9]+\b", "".join(path.read_text(encoding="utf-8") for path in paths)))

    written = named(*(ROOT / "cpcal").rglob("*.py"))
    assert len(written) > 10
    assert named(ROOT / "README.md", *(ROOT / "docs").glob("*.md")) <= written


def test_the_files_that_contributors_are_sent_to_are_there():
    text = "".join((ROOT / name).read_text(encoding="utf-8") for name in ("CONTRIBUTING.md", "docs/architecture.md"))
    named = re.findall(r"`((?:cpcal|contractors|tests|docs|benchmarks)/[\w./-]*)`", text)
    assert len(named) > 15
    assert not [name for name in named if "NAME" not in name and not (ROOT / name).exists()]


def test_the_citation_names_this_version():
    assert f"\nversion: {cpcal.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_drawing_of_imports_finds_floors_and_circles():
    draw = runpy.run_path(str(ROOT / "docs" / "draw_imports.py"))
    drawn = draw["arranged"]({"top", "a", "b", "low"}, {("top", "a"), ("a", "b"), ("b", "a"), ("b", "low")})
    assert drawn.floors == (("low",), ("a", "b"), ("top",))
    assert drawn.circles == (("a", "b"),)
    picture = ElementTree.fromstring(draw["svg"](drawn, "a < b"))
    assert len(picture.findall("{*}path")) == 4
    assert draw["room"]("cpcal.solver.search.search", "cpcal.solver") == "cpcal.solver.search"
    assert draw["room"]("cpcal.robot", "cpcal.solver") is None
