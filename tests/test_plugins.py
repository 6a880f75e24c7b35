"""Plugins: the page on them, whose commands ``test_pages.py`` carries out, and what is wrong with others."""

import ast
import subprocess
import sys
from types import SimpleNamespace
from typing import NamedTuple

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import metrics, plugins, registry
from coopmm_jax.kinds.software import check_plugins, versions
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.table import check_finite as check_metrics
from coopmm_jax.parameters import Gains
from coopmm_jax.scenario.gains_file import gains_text, read_gains
from tests import plugin_page
from tuning.cost.objective import TERMS, Objective
from tuning.cost.objective import check_finite as check_terms

TEXT = plugin_page.PAGE.read_text(encoding="utf-8")
FILES = plugin_page.files(TEXT)


def test_plugins_of_the_page_take_twenty_lines():
    for name, content in FILES.items():
        assert not name.endswith(".py") or len(list(filter(str.strip, content.splitlines()))) <= 20


def test_the_page_has_the_groups_as_they_are():
    assert plugin_page.written(TEXT) == TEXT, "python -m tests.plugin_page"


def test_reductions_that_are_offered_exist():
    assert set(metrics.REDUCTIONS) == set(observer.REDUCTIONS)


HEAD = """
from typing import Annotated, NamedTuple
import jax.numpy as jnp
import coopmm_jax as cm
number = cm.quantity("a number [-]")
"""
DISTURBANCE = '@cm.register("disturbance", "mine")\nclass Mine(NamedTuple):\n'
SQUARE = "    a: Annotated[float, number] = 2.0\n    def value(self, t):\n        return self.a * t * t\n"
# What is wrong, and what is said of it.
BROKEN = {
    "def (": "--plugin mine.py: must be a file that runs, was line 6: ",
    "\n1 / 0": "--plugin mine.py: must be a file that runs, was line 7: ZeroDivisionError: division by zero",
    "import nowhere": "--plugin mine.py: must be a file that runs, was line 6: ModuleNotFoundError",
    "raise SystemExit(3)": "--plugin mine.py: must be a file that runs, was line 6: SystemExit: 3",
    DISTURBANCE + "    a: float = 2.0\n" + SQUARE.partition("\n")[2]: (
        'plugin mine.py: disturbance "mine": a: must be annotated with its meaning and unit'
    ),
    DISTURBANCE + '    a: "Annotated[flot, number]" = 2.0\n' + SQUARE.partition("\n")[2]: (
        'plugin mine.py: disturbance "mine": must be annotated with names that can be found'
    ),
    DISTURBANCE + "    a: Annotated[float, number] = 2.0\n": (
        'plugin mine.py: disturbance "mine": must be a class with def value(self, t): '
    ),
    DISTURBANCE + "    def value(self):\n        return 1.0\n": (
        'plugin mine.py: disturbance "mine": value: must be of the form def value(self, t), was value(self)'
    ),
    DISTURBANCE.replace("NamedTuple", "") + SQUARE: (
        'plugin mine.py: disturbance "mine": must be a class that inherits from typing.NamedTuple'
    ),
    DISTURBANCE.replace("mine", "sine") + SQUARE: 'plugin mine.py: disturbance "sine": must be registered once',
    DISTURBANCE.replace('"mine"', '"my own"') + SQUARE: "plugin mine.py: must be registered as disturbance under",
    DISTURBANCE.replace("disturbance", "disturbence") + SQUARE: (
        "plugin mine.py: must be registered as one of controller, cost_term, course, disturbance"
    ),
    DISTURBANCE + SQUARE + "\n1 / 0\n": "--plugin mine.py: must be a file that runs",
    '@cm.register("metric", "mine")\nclass Mine(NamedTuple):\n    unit, meaning = "m", "x"\n    reduction = "median"\n'
    "    def quantity(self, sample):\n        return 1.0\n": (
        'plugin mine.py: metric "mine": reduction: must be one of max, min, mean'
    ),
    '@cm.register("cost_term", "mine")\nclass Mine(NamedTuple):\n    floor, weight = 1.0, 1.0\n'
    "    def value(self, sample):\n        return 1.0\n": (
        'plugin mine.py: cost_term "mine": must be a class with unit = ...: of its time average, as text, was without'
    ),
}  # fmt: skip
# What is wrong with the value of a disturbance, and what is said of it when a scenario first asks for it.
WRONG = {
    "nowhere": "must be free of errors, was NameError: name 'nowhere' is not defined",
    "1.0 if t > 0 else 0.0": "must be free of errors, was TracerBoolConversionError",
    "(t, t)": "must be a function that returns a number: its value at time t [s], which the amplitudes are multiplied "
    "with [-], was a tuple of 2 (a number each)",
    "jnp.ones(3)": "must be a function that returns a number",
    "None": "must be a function that returns a number",
    '"1"': "must be ",
    "jnp.log(t)": "must be finite at t = 0.0, was -inf",
    "jnp.sqrt(1.0 - t)": "must be finite at t = 7.3, was nan",
}


