"""Names of files in messages: a name is text that others chose."""

from __future__ import annotations

import os


def shown_name(path: str | os.PathLike[str]) -> str:
    """The name with what is not printable, line ends among it, as an escape: it cannot forge a line or command a
    terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in os.fspath(path))
