"""Documents of the tree as pages of the site, and the links between them."""

from __future__ import annotations

import csv
import os
import re
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
PAGES = {  # page -> document
    "index.md": "README.md",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "theory/paper_notes.md": "experiments/paper_notes.md",
}
_MADE = {  # module whose declarations a page of the reference is made of -> that page
    "coopmm_jax/temporal_logic/grammar.py": "reference/signals.md",
    "coopmm_jax/kinds/cost_terms.py": "reference/cost.md",
}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")


def pages() -> dict[str, str | bytes]:
    """Pages by path: documents as they are, and two that are made of parts of the README."""
    found: dict[str, str | bytes] = {page: _read(document) for page, document in PAGES.items()}
    found["theory/equations.md"] = f"# Equations and files\n\n{part('Reading the code')}"
    found["benchmarks.md"] = _benchmarks()
    return found


def part(heading: str) -> str:
    """Text below a heading of the README, up to the next one."""
    match = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", _read("README.md"), flags=re.M | re.S)
    assert match is not None, heading
    return match[1].strip() + "\n"


def linked(text: str, page: str, known: set[str]) -> str:
    """Text of a page whose links lead to pages of the site; what the site does not have is named, not linked.

    Args:
        text: in Markdown.
        page: its path in the site.
        known: paths of all files of the site.

    >>> linked("[notes](../experiments/paper_notes.md) [a](../Makefile)", "surfaces.md", {"theory/paper_notes.md"})
    '[notes](theory/paper_notes.md) a'
    """
    source = PurePosixPath(_source(page)).parent

    def replaced(match: re.Match[str]) -> str:
        picture, label, target = match.groups()
        path, hash_, anchor = target.partition("#")
        if ":" in target or not path:
            return match[0]
        place = _place(os.path.normpath(source / path), page)
        if place not in known:
            return match[0] if os.path.normpath(PurePosixPath(page).parent / path) in known else label
        relative = os.path.relpath(place, PurePosixPath(page).parent)
        return f"{picture}[{label}]({relative}{hash_}{anchor})"

    return _LINK.sub(replaced, text)


def _source(page: str) -> str:
    """File of the tree that a page is, or that its links start from."""
    if page.startswith("tutorials/"):
        return f"experiments/notebooks/{page.removeprefix('tutorials/')}"
    if page in ("theory/equations.md", "benchmarks.md"):
        return "README.md"
    return PAGES.get(page, f"docs/{page}")


def _place(path: str, page: str) -> str:
    """Path in the site of a file of the tree."""
    documents = _MADE | {document: page for page, document in PAGES.items()}
    if path in documents:
        return documents[path]
    if path.startswith("experiments/notebooks/"):
        name = path.removeprefix("experiments/notebooks/")
        return f"tutorials/{name.removesuffix('.ipynb')}.md" if name.endswith(".ipynb") else f"tutorials/{name}"
    return path.removeprefix("docs/")


def _benchmarks() -> str:
    listed = re.findall(r"^\| `(?:python -m )?experiments\.benchmarks\..*$", _read("experiments/README.md"), flags=re.M)
    scripts = "\n".join(["| command | measures |", "| --- | --- |", *listed])
    with (ROOT / "docs" / "tuners.csv").open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    table = "\n".join(f"| {' | '.join(row)} |" for row in (header, ["---"] * len(header), *rows))
    return (
        f"# Benchmarks\n\nEach figure comes from one of these commands, run from the checkout:\n\n{scripts}\n\n"
        f"## Speed\n\n{part('Speed')}\n## What tuning brings\n\n{part('What tuning brings')}\n"
        f"## All runs of the comparison of tuners\n\n{table}\n"
    )


def _read(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")