def written(folder, text):
    (folder / "mine.py").write_text(HEAD + text, encoding="utf-8")
    return folder / "mine.py"


@pytest.mark.parametrize(("text", "message"), BROKEN.items(), ids=range(len(BROKEN)))
def test_what_cannot_be_loaded_is_one_line_and_leaves_nothing(registered, tmp_path, text, message):
    before = {group: list(kinds) for group, kinds in registry._KINDS.items()}
    with pytest.raises(UserError) as caught:
        cm.load_plugin(written(tmp_path, text))
    assert str(caught.value).startswith(message)
    assert {group: list(kinds) for group, kinds in registry._KINDS.items()} == before
    assert not plugins.loaded()


@pytest.mark.parametrize(("value", "message"), WRONG.items())
def test_what_cannot_be_used_is_one_line(registered, tmp_path, value, message):
    cm.load_plugin(written(tmp_path, f"{DISTURBANCE}    def value(self, t):\n        return {value}\n"))
    with pytest.raises(UserError) as caught:
        cm.load_scenario("paper", disturbance={"kind": "mine"})
    assert str(caught.value).startswith(f'disturbance.plugin mine.py: disturbance "mine": value: {message}')


def test_a_kind_is_tried_though_another_with_equal_numbers_was(registered, tmp_path):
    sound, broken = (
        DISTURBANCE.replace('"mine"', '"sound"') + SQUARE,
        DISTURBANCE + SQUARE.replace("self.a * t", "(t,)"),
    )
    cm.load_plugin(written(tmp_path, f"{sound}\n\n{broken}"))
    cm.load_scenario("paper", disturbance={"kind": "sound"})
    with pytest.raises(UserError, match=r'disturbance "mine": value: must be free of errors'):
        cm.load_scenario("paper", disturbance={"kind": "mine"})


METRIC = """
@cm.register("metric", "mine")
class Mine(NamedTuple):
    unit, meaning, reduction = "m", "mine", "max"

    def quantity(self, sample):
        return {value}
"""
TERM = """
@cm.register("cost_term", "mine")
class Mine(NamedTuple):
    unit, floor, weight = "m", 1.0, 1.0

    def value(self, sample):
        return {value}
"""
ASKED = {
    "sample.speed": "must be free of errors, was AttributeError: 'Sample' object has no attribute 'speed'",
    'sample.signals.computed["sigma"]': "must be a function that returns a number: ",
}


@pytest.mark.parametrize(("value", "message"), ASKED.items())
def test_metric_that_cannot_be_computed_is_one_line(registered, tmp_path, value, message):
    cm.load_plugin(written(tmp_path, METRIC.format(value=value)))
    with pytest.raises(UserError) as caught:
        cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.01}))
    assert str(caught.value).startswith(f'plugin mine.py: metric "mine": quantity: {message}')


@pytest.mark.parametrize(("value", "message"), ASKED.items())
def test_term_of_the_cost_that_cannot_be_computed_is_one_line(registered, tmp_path, value, message):
    cm.load_plugin(written(tmp_path, TERM.format(value=value)))
    scenario = cm.load_scenario("paper", simulation={"duration": 0.01}, tuning={"tracking_from": 0.0})
    objective = Objective.of(scenario, scenario.structure(), 0.01)
    with pytest.raises(UserError) as caught:
        jax.eval_shape(objective.evaluate, objective.space.start, scenario.parameters())
    assert str(caught.value).startswith(f'plugin mine.py: cost_term "mine": value: {message}')


def test_what_is_not_finite_in_a_whole_rollout_is_one_line(registered, tmp_path):
    cm.load_plugin(written(tmp_path, METRIC.format(value="1.0") + TERM.format(value="1.0")))
    found = {"mine": np.array([1.0, np.nan])}
    check_metrics(found, np.array([True, False]))
    with pytest.raises(UserError, match=r'metric "mine": quantity: must be finite in every rollout .*, was nan'):
        check_metrics(found, np.array([True, True]))
    terms = np.ones((1, 2, len(TERMS)))
    terms[0, 1, -1] = np.inf
    check_terms(terms, np.array([[True, False]]))
    with pytest.raises(UserError, match=r'cost_term "mine": value: must be finite in every rollout .*, was inf'):
        check_terms(terms, np.array([[True, True]]))


