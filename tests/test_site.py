"""The documentation site: built strictly, complete, and whole without a network."""

import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

import coopmm_jax
import tuning
from coopmm_jax import cli
from coopmm_jax.kinds import cost_terms
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.scenario import catalogue
from coopmm_jax.scenario.scenario import shipped
from coopmm_jax.scenario.sections.uncertainty import shapes
from coopmm_jax.temporal_logic.signals import SIGNALS
from experiments.site import tutorials

ROOT = Path(__file__).parent.parent


class Links(HTMLParser):
    """Links, places that they can lead to, and what a page loads."""

    def __init__(self, text):
        super().__init__()
        self.targets, self.places, self.loaded = [], {""}, []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.places.add(found.get("id") or "")
        if tag == "a" and "href" in found:
            self.targets.append(found["href"])
        if tag in ("img", "script", "iframe") and "src" in found:
            self.loaded.append(found["src"])
        if tag == "link" and found.get("rel") != "canonical":
            self.loaded.append(found["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the site, of notebooks that have not been run."""
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        config = load_config(str(ROOT / "mkdocs.yml"), strict=True, site_dir=str(folder))
        config.plugins.on_startup(command="build", dirty=False)
        build(config)  # which a warning ends, as it is strict
        config.plugins.on_shutdown()
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {path: Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html") if path.name != "404.html"}


def text_of(site, page):
    return (site / page).read_text(encoding="utf-8")


def test_every_link_leads_to_a_page_and_a_place_in_it(pages):
    broken = []
    for page, links in pages.items():
        for target in (*links.targets, *links.loaded):
            url = urlsplit(target)
            if url.scheme or url.netloc:
                continue
            path = (page.parent / unquote(url.path)).resolve() if url.path else page
            places = pages[path].places if path in pages else {url.fragment}
            if not path.exists() or unquote(url.fragment) not in places:
                broken.append((page.name, target))
    assert broken == []
    assert len(pages) >= 35


def test_nothing_is_fetched_from_elsewhere(pages):
    assert {each for links in pages.values() for each in links.loaded if urlsplit(each).netloc} == set()


def test_reference_has_everything_that_the_code_has(site):
    fields = text_of(site, "reference/fields.html")
    entries = [entry for name in catalogue.sections() for entry in catalogue.entries(name) if not entry.heading]
    assert {entry.place for entry in entries if f"<code>{entry.place}</code>" not in fields} <= {
        entry.place for entry in entries if entry.place.startswith(("reference.height.", "reference.contact."))
    }
    metrics = text_of(site, "reference/metrics.html")
    assert [name for name in METRICS if f"<code>{name}</code>" not in metrics] == []
    signals = text_of(site, "reference/signals.html")
    assert [name for name in SIGNALS if f"<code>{name}</code>" not in signals] == []
    uncertainty = text_of(site, "reference/uncertainty.html")
    assert all(f"<code>{name}</code>" in uncertainty for name in shapes())
    cost = text_of(site, "reference/cost.html")
    assert all(f"<code>{name}</code>" in cost for name in cost_terms.terms())
    commands = text_of(site, "reference/commands.html")
    known = cli._parser([])._subparsers._group_actions[0].choices
    assert all(f'id="coopmm-{name}"' in commands and f"usage: coopmm {name} " in commands for name in known)
    python = text_of(site, "reference/python.html")
    assert [name for name in coopmm_jax.__all__ if not re.search(rf"[>.\s]{name}\s*<(/span|a )", python)] == []
    assert all(re.search(rf">\W*{name}\b", python) for name in tuning.__all__)


def test_every_scenario_has_its_page_with_a_picture_and_its_file(site):
    for name, path in shipped().items():
        page = text_of(site, f"scenarios/{name}.html")
        assert f'src="../{name}.png"' in page
        shown = unescape(re.sub(r"<[^>]*>", "", page))
        assert path.read_text(encoding="utf-8").strip() in shown


def test_notebooks_are_numbered_in_reading_order(site):
    assert set(tutorials.ORDER) <= set(tutorials.names())
    for number, name in enumerate(tutorials.names(), 1):
        assert re.search(rf"<h1[^>]*>{number}\. ", text_of(site, f"tutorials/{name}.html"))
    proof = text_of(site, "tutorials/proof_step_39.html")
    assert "<math " in proof
    assert "arithmatex" not in proof


def test_documents_of_the_tree_are_pages(site):
    for page in ("theory/paper_notes.html", "changelog.html", "contributing.html", "benchmarks.html", "surfaces.html"):
        assert len(text_of(site, page)) > 20_000
    assert "mechanics/plant.py" in text_of(site, "theory/equations.html")
    assert 'href="theory/paper_notes.html"' in text_of(site, "index.html")


def test_what_a_notebook_showed_is_on_its_page(monkeypatch, tmp_path):
    import nbformat

    notebook = nbformat.read(ROOT / "experiments" / "notebooks" / "first_contact.ipynb", as_version=4)
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")
    picture = {"image/png": "iVBORw0KGgo="}
    cell.outputs = [nbformat.v4.new_output("display_data", picture), nbformat.v4.new_output("stream", text="15 N\n")]
    nbformat.write(notebook, tmp_path / "first_contact.ipynb")
    monkeypatch.setattr(tutorials, "EXECUTED", tmp_path)
    pages = tutorials.pages()
    (figure,) = (path for path in pages if path.endswith(".png"))
    assert pages[figure] == b"\x89PNG\r\n\x1a\n"
    page = pages["tutorials/first_contact.md"]
    assert f"]({figure.removeprefix('tutorials/')})" in page
    assert "    15 N\n" in page
    assert "as it ran for this page" in page
    assert "as it ran for this page" not in pages["tutorials/control_law.md"]
