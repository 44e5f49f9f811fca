"""What a page is made of: sections of sentences, tables and figures. A terminal prints the same, but for figures.

Text is text: it is escaped, and hidden characters are shown. Markup is ours alone: figures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from markupsafe import Markup, escape

from cpcal.common.errors import printable
from cpcal.common.files import write_file
from cpcal.common.version import __version__

if TYPE_CHECKING:
    from jinja2 import Template

    from cpcal.report.figures import Svg

_PACKAGES = ("numpy", "scipy", "python-flint")


class Mark(NamedTuple):
    """Words that look otherwise (`style`, of report.css), lead somewhere, or that the page checks (`data`)."""

    words: Words
    style: str = ""
    link: str = ""
    data: Mapping[str, str] = {}


Words = str | Mark | Sequence["Words"]


class Table(NamedTuple):
    """`head` names the columns. `columns`: styles of the first ones; `style`: of the whole.

    `most`: so many rows are shown, and a note says how many more there are, and in which file (`where`).
    """

    head: Sequence[str]
    rows: Sequence[Sequence[Words]]
    columns: Sequence[str] = ()
    style: str = ""
    most: int | None = None
    where: str = ""

    def cells(self, row: Sequence[Words]) -> list[tuple[Words, str, str]]:
        """Each with the style and the name of its column."""
        styles = [*self.columns, *("" for _ in self.head)]
        return list(zip(row, styles, self.head, strict=False))

    def rest(self) -> str:
        """A note on the rows that are not shown."""
        more = 0 if self.most is None else len(self.rows) - self.most
        return f"And {more:,} more, in {self.where}." if more > 0 else ""


class Picture(NamedTuple):
    """A JPEG, in base64, and its width and height."""

    caption: str
    base64: str
    size: tuple[int, int]


class Drawing(NamedTuple):
    """Figures, or pictures, each with its words, under one caption.

    `legend`: what signs mean, by their styles; words alone have none, and a sign that is markup already stays.
    """

    figures: Sequence[Svg] = ()
    legend: Mapping[str, Words] = {}
    caption: Words = ""
    pictures: Sequence[tuple[Picture, Words]] = ()

    def _repr_html_(self) -> str:
        """For notebooks: the figures alone, in light colours."""
        return "".join(figure.document() for figure in self.figures)


class Section(NamedTuple):
    """In this order: sentences, a list of `items`, figures, tables, `data` by name, small `notes`, and further `parts`.

    `title` begins with words alone. `beside`: figures at the right of all that. `folded`: the title alone is seen at
    first, and on paper nothing.
    """

    title: str | Sequence[Words] = ""
    sentences: Sequence[Words] = ()
    items: Sequence[Words] = ()
    figures: Sequence[Drawing] = ()
    tables: Sequence[Table] = ()
    data: Mapping[str, Words] = {}
    notes: Sequence[Words] = ()
    parts: Sequence[Section] = ()
    beside: Sequence[Drawing] = ()
    name: str = ""
    style: str = ""
    folded: bool = False


class Proof(NamedTuple):
    """What a page holds so that it can check itself; made by us, or base64.

    data     JSON: the campaign and the certificates, deflated
    checker  the certificate checker; it runs in a worker only
    script   the page's own script; source  its name in a content security policy
    compared what is compared with the certificates, and what is not
    """

    data: Markup
    checker: Markup
    script: Markup
    source: str
    compared: str


class Page(NamedTuple):
    """One file of HTML that loads nothing. `kicker`: what kind of page it is; `notices` stand above all answers."""

    title: str
    kicker: str
    heading: str
    sections: Sequence[Section]
    notices: Sequence[Words] = ()
    lead: Words = ""
    proof: Proof | None = None

    def text(self) -> str:
        """The same sections give the same text."""
        return _template().render(
            page=self,
            pictures=any(drawing.pictures for section in self.sections for drawing in section.figures),
            contents=[(s.name, s.title if isinstance(s.title, str) else s.title[0]) for s in self.sections if s.name],
        )

    def write(self, file: Path) -> Path:
        """Write the file, all or nothing; its path. Raises InputError."""
        return write_file(file, self.text())


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cpcal.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["html"] = html
    return environment.get_template("page.html.j2")


def html(words: Words) -> Markup:
    if isinstance(words, Markup):
        return words
    if isinstance(words, str):  # hidden characters as escapes; line breaks stay, HTML shows them as spaces
        return escape("\n".join(printable(line) for line in words.expandtabs().split("\n")))
    if not isinstance(words, Mark):
        return Markup("".join(map(html, words)))
    given = {"class": words.style, "href": words.link, **{f"data-{name}": value for name, value in words.data.items()}}
    attributes = (f' {name}="{escape(value)}"' for name, value in given.items() if value or name.startswith("data-"))
    tag = "a" if words.link else "span"
    return Markup(f"<{tag}{''.join(attributes)}>{html(words.words)}</{tag}>")


def verdict(word: Words, kind: str, **data: str) -> Mark:
    """A badge in the colour of a kind of verdict."""
    return Mark(word, f"verdict {kind}", data=data)


def origin(data: Mapping[str, Words], by: str = "") -> Section:
    """The last section: where a page comes from; `by`: a sentence on what found its answers."""
    from importlib.metadata import version  # here: `verify` starts sooner without

    versions = ", ".join([f"cpcal {__version__}", *(f"{name} {version(name)}" for name in _PACKAGES)])
    written = f"{by} This page was written by {versions}.".lstrip()
    return Section("Where it comes from", data={**data, "Versions": written}, name="origin")
