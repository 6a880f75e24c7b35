"""Failures never read like success: failed runs, sweeps without a completed sample, robots that cannot be meant."""

import matplotlib.text
import pytest

import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.errors import Notice
from coopmm_jax.scenario.plausible import implausible
from coopmm_jax.scenario.scenario import Scenario, list_scenarios, load_scenario
from coopmm_jax.sweeps import figures, report
from coopmm_jax.sweeps.statistics import read_results
from tests.stand_in import StandIn


@pytest.fixture(scope="module")
def failed(sweep, scenario):
    """Every sample of this sweep starts out of reach."""
    return sweep(8, scenario.with_overrides({"coupling.contact_radius": 1e9}), keep=8)


def test_a_sweep_that_fails_as_a_whole_says_so_in_words(failed):
    lines = report.text(read_results(failed)).splitlines()
    assert lines[0] == "all 8 samples failed: none reached 0.05 s"
    assert "failed samples: 8" in lines


def test_a_sweep_that_fails_as_a_whole_says_so_in_its_figures(failed):
    """The page says it instead: there are no pictures of nothing."""
    assert report.drawings(failed, read_results(failed)) == {}
    assert "all 8 samples failed" in _texts(figures.sweep_requirements(failed))
    assert "all 8 samples\nfailed at once" in _texts(figures.sweep_bands(failed))


def _texts(figure):
    return {text.get_text() for text in figure.findobj(matplotlib.text.Text)}


def test_a_report_of_nothing_but_failures_is_written(scenario, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenario.toml").write_text(scenario.to_toml())
    options = ["--coupling.contact-radius", "1e9", "--samples", "8", "--batch", "8", "--keep", "8", "--out", "s.zarr"]
    assert main(["sweep", "scenario.toml", *options]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("all 8 samples failed: none reached 0.05 s\n")
    assert "warning" not in captured.err
    names = sorted(path.name for path in (tmp_path / "s-report").iterdir())
    tables = ["failed.csv", "importance.csv", "metrics.csv", "requirements.csv"]
    assert names == sorted([*tables, "report.html", "report.txt", "summary.json"])
    page = (tmp_path / "s-report" / "report.html").read_text()
    assert "<h2>All samples failed</h2>" in page
    assert "Metrics of the samples" not in page


def test_steps_are_counted_where_the_controller_is_sampled(monkeypatch, capsys):
    monkeypatch.setitem(vars(cm), "simulate", StandIn())
    assert main(["simulate", "paper", "--loop.control-period", "0.004"]) == 0
    assert "20 s in 20000 steps of 0.001 s, float64\n" in capsys.readouterr().out


@pytest.mark.parametrize("name", list_scenarios())
def test_shipped_robots_are_plausible(name):
    assert implausible(load_scenario(name)) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"plant.r": 0.1}, "plant.I_w: 1 kg m^2 is 25 times what fits mass and size of robot I, and is the value of "),
        ({"plant.r": [0.5, 0.1], "plant.I_w": 0.9}, "plant.I_w: 0.9 kg m^2 is 22.5 times what fits mass and size of r"),
        ({"plant.m3": 0.01}, "plant.I3: 0.5 kg m^2 is 50 times what fits mass and size of robot I, and is the value"),
        ({"nominal.I_w": [1.0, 0.01]}, "nominal.I_w: the controller takes it for 0.01 times that of robot II"),
        ({"nominal.scale": 5.0}, "nominal.I_w: the controller takes it for 5 times that of robot I"),
    ],
)
def test_inertias_that_do_not_fit_are_warned_of(changes, said):
    assert implausible(Scenario().with_overrides(changes))[0].startswith(said)


def test_a_simulation_warns_of_them_and_the_command_in_one_line(tmp_path, capsys):
    short = {"simulation.duration": 0.02, "plant.r": 0.1}
    with pytest.warns(Notice, match=r"like 100 kg at each wheel$"):
        cm.simulate(Scenario().with_overrides(short))
    main(["simulate", "paper", "--simulation.duration", "0.02", "--plant.r", "0.1"])
    assert capsys.readouterr().err.startswith("coopmm: warning: plant.I_w: 1 kg m^2 is 25 times what fits mass")
