"""Commands and code that the READMEs tell a reader to type: every command, at small size, and every block of Python."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from PIL import Image

from coopmm_jax.scenario.overrides import split
from coopmm_jax.scenario.scenario import load_scenario
from experiments import readme_media
from tests import readme_worker, tuning_results

ROOT = Path(__file__).parent.parent
SHORT = ["--simulation.duration", "0.1"]
FEW = {"starts": 4, "samples": 2, "screening-samples": 2, "test-samples": 4, "budget": 0.02}
FEW |= {"precision": "float64"}  # one program less to compile
# The loop and the gains of test_objective.py, whose compiled gradient this shares.
TUNING = {name: value for name, value in tuning_results.SCENARIO["tuning"].items() if name != "weights"}
SHORT_TUNING = [
    *shlex.split(f"--simulation.duration {tuning_results.HORIZON} --law.feedforward projected"),
    *(word for name, value in (TUNING | FEW).items() for word in (f"--tuning.{name}", json.dumps(value))),
]
COMPARED = [*SHORT_TUNING, "--samples", "4"]

# Every command, with the words that make it small (the worker makes small what has no option for it).
SMALL = {
    "python -m experiments.reproduce_paper --out results/paper": ["--duration", "0.05"],
    "coopmm simulate sensed --gains.K-lambda 2 --out results/run": SHORT,
    "coopmm animate paper --against paper_full --out results/robots.gif": SHORT,
    "coopmm scenarios sensed": [],
    "coopmm init mine.toml --scenario sensed --plant.m-p 30": [],
    "coopmm help loop --scenario sensed": [],
    "coopmm metrics": [],
    "coopmm sweep sensed --samples 1000 --out results/sensed.zarr": [*SHORT, "--samples", "16"],
    "coopmm tune sensed --out results/tuned": SHORT_TUNING,
    "coopmm watch results/tuned": [],
    "coopmm simulate sensed --gains-file results/tuned": SHORT,
    "coopmm compare scenario results/tuned --scenario sensed --out results/compared": COMPARED,
    "coopmm tune sensed --pareto 5 --out results/front": [*SHORT_TUNING, "--pareto", "2"],
    "coopmm falsify sensed --out results/worst.toml": [*SHORT_TUNING, "--rollouts", "40", "--starts", "4"],
    "coopmm falsify sensed --modes 4 --out results/failures": [*SHORT_TUNING, "--rollouts", "40", "--starts", "4"],
    "coopmm check results/failures --gains-file results/tuned": [
        *shlex.split("--requirements.contact-loss-fraction '<= 1' --requirements.force-error-rms-late '<= 1e3'"),
        *shlex.split("--requirements.object-rms '<= 1e3' --requirements.error-late '<= 1e3'"),
    ],
    "coopmm tune sensed --adversarial --out results/hardened": SHORT_TUNING,
    "coopmm report results/sensed.zarr": [],
    "coopmm simulate --from results/sensed.zarr --sample 12": [],
    "coopmm simulate --help": [],
    "coopmm --print-completion bash": [],
    "python -m coopmm_jax": ["--version"],
    "coopmm simulate ellipse --reference.path.half-width 1.4 --out results/ellipse": SHORT,
    "python -m experiments.reproduce_paper": ["--duration", "0.05"],
    "python -m experiments.paper_checks": ["u26"],
    "python -m experiments.fingerprints": shlex.split("--scenarios paper --parts trajectory"),
    "python -m experiments.fuzz": ["--cases", "20"],
    "python -m experiments.fuzz_kinds": ["--cases", "1"],
    "python -m experiments.readme_media": [],
    "python -m experiments.benchmarks.rollout": ["--rounds", "1"],
    "python -m experiments.benchmarks.loops": ["--rounds", "1"],
    "python -m experiments.benchmarks.accelerator": shlex.split(
        "--batches 2 --steps 1 --scenarios free --precisions float64"
    ),
    "python -m experiments.benchmarks.sweep": [],
    "python -m experiments.benchmarks.gradients": ["--duration", "0.1"],
    "python -m experiments.benchmarks.falsify": shlex.split("--samples 700 --seeds 1"),
    "python -m experiments.benchmarks.tuning_quality": shlex.split("--scenario short_tuning.toml --seeds 1"),
    "python -m experiments.benchmarks.tuners": shlex.split(
        "--problems shared --tuners coopmm nelder_mead --seeds 1 --seconds 0.5"
    ),
}
MAKE = ("make demo", "make test", "make docs")


def commands(text):
    """Commands in the code of a README, each once: code spans, indented lines, fenced blocks that are not Python."""
    text = re.sub(r"^```python\n.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^```\w*\n(.*?)^```$", lambda m: re.sub("^", "    ", m[1], flags=re.M), text, flags=re.M | re.S)
    code = (a or b for a, b in re.findall(r"^ {4}(.+)$|`([^`\n]+)`", text, flags=re.MULTILINE))
    lines = (shlex.join(shlex.split(line, comments=True)) for line in code if re.match(r"(coopmm|python|make) ", line))
    return list(dict.fromkeys(lines))


def blocks(text):
    """The blocks of Python."""
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


READMES = [(ROOT / folder / "README.md").read_text(encoding="utf-8") for folder in (".", "experiments")]
FOUND = list(dict.fromkeys(command for text in READMES for command in commands(text)))
COMMANDS = [command for command in FOUND if command not in MAKE]
BLOCKS = [block for text in READMES for block in blocks(text)]


def carried_out(jobs, folder):
    """Command or block -> what came of it in a folder: jobs as ``readme_worker`` takes them, in one process."""
    own = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", readme_worker.__name__],
        input=json.dumps(jobs),
        cwd=folder,
        env=os.environ | own,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {text: result for (_, text, _), result in zip(jobs, json.loads(done.stdout), strict=True)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("reader")


@pytest.fixture(scope="module")
def results(folder):
    """Command or block -> what came of it, in the order of the READMEs, as some need what others wrote."""
    known = [command for command in COMMANDS if command in SMALL]
    (folder / "short_tuning.toml").write_text(load_scenario("sensed", **split(SHORT_TUNING)[1]).to_toml(), "utf-8")
    jobs = [("command", command, SMALL[command]) for command in known] + [("block", block, []) for block in BLOCKS]
    return carried_out(jobs, folder)


def test_commands_are_found_in_all_kinds_of_code():
    text = "`coopmm a --b 1` and `else`\n\n    make c  # why\n\n```sh\npython -m d\n```\n```python\ncoopmm = 1\n```\n"
    assert sorted(commands(text)) == ["coopmm a --b 1", "make c", "python -m d"]
    assert blocks(text) == ["coopmm = 1\n"]
    assert len(COMMANDS) >= 15
    assert len(BLOCKS) >= 2


def test_every_command_has_its_small_size():
    assert [command for command in COMMANDS if command not in SMALL] == [], "say in SMALL what makes them small"
    assert [command for command in SMALL if command not in COMMANDS] == [], "no README has these any more"


@pytest.mark.parametrize("command", COMMANDS)
def test_command(results, folder, command):
    assert command in results, f"{command}: say in SMALL what makes it small"
    assert results[command]["outcome"] == 0, results[command]["said"]
    words = command.split()
    assert "--out" not in words or (folder / words[words.index("--out") + 1]).exists()


def test_pictures_are_written_at_the_committed_ones_size(results, folder):
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
def test_python_block(results, block):
    values = results[block]["outcome"]
    assert isinstance(values, list), values
    assert [found for _, found in values] == pytest.approx([said for said, _ in values], rel=1e-3)


def test_numbers_that_the_blocks_show_are_compared(results):
    assert sum(len(results[block]["outcome"]) for block in BLOCKS) >= 1


def test_make_has_all_targets_and_every_change_is_tested():
    assert sorted(command for command in FOUND if command.startswith("make ")) == sorted(MAKE)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for command in MAKE:
        assert re.search(rf"^{command.split()[1]}:.*\n\t", makefile, flags=re.MULTILINE)
    assert (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1] == "exec make test"
