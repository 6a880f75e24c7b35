"""Reports and the player of films in a real browser; where none is installed, their HTML is read instead."""

import re

import pytest

import coopmm_jax as cm
from coopmm_jax.animation.film import animate
from coopmm_jax.page import Page, Picture, Table, Text, write_page
from coopmm_jax.plotting.style import save
from coopmm_jax.sweeps import figures, report
from tests import browser
from tests.reading import Reading
from tests.test_page import EVIL

LONG = "long_words_that_cannot_be_broken_" * 9


@pytest.fixture(scope="module")
def pages(kept, simulated_paper, tmp_path_factory):
    """Pages of a sweep, of a report full of hostile text, and of a film of two runs."""
    folder = tmp_path_factory.mktemp("pages")
    report.write_report(folder, kept)
    save(figures.sweep_requirements(kept), folder / "picture.png")
    wide = Table(EVIL, ("name", *(f"column {i}" for i in range(20))), [(LONG, *["1.2345e-10"] * 20)])
    page = Page(EVIL, [EVIL, LONG], [wide, Picture(EVIL, "picture.png"), Text(EVIL, [LONG])], LONG, {}, [LONG])
    write_page(folder, page, "hostile.html")
    short = cm.load_scenario("paper", simulation={"duration": 0.05, "step": 0.001})
    animate(cm.simulate(short), cm.simulate(short), path=folder / "film.html", width=480)
    return [folder / name for name in ("report.html", "hostile.html", "film.html")]


def test_pages_fit_a_phone_and_a_screen(pages, tmp_path):
    if browser.PROGRAM is None:
        _read(pages)
        return
    found = browser.measured(tmp_path, pages)
    assert [each["width"] for each in found] == [browser.NARROW, browser.WIDE] * len(pages)
    for each in found:
        assert each["content"] <= each["width"], "wider than the screen"
        assert all(size > 100 for size in each["pictures"]), "a picture that is not shown"
    sweep, _, hostile, _, narrow, wide = found
    assert len(sweep["pictures"]) == 4
    assert (hostile["scripts"], hostile["text"].count("alert(")) == (0, 5)
    assert (narrow["rows"], wide["rows"]) == (2, 1), "runs below one another on a phone, else side by side"
    assert narrow["ink"] == wide["ink"] == [True, True]
    assert narrow["shown"] is not None


def test_a_report_is_printed_whole(pages, tmp_path):
    if browser.PROGRAM is None:
        _read(pages)
        return
    assert 3 <= browser.printed(tmp_path, pages[0]) <= 12


def _read(pages):
    """Tables and figures lie in boxes that scroll; the player has a canvas for each run."""
    for page in pages[:2]:
        text = page.read_text(encoding="utf-8")
        content = Reading(text)
        assert text.count('<div class="wide">') == text.count("<table>") + content.pictures
        assert ".wide { overflow-x: auto }" in text
        assert "overflow-wrap: break-word" in text
        assert "<script" not in text
    assert re.search(r'"cuts": \[0, 240, 480\]', pages[2].read_text(encoding="utf-8"))
