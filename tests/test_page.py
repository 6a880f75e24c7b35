"""Reports as pages of HTML: whole, loading nothing, with a user's text as text."""

import base64

import pytest

from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.page import CONTENT, REPORT, Page, Picture, Table, Text, html, keep_page, read_page, write_page
from tests.reading import Reading

EVIL = '</pre><script>alert("x")</script> & \'"'
PNG = b"\x89PNG\r\n\x1a\n"
PAGE = Page(
    title=f"Sweep {EVIL}",
    about=[EVIL, "second"],
    parts=[
        Table(EVIL, ("name", EVIL), [(EVIL, "-1.5e-3"), ("-", "2 of 3")]),
        Picture(EVIL, "there.png"),
        Picture("left out", "absent.png"),
        Text("Remarks", [EVIL]),
    ],
    scenario=f'description = "{EVIL}"\n',
    versions={"plugin mine.py": EVIL},
    commands=[f"coopmm sweep {EVIL}"],
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "there.png").write_bytes(PNG)
    return tmp_path


def test_text_of_a_user_stays_text(folder):
    text = html(PAGE, folder)
    assert "<script" not in text
    page = Reading(text)
    assert page.text.count("alert") == 11  # each place, and the title twice
    assert page.rows[:3] == [["name", EVIL], [EVIL, "-1.5e-3"], ["-", "2 of 3"]]
    assert page.text.endswith(PAGE.scenario)
    assert ("img", "alt", EVIL) in page.attributes


def test_it_loads_nothing_and_fits_a_narrow_screen(folder):
    page = Reading(html(PAGE, folder))
    assert {value[:22] for _, name, value in page.attributes if name in ("src", "href")} == {"data:image/png;base64,"}
    assert ("meta", "content", "width=device-width, initial-scale=1") in page.attributes
    assert any("default-src 'none'" in value for _, _, value in page.attributes)
    assert not [value for _, name, value in page.attributes if name.startswith("on")]
    assert "@media print" in html(PAGE, folder)


def test_figures_are_in_it_but_those_that_were_left_out(folder):
    page = Reading(html(PAGE, folder))
    assert page.pictures == 1
    assert ("img", "src", f"data:image/png;base64,{base64.b64encode(PNG).decode()}") in page.attributes
    assert "left out" not in page.text


def test_numbers_stand_to_the_right(folder):
    text = html(PAGE, folder)
    assert '<td class="n">-1.5e-3</td>' in text
    assert '<td class="n">2 of 3</td>' in text
    assert "<td>-</td>" in text


def test_report_makes_it_again(folder, capsys):
    keep_page(folder, PAGE)
    write_page(folder, PAGE)
    before = (folder / REPORT).read_bytes()
    assert read_page(folder / CONTENT) == PAGE._replace(parts=[part._replace(**_lists(part)) for part in PAGE.parts])
    (folder / REPORT).unlink()
    assert main(["report", str(folder)]) == 0
    assert (folder / REPORT).read_bytes() == before
    assert main(["report", str(folder), "--out", str(folder / "other")]) == 0
    assert (folder / "other" / REPORT).read_bytes() == before
    assert capsys.readouterr().out.endswith(f"written to {folder / 'other' / REPORT}\n")
    assert main(["report", str(folder), "--requirements.force-min", ">= 0"]) == 2
    said = "coopmm: error: --requirements.force_min: must be left out where no sweep is reported on, was given\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"parts": [{"kind": "film"}]}', '{"parts": [1]}', '{"parts": []}']
)
def test_what_is_no_page_is_refused(folder, content):
    (folder / CONTENT).write_text(content)
    with pytest.raises(
        UserError, match=r"^STORE\|DIR\|FILE: must be the store of a sweep, a folder of coopmm tune or comp"
    ):
        read_page(folder / CONTENT)


def _lists(part):
    """Entries that JSON turns into lists."""
    if isinstance(part, Table):
        return {"header": list(part.header), "rows": [list(row) for row in part.rows]}
    return {}
