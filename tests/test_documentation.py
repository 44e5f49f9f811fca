"""What the pages must keep up with; docs/your-data.md lists what the readers accept, the notebook runs."""

import json
import pickle
import re
import runpy
import shlex
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli.app import app
from cpcal.files import load_settings
from cpcal.robot import ROBOTS
from cpcal.robot.units import override_columns, reading_columns

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


DOCS = Path(__file__).parent.parent / "docs"
PAGE = (DOCS / "your-data.md").read_text(encoding="utf-8")
DATA = DOCS / "examples" / "data"


def rows(title):
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if "| `" in line]


def accepted(folder, where):
    """The keys that the reader says there are, when it is given one that there is not."""
    text = (DATA / "by-sigma" / "campaign.toml").read_text(encoding="utf-8")
    sections = text if where != "[model]" else text + '[model]\nname = "gain"\n'
    wrong = "zzzzzz = 1\n"
    broken = wrong + sections if where == "" else sections.replace(f"{where}\n", f"{where}\n{wrong}")
    (folder / "campaign.toml").write_text(broken, encoding="utf-8")
    with pytest.raises(cpcal.InputError) as caught:
        load_settings(folder)
    (problem,) = (each for each in caught.value.problems if "unknown key" in each.what)
    return set(problem.remedy.removeprefix("the keys there are: ").split(", "))


def test_the_reference_lists_exactly_the_keys_that_the_reader_accepts(tmp_path):
    listed = {}
    for where, key, *_ in rows("campaign.toml"):
        listed.setdefault(where.strip("`"), set()).add(key.strip("`[]"))
    assert set(listed) == {"", "[robot]", "[uncertainty]", "[model]"}
    for where, keys in listed.items():
        assert keys == accepted(tmp_path, where), where


def test_the_reference_lists_exactly_the_columns_that_the_reader_accepts():
    names = {name for row in rows("measurements.csv") for name in re.findall(r"`(\w+)`", row[0])}
    assert {name.replace("Ln", "L2") for name in names} == {*reading_columns(2), *override_columns(2)}
    required = {name for row in rows("measurements.csv") if row[2] == "yes" for name in re.findall(r"`(\w+)`", row[0])}
    assert {name.replace("Ln", "L2") for name in required} == set(reading_columns(2))


def test_the_keys_that_are_called_required_are_missed_when_they_are_left_out(tmp_path):
    text = (DATA / "by-sigma" / "campaign.toml").read_text(encoding="utf-8")
    for where, key, _, required, _ in rows("campaign.toml"):
        if where != "`[robot]`":
            continue
        assert required == "yes"
        without = re.sub(rf"(?ms)^{key.strip('`')} = .*?(?=^\w+ = |^\[)", "", text)
        (tmp_path / "campaign.toml").write_text(without, encoding="utf-8")
        with pytest.raises(cpcal.InputError, match=f"the key '{key.strip('`')}' is missing"):
            load_settings(tmp_path)


@pytest.mark.parametrize("name", ["by-sigma", "by-half-width", "exact"])
def test_every_example_is_a_campaign_in_which_nothing_looks_wrong(name):
    campaign = cpcal.load_campaign(DATA / name)
    assert campaign.exact == (name == "exact")
    assert cpcal.check_data(campaign).good


def test_the_robots_of_the_page_are_those_of_the_catalogue():
    assert {row[0].strip("`") for row in rows("Robots that cpcal knows")} == set(ROBOTS)


def test_every_command_of_the_page_runs(tmp_path, monkeypatch):
    shutil.copytree(DATA, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    block = "\n".join(line[4:] for line in PAGE.splitlines() if line.startswith("    "))
    commands = [shlex.split(line) for line in block.replace("\\\n", " ").splitlines()]
    assert len(commands) == 9
    for command in commands:
        assert command[0] == "cpcal"
        more = ["--legs", "1"] if command[1] == "certify" else []  # one leg tells as much as six
        outcome = CliRunner().invoke(app, command[1:] + more)
        assert outcome.exit_code == 0, (command, outcome.output)
    found, true = (cpcal.load_campaign(name) for name in ("campaign", "capture"))
    assert found.length == pytest.approx(true.length)
    assert found.position == pytest.approx(true.position, abs=3.0)  # in frames that the drawing tells to some mm


def test_messages_on_files_point_to_the_page_also_from_another_process(tmp_path):
    with pytest.raises(cpcal.InputError, match=r"See docs/your-data\.md") as caught:
        cpcal.load_campaign(tmp_path)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


NOTEBOOK = Path(__file__).parent.parent / "docs" / "notebook.ipynb"


@pytest.mark.filterwarnings("ignore")  # of IPython's own
def test_the_notebook_runs_and_shows_its_figures(capsys):
    pytest.importorskip("IPython")
    from IPython.core.interactiveshell import InteractiveShell
    from traitlets.config import Config

    cells = [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in cells), "outputs are not kept"
    shell = InteractiveShell(config=Config(HistoryManager={"enabled": False}))
    shown = []
    for cell in cells:
        found = shell.run_cell("".join(cell["source"]))
        found.raise_error()
        shown.append(shell.display_formatter.format(found.result)[0])
    assert sum("image/svg+xml" in data or "<svg" in data.get("text/html", "") for data in shown) == 2
    said = capsys.readouterr().out
    assert said.count("proved, ") == 3
    assert said.count("; within ") == 3  # the recommended parameters of each leg
