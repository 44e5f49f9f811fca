"""How pages are made of templates and written: text escaped and cleaned, files all or nothing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cpcal.errors import printable


def rendered(template: str, context: dict[str, Any]) -> str:
    """The page of a template in `cpcal/report/templates`."""
    environment = Environment(
        loader=PackageLoader("cpcal.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: _visible(value) if type(value) is str else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context) + "\n"


def written(page: str, file: str | os.PathLike[str]) -> Path:
    """Write a page to `file`, all or nothing, in a folder that is made if missing; its path."""
    target = Path(file)
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.partial")
    try:
        partial.write_text(page, encoding="utf-8")
        return partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _visible(text: str) -> str:
    """Hidden characters as escapes; line breaks stay, an HTML page shows them as spaces."""
    return "\n".join(printable(line) for line in text.expandtabs().split("\n"))
