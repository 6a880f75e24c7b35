"""Pages of the documentation for newcomers: each file, command and block of Python, as a reader meets them, but small.

Commands that the READMEs have as well are carried out by the tests of those.
"""

import re
import shlex
from pathlib import Path

import pytest

from tests import test_readme
from tests.plugin_page import files
from tests.test_readme import COMPARED, MAKE, SHORT, SHORT_TUNING, blocks, carried_out, commands

DOCS = Path(__file__).parent.parent / "docs"
PAGES = ("own_robots", "own_task", "own_requirement", "own_optimiser", "results", "cluster")
TEXTS = {page: (DOCS / "howto" / f"{page}.md").read_text(encoding="utf-8") for page in PAGES}
START = (DOCS / "start.md").read_text(encoding="utf-8")
FULL = shlex.split("--law.feedforward full")  # the programs of sensed, which others compile
# Windows that begin within a short run; what else the sentences say is as on the page.
TIMELY = [
    *("--simulation.duration", "0.1", "--requirements.keeps-pressing", "always[0.05, 20] contact_force >= 5"),
    *("--requirements.follows.require", "always[0.05, inf] abs(contact_force - desired_force) <= 3"),
]
SWEPT = shlex.split("--samples 16 --batch 16 --keep 2")

# The words that make small what begins so; none where the scenario file that is named is small itself.
SMALL = {
    "coopmm init mine.toml": [*SHORT_TUNING, *shlex.split("--loop.control-period 0.001")],
    "coopmm init round.toml": [*SHORT, *shlex.split("--reference.path.order 1 --reference.path.tolerance 1")],
    "coopmm init": SHORT,
    "coopmm help": [],
    "coopmm simulate mine.toml": FULL,
    "coopmm simulate sensed": SHORT,
    "coopmm simulate": [],
    "coopmm simulate timely.toml": [*FULL, *TIMELY],
    "coopmm sweep mine.toml": [*FULL, *SWEPT],
    "coopmm sweep timely.toml": [*FULL, *TIMELY, *SWEPT],
    "coopmm sweep sensed --samples 4096 --rank": [*SHORT, *shlex.split("--samples 32 --batch 16 --keep 2")],
    "coopmm sweep sensed --samples 8192 --resume": [*SHORT, *shlex.split("--samples 48 --batch 16 --keep 2")],
    "coopmm sweep": [*SHORT, *SWEPT],
    "coopmm tune": [*SHORT_TUNING, *shlex.split("--tuning.optimiser cma")],
    "coopmm compare": COMPARED,
    "coopmm report": [],
    "coopmm falsify": [],  # in the text alone, as the next
    "coopmm check": [],
}


def small(command):
    """Words that make a command small: those of the longest beginning that is known."""
    return SMALL[max((start for start in SMALL if command.startswith(start)), key=len)]


def lines(text):
    """Commands of a page that stand in lines of their own."""
    whole = re.sub(r"^```\w*\n.*?^```$", "", text, flags=re.M | re.S)
    return re.findall(r"^ {4}((?:coopmm|make|pip) .*)$", whole, flags=re.M)


def jobs(page):
    """Commands and blocks of a page as ``carried_out`` takes them."""
    found = [("command", line, small(line)) for line in lines(TEXTS[page])]
    return found + [("block", block, []) for block in blocks(TEXTS[page])]


def given(text):
    """Files of a page by name."""
    points = re.findall(r"^```csv\n# (\S+)\n(.*?)^```$", text, flags=re.M | re.S)
    return files(text) | dict(points)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Outcome of each command and block of all pages, in their order, in one folder and one process."""
    folder = tmp_path_factory.mktemp("newcomer")
    for text in TEXTS.values():
        for name, content in given(text).items():
            (folder / name).write_text(content, encoding="utf-8")
    first = [("block", block, []) for block in blocks(START)]
    return carried_out([*first, *(job for page in PAGES for job in jobs(page))], folder)


@pytest.mark.parametrize("page", PAGES)
def test_page(results, page):
    told = [text for _, text, _ in jobs(page)]
    assert len(told) >= 2
    for text in told:
        outcome = results[text]["outcome"]
        assert isinstance(outcome, list) or outcome == 0, f"{text}\n{outcome}\n{results[text]['said'][-2000:]}"


def test_no_two_pages_use_one_command_or_place():
    told = [line for text in TEXTS.values() for line in lines(text)]
    places = [match[1] for line in told if "--resume" not in line and (match := re.search(r"--out (\S+)", line))]
    assert len(set(told)) == len(told)
    assert len(set(places)) == len(places) - 1  # two processes share one


def test_the_first_page_has_commands_of_the_readme_and_a_block_that_runs(results):
    (block,) = blocks(START)
    assert isinstance(results[block]["outcome"], list), results[block]["outcome"]
    known = {*test_readme.SMALL, *MAKE, "pip install -c constraints.txt ."}
    assert [line for line in lines(START) if line not in known] == []
    assert len(lines(START)) >= 8


def test_commands_in_the_text_are_commands():
    named = [command for text in TEXTS.values() for command in commands(text) if command.startswith("coopmm ")]
    assert all(
        any(command.startswith(start) for start in (*SMALL, "coopmm help", "coopmm metrics")) for command in named
    )
