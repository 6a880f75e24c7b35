"""Documents for contributors and readers: the files they name exist, versions agree, the citation can be read."""

import re
from pathlib import Path

import pytest
import yaml

import coopmm_jax

ROOT = Path(__file__).parent.parent
PAGES = (
    "README.md",
    "docs/controllers.md",
    "docs/controllers_study.md",
    "docs/plugins.md",
    "docs/start.md",
    "docs/surfaces.md",
    *(f"docs/howto/{path.name}" for path in sorted((ROOT / "docs" / "howto").glob("*.md"))),
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "experiments/README.md",
    "experiments/paper_notes.md",
)
FOLDERS = ("coopmm_jax", "tuning", "experiments", "tests", "docs")


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_names_exist(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    named = [path for path in re.findall(r"`([\w./]+)`", text) if path.split("/")[0] in FOLDERS and "/" in path]
    linked = re.findall(r"\]\(([^)#:]+)\)", text)
    assert [path for path in named if not (ROOT / path).exists()] == []
    assert [path for path in linked if not (ROOT / page).parent.joinpath(path).exists()] == []


def test_citation_has_what_its_format_demands():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["cff-version"] == "1.2.0"
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= paper.keys()


def test_changelog_and_citation_are_of_this_version():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## (\d\S+) - (\S+)$", changelog, flags=re.MULTILINE)
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    latest = (citation["version"], str(citation["date-released"]))
    assert released[0] == latest
    assert coopmm_jax.__version__ == latest[0]
