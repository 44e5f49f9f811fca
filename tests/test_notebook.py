"""docs/notebook.ipynb runs, cell by cell, and shows figures."""

import json
from pathlib import Path

import pytest

pytest.importorskip("IPython")

NOTEBOOK = Path(__file__).parent.parent / "docs" / "notebook.ipynb"


@pytest.mark.filterwarnings("ignore")  # of IPython's own
def test_the_notebook_runs_and_shows_its_figures(capsys):
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