def test_weights_of_terms_are_known_with_their_plugin(registered, tmp_path):
    with pytest.raises(UserError, match=r"tuning.weights.mine: must be a field of .*, or a term of a --plugin"):
        cm.load_scenario("paper", tuning={"weights": {"mine": 2.0}})
    cm.load_plugin(written(tmp_path, TERM.format(value="1.0")))
    scenario = cm.load_scenario("paper", tuning={"weights": {"mine": 2.0}})
    assert scenario.tuning.weights.of_all()["mine"] == 2.0
    assert cm.load_scenario("paper").tuning.weights.of_all()["mine"] == 1.0
    (tmp_path / "s.toml").write_text(scenario.to_toml())
    assert cm.load_scenario(tmp_path / "s.toml") == scenario


def test_command_line_names_plugins_anywhere(registered, tmp_path, capsys):
    file = written(tmp_path, DISTURBANCE + SQUARE)
    assert main(["scenarios", f"--plugin={file}"]) == 0
    assert "mine" in registry.known("disturbance")
    for words, said in (
        (["scenarios", "--plugin"], "--plugin: must be followed by a Python file, was followed by nothing"),
        (["--plugin", "nowhere.py", "scenarios"], "--plugin: must be a Python file, was nowhere.py (No such file or d"),
        (["--plugin", str(tmp_path), "scenarios"], f"--plugin: must be a Python file, was {tmp_path} (Is a directory)"),
    ):
        capsys.readouterr()
        assert main(words) == 2
        assert capsys.readouterr().err.startswith(f"coopmm: error: {said}")


def test_installed_packages_are_plugins_too(registered, monkeypatch):
    def point(name, load):
        return SimpleNamespace(name=name, value="mine.kinds", load=load, dist=SimpleNamespace(version="1.2"))

    def load():
        registry.register("disturbance", "theirs")(Constant)

    monkeypatch.setattr(plugins, "_installed", lambda: (point("theirs", load),))
    assert cm.load_scenario("paper", disturbance={"kind": "theirs"}).disturbance[0].kind == "theirs"
    assert versions()["plugin theirs"] == "1.2"
    monkeypatch.setattr(plugins, "_installed", lambda: (point("broken", lambda: 1 / 0),))
    with pytest.raises(UserError, match=r"plugin broken: must be importable \(mine.kinds\), was ZeroDivisionError"):
        plugins.load_installed()


class Constant(NamedTuple):
    """One."""

    def value(self, t):
        return 1.0 + 0.0 * t


def test_a_plugin_can_be_the_first_that_a_process_loads(tmp_path):
    file = written(tmp_path, DISTURBANCE + SQUARE)
    code = "import sys, coopmm_jax as cm; cm.load_plugin(sys.argv[1])"
    subprocess.run([sys.executable, "-c", code, str(file)], check=True)


def test_a_plugin_is_run_once_and_cannot_change_or_share_its_name(registered, tmp_path):
    file = written(tmp_path, DISTURBANCE + SQUARE)
    cm.load_plugin(file)
    cm.load_plugin(str(file))
    recorded = versions()
    assert len(recorded["plugin mine.py"]) == 16
    check_plugins(recorded, "store", "s.zarr")
    with pytest.raises(UserError, match=r"store: must be used with the --plugin mine.py that s.zarr was made with"):
        check_plugins(recorded | {"plugin mine.py": "0" * 16}, "store", "s.zarr")
    with pytest.raises(UserError, match=r"store: must be used with the --plugin other.py .*, was used without"):
        check_plugins({"plugin other.py": "0" * 16}, "store", "s.zarr")
    (tmp_path / "there").mkdir()
    with pytest.raises(UserError, match="--plugin: must be files of different names"):
        cm.load_plugin(written(tmp_path / "there", DISTURBANCE.replace("mine", "other") + SQUARE))
    written(tmp_path, DISTURBANCE + SQUARE + "\n")
    with pytest.raises(UserError, match="--plugin: must be a file that does not change"):
        cm.load_plugin(file)


def test_gains_files_record_the_plugins_that_they_were_made_with(registered, tmp_path, monkeypatch):
    path = tmp_path / "gains.toml"
    cm.load_plugin(written(tmp_path, DISTURBANCE + SQUARE))
    path.write_text(text := gains_text(Gains()))
    assert text.startswith("# plugin mine.py ")
    assert read_gains(path)["law"]["controller"] == "robust_adaptive"
    path.write_text(text.replace(versions()["plugin mine.py"], "0" * 16))
    with pytest.raises(UserError, match=r"^--gains-file: must be used with the --plugin mine\.py .*, was another"):
        read_gains(path)
    monkeypatch.setattr(plugins, "_loaded", {})
    with pytest.raises(UserError, match=r"^--gains-file: must be used with the --plugin mine\.py .*, was used without"):
        read_gains(path)


def test_examples_are_what_python_reads():
    for name, content in FILES.items():
        assert not name.endswith(".py") or ast.parse(content)
