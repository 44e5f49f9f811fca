"""Sections of a page on a terminal: what `cpcal.report` says of an answer, without figures."""

from __future__ import annotations

from rich.text import Text

from cpcal.cli.options import Talk
from cpcal.common.errors import printable
from cpcal.report.section import Mark, Section, Table, Words

STYLES = {  # by the kind of a verdict
    "explained": "bold green",
    "unexplained": "bold red",
    "bounded": "bold cyan",
    "undecided": "bold yellow",
    "undetermined": "bold magenta",
    "uncompared": "bold yellow",
}
_LOOKS = {**STYLES, "quantifier": "italic"}


def show(talk: Talk, *sections: Section) -> None:
    """Titles, sentences, lists, tables and data of the sections, and of their parts."""
    for section in sections:
        if section.title:
            talk.say(text_of(section.title, "bold"))
        talk.say(*map(text_of, (*section.sentences, *section.items)))
        for table in section.tables:
            show_table(talk, table)
        for name, words in section.data.items():
            talk.say(Text(f"{printable(name)}: ").append_text(text_of(words)))
        show(talk, *section.parts)


def show_table(talk: Talk, table: Table, title: str = "") -> None:
    """Names and words at the left, numbers at the right."""
    left = [k for k, (_, style, _) in enumerate(table.cells(table.head)) if not k or "word" in style]
    talk.table(table.head, [tuple(map(text_of, row)) for row in table.rows], left, title)


def text_of(words: Words, style: str = "") -> Text:
    if isinstance(words, str):
        return Text(printable(words), style=style)
    if isinstance(words, Mark):
        return text_of(words.words, next((_LOOKS[name] for name in words.style.split() if name in _LOOKS), style))
    return Text().join(text_of(part, style) for part in words)
