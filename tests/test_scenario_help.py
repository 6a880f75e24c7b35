"""Commands that tell a newcomer about scenarios: init, scenarios, metrics, help, completion; none imports JAX."""

import math
import subprocess
import sys
import tomllib

import pytest

from coopmm_jax.cli import main
from coopmm_jax.commands import fields
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.scenario import catalogue
from coopmm_jax.scenario.commented import commented
from coopmm_jax.scenario.places import names
from coopmm_jax.scenario.scenario import Scenario, load_scenario, shipped
from coopmm_jax.scenario.sections.uncertainty import shapes
from coopmm_jax.temporal_logic.signals import SIGNALS
from tests.test_cli import IN_BRACKETS

QUICK = (["scenarios"], ["scenarios", "sensed"], ["metrics"], ["help"], ["help", "loop", "--scenario", "sensed"])


def printed(capsys, *words):
    assert main(words) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", sorted(shipped()))
def test_a_commented_scenario_is_the_same_scenario(name, tmp_path):
    scenario = load_scenario(name)
    text = commented(scenario)
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    assert load_scenario(tmp_path / "mine.toml") == scenario
    assert "base" not in tomllib.loads(text)


def test_a_commented_scenario_has_schedules_kinds_and_any_text(tmp_path):
    changes = {
        "description": 'a "name" # \x7f\n[plant]',
        "schedule": {"times": (0.0, 1.0), "K_sigma": ((1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 1.0)},
        "disturbance": [{"kind": "step", "name": "knock", "force_x": 1.0}, {"kind": "noise", "wheel": (0.1, 0.2)}],
        "uncertainty": {"plant.m_p.1": {"distribution": "normal", "mean": 5, "std": 0.1, "group": "a b"}},
        "actuators": {"wheel_limit": float("inf")},
        "nominal": {"m_p": (4.0, 5.0)},
    }
    scenario = load_scenario("paper", **changes)
    (tmp_path / "mine.toml").write_text(commented(scenario), encoding="utf-8")
    assert load_scenario(tmp_path / "mine.toml") == scenario


def test_every_field_has_its_meaning_and_unit_beside_it():
    lines = commented(load_scenario("sensed")).splitlines()
    assert "m_p = 5.0  # [kg] mass of the platform" in lines
    assert 'u26 = "printed"  # form of U26 in (19): printed or corrected' in lines
    assert 'kind = "sine"  # or step, pulse, noise, table' in lines
    assert "# I_p = ...  # [kg m^2] yaw moment of inertia of the platform" in lines
    assert 'plant.masses = { distribution = "uniform", low = 0.8, high = 1.2, relative = true }' in lines


def test_init_writes_overrides_and_nothing_over_a_file(tmp_path, capsys):
    path = tmp_path / "new" / "mine.toml"
    assert main(["init", str(path), "--scenario", "rough", "--plant.m-p", "30", "--loop.control-period", "0.002"]) == 0
    changes = {"plant": {"m_p": 30.0}, "loop": {"control_period": 0.002}}
    assert load_scenario(path) == load_scenario("rough", **changes)
    capsys.readouterr()
    for words, said in (
        ([str(path)], f"FILE: must be a place without results, or --overwrite given, was {path}"),
        (["mine.txt"], "FILE: must be a .toml file, was mine.txt"),
        ([str(tmp_path / "b.toml"), "--plant.m-p", "-1"], "plant.m_p: must be greater than 0, was -1"),
    ):
        assert main(["init", *words]) == 2
        assert capsys.readouterr().err == f"coopmm: error: {said}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_a_file_that_init_names_is_found_from_anywhere(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    points = "".join(f"{1.7 * math.cos(k / 2):.6f},{1.2 * math.sin(k / 2):.6f}\n" for k in range(12))
    (tmp_path / "loop.csv").write_text(points, encoding="utf-8")
    path = ["--reference.path.kind", "csv", "--reference.path.file", "loop.csv"]
    assert main(["init", "deep/mine.toml", "--scenario", "ellipse", *path]) == 0
    monkeypatch.chdir("deep")
    assert load_scenario("mine.toml").reference.path.file == str(tmp_path / "loop.csv")


def test_scenarios_prints_one(capsys):
    assert printed(capsys, "scenarios", "sensed") == shipped()["sensed"].read_text(encoding="utf-8")
    assert printed(capsys, "scenarios", "sensed", "--whole") == commented(load_scenario("sensed"))
    assert main(["scenarios", "sense"]) == 2
    assert "NAME: must be one of compliant," in capsys.readouterr().err


def test_metrics_and_signals_are_listed_with_unit_and_meaning(capsys):
    metrics, signals = (part.splitlines()[1:] for part in printed(capsys, "metrics").split("\n\n"))
    for lines, known in ((metrics, METRICS), (signals, SIGNALS)):
        assert [line.split()[0] for line in lines] == list(known)
        assert all(about.meaning in line and f" {about.unit} " in line for about, line in zip(known.values(), lines))


def test_help_tells_the_scenarios_own_values(capsys):
    text = "time between samples, torque held; 0: in continuous time [s]"
    own = printed(capsys, "help", "loop", "--scenario", "sensed")
    assert f"  --loop.control-period        {text} (sensed: 0.001, default 0)\n" in own
    assert f"{text} (default 0)\n" in printed(capsys, "help", "loop")
    own = printed(capsys, "help", "gains", "--scenario", "sensed", "--gains.k0", "4")
    assert "decay of eta (14) [1/s] (sensed: 4, default 5)" in own


def test_help_tells_values_of_the_kind_that_is_chosen_alone(capsys):
    own = ("--reference.path.half-width", "1.5")
    lines = printed(capsys, "help", "reference", "--scenario", "eight", *own).splitlines()
    (half_width,) = (line for line in lines if "eight: 1.5" in line and "reference.path.half-width" in line)
    assert half_width.endswith("(eight: 1.5, default 1.2)")
    assert sum("reference.path.half-width" in line for line in lines) == 2  # an ellipse has one, too
    (kind,) = (line for line in lines if "--reference.path.kind" in line)
    assert kind.endswith("(eight: eight, default none)")


@pytest.mark.parametrize("name", catalogue.sections())
def test_help_of_all_sections_names_every_field(name, capsys):
    text = printed(capsys, "help", name, "--scenario", "rough")
    assert text.startswith(catalogue.sections()[name])
    wanted = [place for place in names(Scenario()) if place.startswith(f"{name}.")]
    inside = [place for place in wanted if not place.startswith(IN_BRACKETS)]
    assert [place for place in inside if f"{fields.option(place)} " not in text and f"{place}.kind" not in text] == []


def test_help_tells_what_an_uncertainty_can_be_and_is(capsys):
    text = printed(capsys, "help", "uncertainty", "--scenario", "sensed")
    assert all(f"  {name} " in text for name in shapes())
    assert '\nsensed has\n\n[uncertainty.plant.masses]\ndistribution = "uniform"\nlow = 0.8\n' in text


def test_help_of_a_command_is_its_own(capsys):
    assert printed(capsys, "help", "falsify").startswith("usage: coopmm falsify SCENARIO")
    assert "coopmm help SECTION" in printed(capsys, "help")
    for words, said in (
        (["senzing"], "SECTION: must be one of loop, sensing, "),
        (["loop", "--gains.k0", "2"], "--gains.k0: must be given together with --scenario, was given alone"),
    ):
        assert main(["help", *words]) == 2
        assert capsys.readouterr().err.startswith(f"coopmm: error: {said}")


def test_what_tells_computes_nothing():
    """No import of JAX, which takes longer than all the rest, nor of NumPy where nothing varies."""
    code = f"""
import sys
from coopmm_jax.cli import main
assert "numpy" not in sys.modules
for words in {QUICK}:
    assert main(words) == 0, words
assert "jax" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """File of completions for bash, by the package as a program."""
    command = [sys.executable, "-m", "coopmm_jax", "--print-completion", "bash"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    path = tmp_path_factory.mktemp("completion") / "coopmm.bash"
    path.write_text(done.stdout, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("line", "among"),
    [
        ("coopmm swe", {"sweep"}),
        ("coopmm simulate sens", {"sensed"}),
        ("coopmm tune sensed --gains.K-l", {"--gains.K-lambda"}),
        ("coopmm simulate sensed --gains.K-sigma 1 2 --law.u26 co", {"corrected"}),
        ("coopmm help unc", {"uncertainty"}),
        ("coopmm scenarios way", {"waypoints"}),
    ],
)
def test_bash_completes(script, line, among):
    code = 'source "$1"; COMP_WORDS=($2); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _shtab_coopmm; echo "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", code, "bash", script, line], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == among
