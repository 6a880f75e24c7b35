"""A report as one page of HTML that needs nothing else: tables, figures, settings, versions, how to reproduce it.

It loads nothing and runs nothing, is read on a narrow screen and in print, and shows whatever text a user has put into
names and descriptions as text.

>>> made = Page("Sweep", ["1 < 2"], [Table("met", ("name", "share"), [("a", "0.5")])], "", {}, [])
>>> "<p>1 &lt; 2</p>" in html(made, Path())
True
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from coopmm_jax.errors import UserError
from coopmm_jax.files import read_json, write_json, write_text

REPORT, CONTENT = "report.html", "page.json"
_LONG = 40  # characters of a cell that reads like a sentence
_NUMBER = re.compile(r"[-+]?(\d|\.\d|(inf|nan)\b)[^_]*")  # with what may follow it, as " of 3"; no file's name
_STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; color: #222; background: #fff }
body { max-width: 60rem; margin: 0 auto; padding: 1rem; overflow-wrap: break-word }
h1 { font-size: 1.6rem; margin: 0.5rem 0 } h2 { font-size: 1.2rem; margin: 2rem 0 0.5rem }
.wide { overflow-x: auto } table { border-collapse: collapse; font-size: 0.9rem }
th, td { padding: 0.25rem 0.6rem; text-align: left; border-bottom: 1px solid #ddd; vertical-align: top }
.n { text-align: right } td.n { white-space: nowrap; font-variant-numeric: tabular-nums } td.text { min-width: 16rem }
figure { margin: 1rem 0 } img { max-width: 100%; height: auto } figcaption { font-size: 0.9rem; color: #555 }
pre { background: #f5f5f5; padding: 0.75rem; overflow-x: auto; font-size: 0.8rem }
@media (max-width: 40rem) { figure .wide img { max-width: none; width: 40rem } }
@media print {
  body { max-width: none; font-size: 10pt } pre { white-space: pre-wrap; overflow-wrap: anywhere }
  h2 { break-after: avoid } figure, tr { break-inside: avoid } .wide { overflow: visible }
  img { max-height: 92vh; width: auto } /* no figure is cut at the end of a page */
  table { font-size: 7.5pt } th, td { padding: 0.15rem 0.35rem } td.text { min-width: 11rem }
  pre.settings { columns: 2; font-size: 7pt }
}
"""


class Table(NamedTuple):
    """Rows of text below their names."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


class Picture(NamedTuple):
    """A PNG file of the report's folder."""

    title: str
    file: str


class Text(NamedTuple):
    """Sentences, a paragraph each."""

    title: str
    lines: Sequence[str]


class Page(NamedTuple):
    """Content of a report."""

    title: str
    about: Sequence[str]
    parts: Sequence[Table | Picture | Text]
    scenario: str  # as a scenario file
    versions: Mapping[str, str]
    commands: Sequence[str]  # that make the results again


_PARTS = {"table": Table, "picture": Picture, "text": Text}


def write_page(folder: Path, page: Page, name: str = REPORT) -> None:
    """Write the page into the folder of its figures; one that is not there has been left out."""
    write_text(folder / name, html(page, folder))


def keep_page(folder: Path, page: Page, name: str = CONTENT) -> None:
    """Write what the page is made of, for ``read_page``."""
    kinds = {made: kind for kind, made in _PARTS.items()}
    parts = [{"kind": kinds[type(part)]} | part._asdict() for part in page.parts]
    write_json(folder / name, page._asdict() | {"parts": parts})


def read_page(path: Path) -> Page:
    """Content of a page, from the file that ``keep_page`` has written.

    Raises:
        UserError: it is damaged, or another file.
    """
    try:
        found = read_json(path)
        parts = [_PARTS[part.pop("kind")](**part) for part in found.pop("parts")]
        page = Page(parts=parts, **found)
        html(page, path.parent)
        return page
    except (AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        must = "the store of a sweep, a folder of coopmm tune or compare, or a file of coopmm falsify"
        raise UserError("STORE|DIR|FILE", must, f"{path} ({error})") from None


def html(page: Page, folder: Path) -> str:
    """Text of the page, with the figures of a folder in it."""
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
            "style-src 'unsafe-inline'\">",
            f"<title>{escape(page.title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>",
            f"<h1>{escape(page.title)}</h1>",
            *_paragraphs(page.about),
            *(line for part in page.parts for line in _part(part, folder)),
            "<h2>How to reproduce it</h2>\n<p>Save the settings below as scenario.toml, then:</p>",
            f"<pre>{escape(chr(10).join(page.commands))}</pre>",
            *_table(("software", "version"), page.versions.items()),
            f'<h2>Settings</h2>\n<pre class="settings">{escape(page.scenario)}</pre>\n</body>\n</html>\n',
        ]
    )


def _part(part: Table | Picture | Text, folder: Path) -> Iterator[str]:
    if isinstance(part, Picture):
        path = folder / part.file
        if path.exists():
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            yield f'<figure><div class="wide"><img alt="{escape(part.title)}" src="data:image/png;base64,{data}"></div>'
            yield f"<figcaption>{escape(part.title)}</figcaption></figure>"
        return
    yield f"<h2>{escape(part.title)}</h2>"
    yield from _paragraphs(part.lines) if isinstance(part, Text) else _table(part.header, part.rows)


def _table(header: Sequence[str], rows: Iterable[Iterable[Any]]) -> Iterator[str]:
    yield '<div class="wide"><table>'
    rows = [list(row) for row in rows]
    ends = rows[0] if rows else []
    kinds = [_kind(ends[i]) if i < len(ends) else "" for i, _ in enumerate(header)]
    names = "".join(f"<th{kind}>{escape(cell)}</th>" for kind, cell in zip(kinds, header, strict=True))
    yield f"<thead><tr>{names}</tr></thead>"  # which stands again on each page in print
    for row in rows:
        yield f"<tr>{''.join(map(_cell, row))}</tr>"
    yield "</table></div>"


def _cell(text: str) -> str:
    return f"<td{_kind(text)}>{escape(text)}</td>"


def _kind(text: str) -> str:
    """Class of a cell: numbers stand to the right, sentences need room."""
    return ' class="n"' if _NUMBER.fullmatch(text) else ' class="text"' if len(text) > _LONG else ""


def _paragraphs(lines: Iterable[str]) -> Iterator[str]:
    return (f"<p>{escape(line)}</p>" for line in lines)
