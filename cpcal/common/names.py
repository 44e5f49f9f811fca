"""What may name something, and what may be said of it: checked where names come in, for every kind of file and value.

A printable name has no line breaks, control characters, invisible or direction-changing characters and no halves of
characters, so that it stays what it looks like in every message, table and page.
"""

from __future__ import annotations

from collections.abc import Collection

NAME_MAX = 200  # characters
TEXT_MAX = 20_000

NAME_REMEDY = f"use at most {NAME_MAX} printable characters, on one line"
TEXT_REMEDY = f"write at most {TEXT_MAX:,} printable characters, on one line"
IDENTIFIER_REMEDY = f'use 1 to {NAME_MAX} printable characters, no "/", no space at the ends, not "." or ".."'


def is_name(value: object) -> bool:
    """Whether it can name a robot, a target or a field of a provenance."""
    return isinstance(value, str) and value.isprintable() and len(value) <= NAME_MAX


def is_text(value: object) -> bool:
    """Whether it can be said in a provenance."""
    return isinstance(value, str) and value.isprintable() and len(value) <= TEXT_MAX


def is_identifier(value: object) -> bool:
    """Whether it can name a pose, a run or an image; it may be a part of a file's path."""
    if not (isinstance(value, str) and is_name(value)):
        return False
    return value not in ("", ".", "..") and "/" not in value and value == value.strip()


def listed(names: Collection[str], most: int = 8) -> str:
    """The first of them, and how many more there are."""
    shown = ", ".join(list(names)[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
