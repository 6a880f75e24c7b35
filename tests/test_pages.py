"""Commands and code that READMEs, guide and pages on plugins tell a reader to type: every one, as it stands, but small.

All in one process, as they are of one loop, which is then compiled once.
"""

import json
import re

import pytest
from PIL import Image

import coopmm_jax as cm
from coopmm_jax.scenario.overrides import split
from coopmm_jax.scenario.scenario import load_scenario
from experiments import readme_media
from tests.pages import ROOT, blocks, carried_out, commands, lines
from tests.plugin_page import PAGE, files
from tests.small_commands import GUIDE, HORIZON, PLUGINS, README, SHORT_TUNING

MAKE = ("make demo", "make test", "make docs")
READMES = [(ROOT / folder / "README.md").read_text(encoding="utf-8") for folder in (".", "experiments")]
FOUND = list(dict.fromkeys(command for text in READMES for command in commands(text)))
COMMANDS = [command for command in FOUND if command not in MAKE]
BLOCKS = [block for text in READMES for block in blocks(text)]

PAGES = ("own_robots", "own_task", "own_requirement", "own_optimiser", "results", "cluster")
TEXTS = {page: (ROOT / "docs" / "howto" / f"{page}.md").read_text(encoding="utf-8") for page in PAGES}
START = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
EXTENDED = {page: (PAGE.parent / f"{page}.md").read_text(encoding="utf-8") for page in ("controllers", "plugins")}


def small(command):
    """Words that make a command of the guide small: those of the longest beginning that is known."""
    return GUIDE[max((start for start in GUIDE if command.startswith(start)), key=len)]


def jobs(page):
    """Commands and blocks of a page of the guide."""
    found = [("command", line, small(line)) for line in lines(TEXTS[page])]
    return found + [("block", block, []) for block in blocks(TEXTS[page])]


def extension(page):
    """Commands that name plugins, and then the block without a name of its own, of a page on what can be added."""
    told = [command for command in commands(EXTENDED[page]) if " --plugin " in command]
    words = [next(PLUGINS[start] for start in PLUGINS if f" {start} " in command) for command in told]
    use = [block for block in blocks(EXTENDED[page]) if not block.startswith("# ")]
    return [*(("command", *each) for each in zip(told, words, strict=True)), *(("block", block, []) for block in use)]


def assert_carried_out(results, told):
    for text in told:
        outcome = results[text]["outcome"]
        assert isinstance(outcome, list) or outcome == 0, f"{text}\n{outcome}\n{results[text]['said'][-2000:]}"


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
def extended(tmp_path_factory):
    """Folder of each reader who extends it, with the files of the page."""
    folders = {page: tmp_path_factory.mktemp(page) for page in EXTENDED}
    for page, folder in folders.items():
        for name, content in files(EXTENDED[page]).items():
            (folder / name).write_text(content, encoding="utf-8")
    return folders


@pytest.fixture(scope="module")
def results(folder, extended, tmp_path_factory):
    """Outcomes of the commands and blocks of all pages, in order: some need what others wrote."""
    newcomer = tmp_path_factory.mktemp("newcomer")
    for text in TEXTS.values():
        for name, content in given(text).items():
            (newcomer / name).write_text(content, encoding="utf-8")
    known = [("command", command, README[command]) for command in COMMANDS if command in README]
    first = [("block", block, []) for block in blocks(START)]
    return carried_out(
        (folder, [*known, *(("block", block, []) for block in BLOCKS)]),
        (newcomer, [*first, *(job for page in PAGES for job in jobs(page))]),
        *((place, extension(page)) for page, place in extended.items()),
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
    assert_carried_out(guide, told)


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


@pytest.fixture
def of_extensions(results):
    """Outcomes by page."""
    return dict(zip(EXTENDED, results[2:], strict=True))


@pytest.mark.parametrize("page", EXTENDED)
def test_page_on_what_can_be_added(of_extensions, page):
    told = [text for _, text, _ in extension(page)]
    assert len(told) >= 4
    assert_carried_out(of_extensions[page], told)


def test_what_plugins_add_is_there(of_extensions, extended):
    said = {command.split("simulate ")[-1][:6]: result["said"] for command, result in of_extensions["plugins"].items()}
    assert "elbow_min" in said["bumpy."]
    swept = next(result["said"] for command, result in of_extensions["plugins"].items() if " sweep " in command)
    assert re.search(r"elbow_min >= 0.3 +\d+ of 16", swept)
    assert "disturbance.bump.top" in swept
    terms = next(result["said"] for command, result in of_extensions["plugins"].items() if " tune " in command)
    assert re.search(r"\byaw\b", terms)
    record = json.loads((extended["plugins"] / "run" / "summary.json").read_text())["versions"]
    used = {f"plugin {name}" for name in files(EXTENDED["plugins"]) if name.endswith("py")}
    assert {name for name in record if name.startswith("plugin")} == used
    assert (extended["plugins"] / "worst.toml").read_text().count('kind = "bump"') == 1


def test_gains_and_signals_are_those_of_the_controller_of_the_page(of_extensions, extended, registered):
    folder = extended["controllers"]
    assert 'controller = "pd_plus"' in (folder / "tuned" / "gains.toml").read_text(encoding="utf-8")
    cm.load_plugin(folder / "pd_plus.py")
    assert cm.read_run(folder / "run").position_error.shape == (round(HORIZON / 1e-3) + 1, 6)
