"""Consoles: what verbs print goes through one."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from cpcal.common.errors import printable

_WIDE = 120  # where there is no terminal to fit


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def terminal(*, stderr: bool = False, quiet: bool = False) -> Console:
    """A console that prints text as it is, but for hidden characters; a quiet one prints nothing."""
    console = _Terminal(stderr=stderr, quiet=quiet, markup=False, emoji=False, highlight=False)
    if not console.is_terminal:
        console.width = _WIDE
    return console
