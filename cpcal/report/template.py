"""How pages are made of templates: text escaped and cleaned."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cpcal.report.numbers import clean


def rendered(template: str, context: dict[str, Any]) -> str:
    """The page of a template in `cpcal/report/templates`."""
    environment = Environment(
        loader=PackageLoader("cpcal.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: clean(value) if type(value) is str else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context) + "\n"
