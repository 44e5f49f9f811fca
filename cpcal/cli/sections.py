"""Sections of a page on a terminal: what `cpcal.report` says of an answer, without figures."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from cpcal.common.errors import printable
from cpcal.report.section import Mark, Section, Table, Words

STYLES = {  # by the kind of a verdict
    "explained": "bold green",
    "unexplained": "bold red",
    "bounded": "bold cyan",
    "undecided": "bold yellow",
    "undetermined": "bold magenta",
    "uncompared": "bold yellow",
    "quantifier": "italic",
}


def show(console: Console, sections: Sequence[Section]) -> None:
    """Titles, sentences, lists, tables and data of the sections, and of their parts."""
    for section in sections:
        if section.title:
            console.print(text_of(section.title, "bold"), soft_wrap=True)
        for words in (*section.sentences, *section.items):
            console.print(text_of(words), soft_wrap=not console.is_terminal)
        for table in section.tables:
            console.print(table_of(table))
        for name, words in section.data.items():
            console.print(Text(f"{printable(name)}: ").append_text(text_of(words)), soft_wrap=True)
        show(console, section.parts)


def text_of(words: Words, style: str = "") -> Text:
    if isinstance(words, str):
        return Text(printable(words), style=style)
    if isinstance(words, Mark):
        return text_of(words.words, next((STYLES[name] for name in words.style.split() if name in STYLES), style))
    return Text().join(text_of(part, style) for part in words)


def table_of(table: Table) -> RichTable:
    """Names and words at the left, numbers at the right."""
    found = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for k, (_, style, name) in enumerate(table.cells(table.head)):
        found.add_column(printable(name), justify="left" if not k or "word" in style else "right", overflow="fold")
    for row in table.rows:
        found.add_row(*map(text_of, row))
    return found
