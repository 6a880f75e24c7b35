"""Commands and code that READMEs and guide tell a reader to type: every one, as a reader meets it, but small.

All in one process, as they are of one loop, which is then compiled once.
"""

import re

import pytest
from PIL import Image

from coopmm_jax.scenario.overrides import split
from coopmm_jax.scenario.scenario import load_scenario
from experiments import readme_media
from tests.pages import ROOT, blocks, carried_out, commands, lines
from tests.plugin_page import files
from tests.small_commands import GUIDE, README, SHORT_TUNING

MAKE = ("make demo", "make test", "make docs")
READMES = [(ROOT / folder / "README.md").read_text(encoding="utf-8") for folder in (".", "experiments")]
FOUND = list(dict.fromkeys(command for text in READMES for command in commands(text)))
COMMANDS = [command for command in FOUND if command not in MAKE]
BLOCKS = [block for text in READMES for block in blocks(text)]

PAGES = ("own_robots", "own_task", "own_requirement", "own_optimiser", "results", "cluster")
TEXTS = {page: (ROOT / "docs" / "howto" / f"{page}.md").read_text(encoding="utf-8") for page in PAGES}
START = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")


def small(command):
    """Words that make a command of the guide small: those of the longest beginning that is known."""
    return GUIDE[max((start for start in GUIDE if command.startswith(start)), key=len)]


def jobs(page):
    """Commands and blocks of a page of the guide."""
    found = [("command", line, small(line)) for line in lines(TEXTS[page])]
    return found + [("block", block, []) for block in blocks(TEXTS[page])]


def given(text):
    """Files of a page by name."""
    points = re.findall(r"^```csv\n# (\S+)\n(.*?)^```$", text, flags=re.M | re.S)
    return files(text) | dict(points)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of the READMEs' reader."""
    folder = tmp_path_factory.mktemp("reader")
    (folder / "short_tuning.toml").write_text(load_scenario("sensed", **split(SHORT_TUNING)[1]).to_toml(), "utf-8")
    return folder


@pytest.fixture(scope="module")
def results(folder, tmp_path_factory):
    """Outcomes of the commands and blocks of the READMEs and of the guide, in order: some need what others wrote."""
    newcomer = tmp_path_factory.mktemp("newcomer")
    for text in TEXTS.values():
        for name, content in given(text).items():
            (newcomer / name).write_text(content, encoding="utf-8")
    known = [("command", command, README[command]) for command in COMMANDS if command in README]
    first = [("block", block, []) for block in blocks(START)]
    return carried_out(
        (folder, [*known, *(("block", block, []) for block in BLOCKS)]),
        (newcomer, [*first, *(job for page in PAGES for job in jobs(page))]),
    )


@pytest.fixture(scope="module")
def readme(results):
    return results[0]


@pytest.fixture(scope="module")
def guide(results):
    return results[1]


def test_commands_are_found_in_all_kinds_of_code():
    text = "`coopmm a --b 1` and `else`\n\n    make c  # why\n\n```sh\npython -m d\n```\n```python\ncoopmm = 1\n```\n"
    assert sorted(commands(text)) == ["coopmm a --b 1", "make c", "python -m d"]
    assert blocks(text) == ["coopmm = 1\n"]
    assert len(COMMANDS) >= 15
    assert len(BLOCKS) >= 2


def test_every_command_has_its_small_size():
    assert [command for command in COMMANDS if command not in README] == [], "say in README what makes them small"
    assert [command for command in README if command not in COMMANDS] == [], "no README has these any more"


@pytest.mark.parametrize("command", COMMANDS)
def test_command(readme, folder, command):
    assert command in readme, f"{command}: say in README what makes it small"
    assert readme[command]["outcome"] == 0, readme[command]["said"]
    words = command.split()
    assert "--out" not in words or (folder / words[words.index("--out") + 1]).exists()


def test_pictures_are_written_at_the_committed_ones_size(readme, folder):
    written = sorted(path.name for path in (folder / "docs").iterdir())
    assert written == ["contact_force.png", "robots.gif", "tuning.png"]
    for name in written:
        with Image.open(folder / "docs" / name) as written, Image.open(ROOT / "docs" / name) as committed:
            assert written.format == committed.format
            assert written.width == committed.width
            assert (ROOT / "docs" / name).stat().st_size < 1.5e6
    with Image.open(ROOT / "docs" / "robots.gif") as committed:
        assert committed.n_frames == round(25 * readme_media.TURN) + 1


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[0])
def test_python_block(readme, block):
    values = readme[block]["outcome"]
    assert isinstance(values, list), values
    assert [found for _, found in values] == pytest.approx([said for said, _ in values], rel=1e-3)


def test_numbers_that_the_blocks_show_are_compared(readme):
    assert sum(len(readme[block]["outcome"]) for block in BLOCKS) >= 1


def test_make_has_all_targets_and_every_change_is_tested():
    assert sorted(command for command in FOUND if command.startswith("make ")) == sorted(MAKE)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for command in MAKE:
        assert re.search(rf"^{command.split()[1]}:.*\n\t", makefile, flags=re.MULTILINE)
    assert (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1] == "exec make test"


@pytest.mark.parametrize("page", PAGES)
def test_page_of_the_guide(guide, page):
    told = [text for _, text, _ in jobs(page)]
    assert len(told) >= 2
    for text in told:
        outcome = guide[text]["outcome"]
        assert isinstance(outcome, list) or outcome == 0, f"{text}\n{outcome}\n{guide[text]['said'][-2000:]}"


def test_no_two_pages_use_one_command_or_place():
    told = [line for text in TEXTS.values() for line in lines(text)]
    places = [match[1] for line in told if "--resume" not in line and (match := re.search(r"--out (\S+)", line))]
    assert len(set(told)) == len(told)
    assert len(set(places)) == len(places) - 1  # two processes share one


def test_the_first_page_has_commands_of_the_readme_and_a_block_that_runs(guide):
    (block,) = blocks(START)
    assert isinstance(guide[block]["outcome"], list), guide[block]["outcome"]
    known = {*README, *MAKE, "pip install -c constraints.txt ."}
    assert [line for line in lines(START) if line not in known] == []
    assert len(lines(START)) >= 8


def test_commands_in_the_text_are_commands():
    named = [command for text in TEXTS.values() for command in commands(text) if command.startswith("coopmm ")]
    known = (*GUIDE, "coopmm help", "coopmm metrics")
    assert all(any(command.startswith(start) for start in known) for command in named)
