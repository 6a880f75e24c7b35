"""Several controllers tuned with equal effort, around closed-form costs in the place of rollouts."""

import csv
import json
import tomllib

import numpy as np
import pytest

from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import load_scenario
from tests.closed_costs import replace_rollouts, scenario
from tuning.cost.objective import TERMS
from tuning.cost.problem import build_problem
from tuning.studies import controllers, state
from tuning.studies.controllers import tune_controllers

NAMES = ["robust_adaptive", "pid"]


@pytest.fixture
def folder(monkeypatch, tmp_path):
    replace_rollouts(monkeypatch)
    (tmp_path / "short.toml").write_text(scenario().to_toml())
    return tmp_path


def command(folder, *more):
    short, out = str(folder / "short.toml"), str(folder / "tuned")
    return main(["tune", short, "--controllers", ",".join(NAMES), "--out", out, *more])


def test_each_is_tuned_for_the_same_cost_with_the_same_budget(folder, capsys):
    assert command(folder) == 0
    table = capsys.readouterr().out
    given = {name: tomllib.loads((folder / "tuned" / name / "scenario.toml").read_text()) for name in NAMES}
    assert [given[name]["law"]["controller"] for name in NAMES] == NAMES
    assert given["pid"]["tuning"]["scales"] == given["robust_adaptive"]["tuning"]["scales"]
    assert given["pid"]["tuning"]["scales"].keys() == set(TERMS)
    for name in NAMES:
        rows = list(csv.DictReader((folder / "tuned" / name / "history.csv").read_text().splitlines()))
        assert float(rows[-1]["best"]) < float(rows[0]["best"])
        assert (folder / "tuned" / name / "report.txt").exists()
        page = json.loads((folder / "tuned" / name / "page.json").read_text())
        assert (folder / "tuned" / name / "scenario.toml").read_text() in page.values()  # that which was tuned
        assert name in table
    found = json.loads((folder / "tuned" / "compare.json").read_text())["values"]["cost, mean"]
    assert list(found) == NAMES
    assert (folder / "tuned" / "costs.png").exists()


def test_one_that_is_interrupted_says_how_to_go_on(folder, monkeypatch, capsys):
    def interrupted(*_):
        (folder / "tuned" / "pid").mkdir(parents=True)
        (folder / "tuned" / "pid" / state.NAME).write_bytes(b"")
        raise KeyboardInterrupt

    monkeypatch.setattr(controllers, "tune_controllers", interrupted)
    assert command(folder, "--overwrite") == 130
    words = f"coopmm tune {folder}/short.toml --controllers robust_adaptive,pid --out {folder}/tuned --resume"
    assert f"go on by {words}\n" in capsys.readouterr().err


def test_what_was_tuned_is_not_tuned_again(folder, capsys):
    found = tune_controllers(scenario(), NAMES, folder / "tuned")
    again = tune_controllers(scenario(), NAMES, folder / "tuned", resume=True)
    for name in NAMES:
        assert again.results[name].history == found.results[name].history
        assert again.results[name].gains == found.results[name].gains
    assert (again.compared.comparison.costs == found.compared.comparison.costs).all()
    assert command(folder) == 2
    assert "--out: must be" in capsys.readouterr().err


def test_scales_that_are_given_take_the_place_of_the_starts(monkeypatch):
    """Even gains that fail on every sample have a cost then."""
    replace_rollouts(monkeypatch).lost = lambda vector: True
    with pytest.raises(UserError, match="at least one validation sample completes"):
        build_problem(scenario())
    scales = dict.fromkeys(TERMS, 2.0)
    problem = build_problem(scenario(scales=scales))
    weights = problem.scenario.tuning.weights.of_all()
    np.testing.assert_allclose(problem.cost.coefficients, [weights[name] / 2.0 for name in TERMS], rtol=1e-15)
    with pytest.raises(UserError, match=r"tuning\.scales\.effrot: must be a field of \[tuning\.scales\]"):
        load_scenario("sensed", tuning={"scales": {"effrot": 1.0}})
    with pytest.raises(UserError, match="greater than 0"):
        load_scenario("sensed", tuning={"scales": {"effort": 0.0}})


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("pid", "--controllers: must be at least two names, separated by commas, was pid"),
        ("pid,pid", "--controllers: must be different names, was pid, pid"),
        ("pid,pidd", "--controllers: must be one of robust_adaptive"),
        ("", "--controllers: must be at least two names"),
    ],
)
def test_bad_names_are_one_line_and_leave_nothing(folder, capsys, names, message):
    out = folder / "never"
    assert main(["tune", str(folder / "short.toml"), f"--controllers={names}", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()
