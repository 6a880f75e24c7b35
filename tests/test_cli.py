"""The command line: exit codes, messages, overrides and result folders, around a stand-in for the simulation."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

import coopmm_jax
from coopmm_jax import __version__, plotting
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.registry import known
from coopmm_jax.metrics.table import METRICS, SHOWN
from coopmm_jax.scenario import overrides
from coopmm_jax.scenario.places import names
from coopmm_jax.scenario.scenario import Scenario, load_scenario, shipped
from tests.stand_in import StandIn

FAILED = SimpleNamespace(name="SINGULAR_GUIDE", message="arm of robot II became singular")


@pytest.fixture
def simulation(monkeypatch):
    stand_in = StandIn()
    monkeypatch.setitem(vars(coopmm_jax), "simulate", stand_in)
    monkeypatch.setattr(plotting, "overview", lambda trajectory: Figure())
    return stand_in


def test_scenarios_lists_one_line_each(capsys):
    assert main(["scenarios"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(shipped())
    assert all(load_scenario(line.split()[0]).description in line for line in lines)


def test_version_and_help(capsys):
    for arguments, shown in ((["--version"], f"coopmm {__version__}"), (["--help"], "simulate one scenario")):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        assert shown in capsys.readouterr().out


IN_BRACKETS = ("tuning.bounds.", "tuning.weights.", "tuning.scales.")  # help shows these tables in one line each


def test_help_of_simulate_names_every_field_with_unit_and_default(capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert "  --plant.m-p                  mass of the platform [kg] (default 5)" in lines
    assert "  --reference.radius           radius z_d2 of the platform's circle [m] (default 2.4 1)" in lines
    shown = [place for place in names(Scenario()) if "." in place and not place.startswith(IN_BRACKETS)]
    options = [line.split()[0] for line in lines if line.startswith("  --") and "." in line.split()[0]]
    kinds = {option.removesuffix(".kind") for option in options if option.endswith(".kind")}
    assert {*options, *kinds} >= {f"--{place.replace('_', '-')}" for place in shown}
    assert (
        "  --disturbance.force-x        amplitude of a force on the object, along the world's x [N] (default 0)"
        in lines
    )
    for group, name in (("disturbance", "pulse"), ("disturbance", "noise")):
        assert f"  {name}: {known(group)[name].made.__doc__}" in lines


def test_simulate_prints_metrics(simulation, capsys):
    assert main(["simulate", "paper"]) == 0
    assert simulation.scenario == load_scenario("paper")
    out = capsys.readouterr().out
    assert "20 s in 20000 steps of 0.001 s, float64" in out
    assert len(out.splitlines()) == 2 + len(SHOWN)
    assert f"0.25 N       {METRICS['force_min'].meaning}\n" in out
    assert f"  - s       {METRICS['settling_time'].meaning}\n" in out


def test_overrides_reach_the_scenario(simulation):
    gains = "--gains.K-sigma 1 1 1 2 -0.0 2e-1 --gains.K_lambda=-0.5"
    others = "--law.feedforward full --plant.m-p [4,6] --precision float32 --initial.a2 -1e-1 2.6"
    assert main(["simulate", "uncertain", *gains.split(), *others.split()]) == 0
    scenario = simulation.scenario
    assert scenario.gains.K_sigma == (1.0, 1.0, 1.0, 2.0, 0.0, 0.2)
    assert scenario.gains.K_lambda == -0.5
    assert scenario.law.feedforward == "full"
    assert scenario.plant.m_p == (4.0, 6.0)
    assert scenario.initial.a2 == (-0.1, 2.6)
    assert scenario.simulation.precision == "float32"
    assert scenario.nominal.scale == 0.8


def test_override_with_equals_takes_one_value():
    assert overrides.split(["--a.b=1", "paper", "--out", "c.d"]) == (["paper", "--out", "c.d"], {"a.b": 1})


def test_override_is_not_a_way_to_write_other_fields():
    assert overrides.value_of("1\nother = 2") == "1\nother = 2"


def test_results_are_written(simulation, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["simulate", "paper", "--gains.k0", "4", "--out", str(out)]) == 0
    assert f"written to {out}" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == [
        "metrics.csv",
        "overview.png",
        "scenario.toml",
        "summary.json",
        "trajectory.npz",
    ]
    assert load_scenario(out / "scenario.toml") == simulation.scenario
    with np.load(out / "trajectory.npz") as saved:
        assert set(saved) == {"t", "torque"}
        assert saved["t"].tolist() == [0.0, 1.0, 2.0]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "OK"
    assert summary["metrics"] == dict.fromkeys(METRICS, 0.25) | {"settling_time": None}
    assert summary["scenario"]["gains"]["k0"] == 4.0


def test_failed_rollout_is_told_and_kept(simulation, tmp_path, capsys):
    simulation.outcome = {"status": FAILED, "ok": False, "status_time": 1.25}
    assert main(["simulate", "paper", "--out", str(tmp_path)]) == 3
    said = "coopmm: rollout failed: SINGULAR_GUIDE at t = 1.25 s: arm of robot II became singular\n"
    captured = capsys.readouterr()
    assert captured.out.startswith("failed at 1.25 of 20 s: arm of robot II became singular\n")
    assert captured.err == said
    assert json.loads((tmp_path / "summary.json").read_text())["status_time"] == 1.25


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["simulate"], "SCENARIO: must be given, or --from STORE --sample N, was missing"),
        (["simulte"], "COMMAND: must be one of simulate, animate, sweep, check, report, watch, init, scenarios, "),
        (["simulate", "papr"], f"scenario: must be one of {', '.join(sorted(shipped()))} or a .toml file"),
        (["simulate", "paper", "--gains.K-lambda", "-2"], "gains.K_lambda: must be greater than -1, was -2"),
        (
            ["simulate", "paper", "--gains.K-lamda", "2"],
            "gains.K_lamda: must be a field of [gains] (did you mean K_lambda?), was unknown",
        ),
        (["simulate", "paper", "--gains.K-lambda", "--out", "x"], "--gains.K_lambda: must be followed by a value"),
        (["simulate", "paper", "--law.u26", "fixed"], "law.u26: must be 'printed' or 'corrected', was \"fixed\""),
        (
            ["simulate", "paper", "--K-lambda", "2"],
            "--K-lambda: must be an option of coopmm simulate (did you mean --gains.K-lambda?), was unknown",
        ),
        (["simulate", "paper", "--precision", "half"], "argument --precision: invalid choice: 'half'"),
        (["scenarios", "--gains.k0", "2"], "--gains.k0: must be given to a command that runs a scenario"),
    ],
)
def test_user_errors_are_one_line_and_code_2(arguments, message, capsys):
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"coopmm: error: {message}")
    assert captured.err.count("\n") == 1


def test_unusable_output_folder_is_found_before_the_run(simulation, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["simulate", "paper", "--out", str(tmp_path / "file")]) == 2
    assert simulation.scenario is None
    assert "--out: must be a folder that can be written, was" in capsys.readouterr().err


def test_errors_of_the_simulation_leave_nothing_behind(monkeypatch, tmp_path, capsys):
    def unreachable(scenario):
        raise UserError("initial", "within reach of the contact", "out of reach")

    monkeypatch.setitem(vars(coopmm_jax), "simulate", unreachable)
    assert main(["simulate", "paper", "--out", str(tmp_path / "run")]) == 2
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == "coopmm: error: initial: must be within reach of the contact, was out of reach\n"


def test_installed_command_reports_errors_without_traceback():
    command = os.path.join(os.path.dirname(sys.executable), "coopmm")
    done = subprocess.run([command, "simulate", "papr"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("coopmm: error: scenario: must be one of")
    assert done.stderr.count("\n") == 1


def test_real_runs_end_as_they_should(tmp_path, capsys):
    short = ["--simulation.duration", "0.02"]
    assert main(["simulate", "paper", *short, "--out", str(tmp_path)]) == 0
    with np.load(tmp_path / "trajectory.npz") as saved:
        assert saved["torque"].shape == (21, 2, 5)
    assert (tmp_path / "overview.png").exists()
    assert main(["simulate", "paper", *short, "--gains.k1", "1e9"]) == 3
    assert capsys.readouterr().err.startswith("coopmm: rollout failed: ")
    assert main(["simulate", "paper", *short, "--initial.x", "5", "1.2"]) == 2
    assert capsys.readouterr().err.startswith("coopmm: error: initial: must be ")
