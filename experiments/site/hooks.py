"""Hooks of MkDocs: made pages beside those of docs/, links between documents of the tree, formulas as MathML.

    python -m mkdocs build --strict

builds the site; ``make docs`` runs the notebooks first, so that their figures are in it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import latex2mathml.converter
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from experiments.site import documents, reference, scenarios, tutorials

ROOT = Path(__file__).parents[2]
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[([](.*?)\\[)\]]</\1>', flags=re.DOTALL)
_made: dict[str, str | bytes] = {}  # path in the site -> content


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Make all pages, and put those of notebooks, of scenarios and of other documents into the navigation."""
    _made.clear()
    for source in (documents, reference, scenarios, tutorials):
        _made.update(source.pages())
    config.nav = [_filled(entry, Path(config.docs_dir)) for entry in config.nav or []]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the made pages to those of docs/."""
    for path, content in _made.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Text of a page with its links to files of the tree as links to the site's pages."""
    return documents.linked(markdown, page.file.src_uri, set(files.src_uris))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """HTML of a page with its formulas as MathML, which browsers show without a script."""
    return _FORMULA.sub(_mathml, html)


def _mathml(match: re.Match[str]) -> str:
    text = match[2].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    display = "block" if match[1] == "div" else "inline"
    return latex2mathml.converter.convert(text, display=display)


def _filled(entry: Any, docs: Path) -> Any:
    """Entry of the navigation, with the pages that it stands for."""
    (title, pages), *_ = entry.items()
    if not isinstance(pages, list):
        return entry
    found: list[Any] = []
    for page in pages:
        folder = page.removesuffix("*") if isinstance(page, str) and page.endswith("/*") else None
        found += [path for path in _made if path.startswith(folder) and path.endswith(".md")] if folder else [page]
    if title == "How to":  # documents that lie in docs/ and are named nowhere else
        named = {path for each in found for path in each.values()}
        found += [path.name for path in sorted(docs.glob("*.md")) if path.name not in {*named, "start.md"}]
    return {title: found}
