"""Presentation never takes the results with it, on any terminal, in any environment, under any name."""

import json
import os
import site
import subprocess
import sys
from pathlib import Path

import matplotlib
import pytest
from matplotlib.figure import Figure

import coopmm_jax
from coopmm_jax import plotting, runtime
from coopmm_jax.cli import main, told
from coopmm_jax.errors import Notice
from coopmm_jax.plotting import style
from coopmm_jax.scenario.scenario import shipped
from tests.stand_in import StandIn

CHECKOUT = Path(coopmm_jax.__file__).parents[1]
SHORT = ["--simulation.duration", "0.2"]
WRITTEN = ["metrics.csv", "scenario.toml", "summary.json", "trajectory.npz"]


@pytest.fixture
def simulation(monkeypatch):
    stand_in = StandIn()
    monkeypatch.setitem(vars(coopmm_jax), "simulate", stand_in)
    monkeypatch.setattr(plotting, "overview", lambda trajectory: Figure())
    return stand_in


TERMINALS = {
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
    "POSIX": {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb"},
    "stderr closed": {},
    "stdout closed": {},
    "output read by nobody": {},
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Terminal -> how ``coopmm simulate --out`` ended on it: exit code, stdout, stderr, files of results."""
    running = {}
    for name, environment in TERMINALS.items():
        folder = tmp_path_factory.mktemp("terminal")
        (folder / "greek.toml").write_text('base = "paper"\ndescription = "λ"\n', encoding="utf-8")
        command = f"{sys.executable} -m tests.stand_in simulate {folder}/greek.toml --out {folder}/run"
        closing = {
            "stderr closed": " 2>&-",
            "stdout closed": " >&-",
            "output read by nobody": " | true; exit ${PIPESTATUS}",
        }
        arguments = ["bash", "-c", command + closing.get(name, "")]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        running[name] = subprocess.Popen(arguments, cwd=CHECKOUT, env=os.environ | environment, **pipes), folder
    found = {}
    for name, (process, folder) in running.items():
        out, err = process.communicate(timeout=60)
        found[name] = process.returncode, out.decode(), err.decode(), sorted(p.name for p in (folder / "run").iterdir())
    return found


@pytest.mark.parametrize("terminal", TERMINALS)
def test_results_are_there_whatever_the_terminal(terminal, ended):
    code, out, err, names = ended[terminal]
    assert {"scenario.toml", "summary.json", "trajectory.npz"} <= set(names)
    assert code == (141 if terminal == "output read by nobody" else 0)
    if terminal in ("latin-1", "POSIX"):
        assert out.startswith("\\u03bb\n")
    assert err == ""


def test_a_figure_that_fails_is_one_warning_and_leaves_no_older_one(simulation, monkeypatch, tmp_path, capsys):
    assert main(["simulate", "paper", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "overview.png").exists()
    monkeypatch.setattr(plotting, "overview", lambda trajectory: 1 / 0)
    assert main(["simulate", "paper", "--gains.k0", "4", "--out", str(tmp_path), "--overwrite"]) == 0
    said = "coopmm: warning: overview.png was left out (ZeroDivisionError: division by zero)\n"
    assert capsys.readouterr().err == said
    assert sorted(path.name for path in tmp_path.iterdir()) == WRITTEN
    assert json.loads((tmp_path / "summary.json").read_text())["scenario"]["gains"]["k0"] == 4.0


def test_a_run_beyond_all_axes_is_kept(rendered, tmp_path, capsys):
    enormous = ["--reference.contact-force", "1e308"]
    assert main(["simulate", "paper", *SHORT, *enormous, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().err.startswith("coopmm: warning: overview.png was left out (ValueError: ")
    assert sorted(path.name for path in tmp_path.iterdir()) == WRITTEN


def test_figures_have_settings_of_their_own(rendered, simulated_paper, tmp_path):
    with matplotlib.rc_context({"text.usetex": True, "font.size": 40, "lines.linewidth": 9}):
        style.publish(tmp_path, {"mine.png": lambda: plotting.contact_force(simulated_paper)})
        assert matplotlib.rcParams["text.usetex"]
    style.publish(tmp_path, {"usual.png": lambda: plotting.contact_force(simulated_paper)})
    assert (tmp_path / "mine.png").read_bytes() == (tmp_path / "usual.png").read_bytes()


def test_a_description_cannot_steer_the_terminal(simulation, tmp_path, capsys):
    text = r'base = "paper"' + "\n" + r'description = "\u001b[31mred\u001b[2J\ntwo"'
    (tmp_path / "red.toml").write_text(text + "\n")
    assert main(["simulate", str(tmp_path / "red.toml")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == r"\x1b[31mred\x1b[2J two"


def test_publishing_warns_outside_the_command_line_too(tmp_path):
    with pytest.warns(Notice, match=r"^a\.png was left out \(ValueError: invalid literal for int"):
        style.publish(tmp_path, {"a.png": lambda: int("no")})


def test_names_are_never_formulas(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("k$_{x$.toml", "$frac{$.toml"):
        Path(name).write_text('base = "paper"\n')
    against = ["--against", "$frac{$.toml", "--width", "480"]
    assert main(["animate", "k$_{x$.toml", *SHORT, *against, "--out", "film.gif"]) == 0


@pytest.mark.parametrize("target", ["link", "file", "file/run"])
@pytest.mark.parametrize("command", ["simulate", "sweep", "compare"])
def test_an_unusable_place_is_found_before_the_run(command, target, simulation, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("link").symlink_to("nothing")
    Path("file").write_text("")
    before = sorted(path.name for path in tmp_path.iterdir())
    arguments = {
        "simulate": ["paper", "--out", target],
        "sweep": ["sensed", "--out", "s.zarr"],
        "compare": ["scenario", "--scenario", "sensed", "--out", target],
    }[command]
    if command == "sweep":
        Path(target).rename("s-report") if target != "file/run" else Path("s-report").write_text("")
        before = sorted(path.name for path in tmp_path.iterdir())
    assert main([command, *arguments]) == 2
    assert capsys.readouterr().err.startswith("coopmm: error: --out: must be a folder that can be written, was ")
    assert simulation.scenario is None
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_sweep_refused_late_leaves_no_store(scenario, tmp_path, monkeypatch, capsys):
    from coopmm_jax.sweeps import measure

    def without_device(*_):
        raise RuntimeError("Unable to initialize backend 'tpu'")

    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenario.toml").write_text(scenario.to_toml())
    monkeypatch.setattr(measure, "measure", without_device)
    sweep = ["sweep", "scenario.toml", "--samples", "8", "--batch", "8", "--keep", "0", "--out", "s.zarr"]
    assert main(sweep) == 2
    assert capsys.readouterr().err.startswith("coopmm: error: JAX_PLATFORMS: must be a platform that JAX has here, was")
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_a_checkout_runs_without_being_installed(tmp_path):
    for path in map(Path, site.getsitepackages()):
        for entry in path.iterdir():
            if "coopmm" not in entry.name and entry.suffix != ".pth":
                (tmp_path / entry.name).symlink_to(entry)
    for package in ("coopmm_jax", "tuning"):  # without what an installation in place leaves beside them
        (tmp_path / package).symlink_to(CHECKOUT / package)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}

    code = """
from coopmm_jax.cli import main
from coopmm_jax.kinds.software import versions
print(main(["scenarios"]), main(["tune", "sensed"]), versions()["coopmm_jax"])
"""

    def run(*arguments):
        command = [sys.executable, "-S", *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)

    asked = run("-c", code)
    listed, *_, ends = asked.stdout.splitlines()
    assert listed.split()[0] == min(shipped())
    hint = "those of other packages, like tune, are there once pip has installed these, was tune\n"
    assert asked.stderr.startswith("coopmm: error: COMMAND: must be one of simulate, ")
    assert asked.stderr.endswith(hint)
    assert ends == f"0 2 {coopmm_jax.__version__}"
    explained = run("-OO", "-m", "coopmm_jax.cli", "simulate", "--help")
    assert explained.returncode == 0
    assert "[plant]:" in explained.stdout


@pytest.mark.parametrize(("asked", "line"), [("cuda", "was cuda (no device of it)"), ("cuda,cpu", None)])
def test_platforms_without_a_device_are_told(monkeypatch, asked, line):
    monkeypatch.setattr(runtime, "backend_is_up", lambda: False)
    monkeypatch.setenv("JAX_PLATFORMS", asked)
    must = line and f"JAX_PLATFORMS: must be a platform that JAX has here, {line}"
    assert told(AssertionError()) == must
