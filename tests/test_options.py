"""Options that commands share: gains from a file, a tuning's folder or a run's, and results that are not replaced."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

import coopmm_jax
from coopmm_jax import cli, plotting
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.gains_file import gains_text, read_gains
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.sweeps import store
from tests.stand_in import StandIn
from tuning.studies.compare import labels

TAKES_GAINS = ("simulate", "animate", "sweep", "check", "falsify", "tune")
WRITES = ("simulate", "animate", "sweep", "check", "init", "falsify", "tune", "compare")


@pytest.fixture
def simulation(monkeypatch):
    stand_in = StandIn()
    monkeypatch.setitem(vars(coopmm_jax), "simulate", stand_in)
    monkeypatch.setattr(plotting, "overview", lambda trajectory: Figure())
    return stand_in


@pytest.fixture
def tuned(tmp_path):
    """A folder as a tuning leaves it: its scenario has the old gains."""
    folder = tmp_path / "tuned"
    folder.mkdir()
    scenario = load_scenario("sensed", gains={"k0": 3.0})
    (folder / "gains.toml").write_text(gains_text(scenario.parameters().gains), encoding="utf-8")
    (folder / "scenario.toml").write_text(load_scenario("sensed").to_toml(), encoding="utf-8")
    return folder


def test_every_command_has_them():
    commands = cli._parser([])._subparsers._group_actions[0].choices
    assert {name for name, parser in commands.items() if "--gains-file" in parser.format_help()} == set(TAKES_GAINS)
    assert {name for name, parser in commands.items() if "--overwrite" in parser.format_help()} == set(WRITES)


def test_gains_come_from_a_tunings_folder_and_what_is_typed_counts_more(simulation, tuned):
    assert main(["simulate", "sensed", "--gains-file", str(tuned), "--gains.k1", "90"]) == 0
    assert (simulation.scenario.gains.k0, simulation.scenario.gains.k1) == (3.0, 90.0)


def test_gains_come_from_a_runs_folder_with_its_schedule_and_without_its_plant(tmp_path):
    schedule = {"times": (0.0, 1.0), "K_I": (1.0, 2.0)}
    changes = {"gains": {"k0": 3.0}, "law": {"delta_floor": 0.2}, "schedule": schedule, "plant": {"m_p": 6.0}}
    scenario = load_scenario("paper", **changes)
    (tmp_path / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
    (tmp_path / "trajectory.npz").write_bytes(b"")  # nothing of it is read
    found = load_scenario("sensed", **read_gains(tmp_path))
    assert found.parameters().gains == scenario.parameters().gains
    assert found.parameters().schedule == scenario.parameters().schedule
    assert found.plant == load_scenario("sensed").plant


def test_a_search_that_has_not_ended_has_no_gains(tuned):
    (tuned / "gains.toml").unlink()
    with pytest.raises(
        UserError, match=r"^--gains-file: must be .* a folder with gains\.toml or with a run, was .*tuned"
    ):
        read_gains(tuned)


def test_compared_folders_are_told_apart_by_their_names():
    assert labels(["results/k0_5.5", "results/k0_5.6/", "scenario"]) == ("k0_5.5", "k0_5.6", "scenario")


def test_results_are_replaced_only_when_asked(simulation, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["simulate", "paper", "--out", str(out)]) == 0
    (out / "notes.txt").write_text("mine")
    before = {path: path.read_bytes() for path in out.iterdir()}
    assert main(["simulate", "paper", "--gains.k0", "4", "--out", str(out)]) == 2
    said = f"coopmm: error: --out: must be a place without results, or --overwrite given, was {out}\n"
    assert capsys.readouterr().err == said
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert main(["simulate", "paper", "--gains.k0", "4", "--out", str(out), "--overwrite"]) == 0
    assert load_scenario(out / "scenario.toml").gains.k0 == 4.0
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "words",
    [
        "animate paper --out there.gif",
        "compare scenario scenario --scenario sensed --out there",
        "falsify sensed --out there.toml",
        "init there.toml",
        "simulate paper --out there",
        "sweep sensed --samples 1 --out there",
        "tune sensed --out there",
        "tune sensed --pareto 2 --out there",
    ],
)
def test_no_command_replaces_anything_unasked(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    for path in (Path("there/results.txt"), Path("there.gif"), Path("there.toml")):
        path.write_text("old")
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert "--overwrite" in said
    assert said.count("\n") == 1
    assert {path.name for path in tmp_path.rglob("*")} == {"there", "results.txt", "there.gif", "there.toml"}


def test_overwriting_a_sweep_removes_a_store_and_nothing_else(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(UserError, match=r"^out: must be the store of a sweep where --overwrite is given, was "):
        store.discard(tmp_path)
    assert (tmp_path / "mine.txt").exists()
    for more in (["--resume"], ["--rank", "0", "--size", "2"]):
        assert main(["sweep", "sensed", "--samples", "1", "--out", str(tmp_path / "s.zarr"), "--overwrite", *more]) == 2
        assert capsys.readouterr().err.startswith("coopmm: error: --overwrite: must be left out with --resume, and")
    assert main(["tune", "sensed", "--out", str(tmp_path / "t"), "--overwrite", "--resume"]) == 2
    assert capsys.readouterr().err.startswith("coopmm: error: --overwrite: must be left out where --resume is given")
