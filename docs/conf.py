"""How Sphinx renders the pages of this repository: `make docs`; warnings are errors.

The source folder is the repository, so that links between README, docs and benchmarks are the same here and in a
browser of the repository.
"""

import re
from typing import Any

from cpcal.common.version import __version__

project = "cpcal"
author = "cpcal developers"
copyright = author
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_gallery.gen_gallery"]
root_doc = "docs/index"
include_patterns = ["*.md", "docs/*.md", "docs/gallery/*.rst", "benchmarks/**.md"]
exclude_patterns = [".*", "build", "demo", "cpcal", "contractors", "tests"]
html_theme = "furo"
html_title = f"cpcal {__version__}"

myst_heading_anchors = 4
autodoc_typehints = "none"  # signatures are long; the docstrings say what each argument is
autodoc_default_options = {"members": True, "member-order": "bysource"}
add_module_names = False
suppress_warnings = ["config.cache"]  # a class among the options of the gallery

sphinx_gallery_conf = {
    "examples_dirs": "docs/examples",
    "gallery_dirs": "docs/gallery",
    "ignore_pattern": r"(?<!plot_)hangprinter",  # needs real data
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "abort_on_example_error": True,
}

_CODE = re.compile(r"(`+[^`]+`+)")
_COLUMNS = re.compile(r"\S {2,}\S")


def _as_rst(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code` and aligned columns; all else that would be markup is escaped."""
    paragraphs = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(_paragraph, paragraphs)).split("\n")


def _paragraph(text: str) -> str:
    if _COLUMNS.search(text.split("\n")[0]):
        return "::\n\n" + "\n".join(f"    {line}" for line in text.split("\n"))
    parts = _CODE.split(text)
    parts[1::2] = [f"``{part.strip('`')}``" for part in parts[1::2]]
    parts[::2] = [re.sub(r"([*|_\\])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", _as_rst)
