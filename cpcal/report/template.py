"""How pages are made of templates: text escaped and cleaned."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cpcal.common.errors import printable


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


def _visible(text: str) -> str:
    """Hidden characters as escapes; line breaks stay, an HTML page shows them as spaces."""
    return "\n".join(printable(line) for line in text.expandtabs().split("\n"))
