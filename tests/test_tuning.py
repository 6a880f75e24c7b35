"""The course of a tuning run, around closed-form costs in the place of rollouts."""

import csv
import shutil
import signal
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

import tuning
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.sweeps.batch import Elsewhere, slots
from tests import kill_worker
from tests.closed_costs import MASS, QUICK, replace_rollouts, scenario
from tests.reading import Reading
from tests.workers import environment
from tuning.cost import evaluate as batches
from tuning.cost import objective as objective_module
from tuning.cost import problem as problem_module
from tuning.cost.objective import FAILED, TERMS
from tuning.cost.risk import risk
from tuning.cost.robust_cost import RobustCost
from tuning.cost.trials import DrawnTrials
from tuning.reports import tune as report
from tuning.studies import state


@pytest.fixture
def rollouts(monkeypatch):
    return replace_rollouts(monkeypatch)


def same(one, other):
    np.testing.assert_array_equal(one.after, other.after)
    assert [row[:-1] for row in one.history] == [row[:-1] for row in other.history]  # all but the seconds
    np.testing.assert_array_equal(one.comparison.costs, other.comparison.costs)


def test_tuning_lowers_the_cost_on_samples_it_has_not_seen(rollouts):
    result = tuning.tune(scenario())
    before, after = result.comparison.costs.mean(axis=1)
    assert after < 0.2 * before
    assert [row.best for row in result.history] == sorted((row.best for row in result.history), reverse=True)


@pytest.mark.parametrize("optimiser", ["lbfgs", "adam"])
def test_descents_lower_the_cost_too(rollouts, optimiser):
    result = tuning.tune(scenario(optimiser=optimiser, budget=60.0))
    first = next(i for i, row in enumerate(result.history) if row.stage == "searching")
    assert result.history[first + 5].best < 0.8 * result.history[first - 1].best
    assert rollouts.calls > 10


def test_every_term_is_one_under_the_starting_gains(rollouts):
    problem = problem_module.build_problem(scenario(weights=dict.fromkeys(TERMS, 1.0)))
    fixed = problem.samples(problem_module.VALIDATION, QUICK["validation_samples"])
    assert problem.costs(problem.start, fixed)[0] == pytest.approx(len(TERMS), rel=1e-6)  # float32 outside tune()


def test_an_executor_carries_all_that_a_problem_computes(rollouts, monkeypatch):
    places = []
    for name in ("evaluate", "gradients"):
        stand = getattr(batches, name)
        monkeypatch.setattr(batches, name, lambda *given, stand=stand: places.append(slots()[0]) or stand(*given))
    with ThreadPoolExecutor(1) as pool:
        problem = tuning.build_problem(scenario(), pool)
        problem.costs(problem.start)
        problem.slopes(problem.start[None])
    assert len(places) == 3
    assert all(isinstance(place, Elsewhere) and place.executor is pool for place in places)
    tuning.build_problem(scenario()).costs(problem.start)
    assert not isinstance(places[-1], Elsewhere)


def test_same_seed_same_bits_and_another_seed_others(rollouts):
    first, again = (tuning.tune(scenario()) for _ in range(2))
    same(first, again)
    other = tuning.tune(scenario().with_overrides({"simulation.seed": 1}))
    assert np.any(other.after != first.after)


@pytest.mark.parametrize(
    "settings", [{"schedule": 2}, {"optimiser": "lbfgs"}, {"optimiser": "adam"}, {"adversaries": 2}], ids=str
)
def test_killed_and_resumed_is_uninterrupted(rollouts, tmp_path, settings):
    """From what is on disk after screening, amid a scan, and amid what follows it."""
    settings = scenario(budget=60.0 if "adversaries" in settings else 20.0, **settings)
    kept = {}

    def keep(row):
        if row.iteration in (0, 5, 10, 20, 30):
            kept[tmp_path / str(row.iteration)] = row.stage
            shutil.copytree(tmp_path / "whole", tmp_path / str(row.iteration))

    whole = tuning.tune(settings, out=tmp_path / "whole", progress=keep)
    late = [part for part, stage in kept.items() if stage == "searching"][-1]
    assert kept[tmp_path / "5"] == "scanning"
    for part in (tmp_path / "0", tmp_path / "5", late):
        assert not (part / "gains.toml").exists()
        same(whole, tuning.tune(settings, out=part, resume=True))
        assert (part / "gains.toml").read_bytes() == (tmp_path / "whole" / "gains.toml").read_bytes()


def test_sigkill_amid_writing_and_a_resume_leave_the_same_files(rollouts, tmp_path):
    """The state is on disk already, its line of history is not: not even the first, or that of iteration 7."""
    tuning.tune(scenario(), out=tmp_path / "whole")
    command = [sys.executable, "-m", kill_worker.__name__, *(str(tmp_path / name) for name in ("late", "early")), "7"]
    assert subprocess.run(command, env=environment(), check=False).returncode == -signal.SIGKILL
    assert not (tmp_path / "early" / state.HISTORY).exists()
    for name in ("early", "late"):
        assert not (tmp_path / name / "gains.toml").exists()
        tuning.tune(scenario(), out=tmp_path / name, resume=True)
    folders = [tmp_path / name for name in ("whole", "early", "late")]
    texts = [(folder / "gains.toml").read_bytes() for folder in folders]
    assert texts[0] == texts[1] == texts[2]
    rows = [list(csv.reader((folder / state.HISTORY).read_text().splitlines())) for folder in folders]
    cut = [[row[:-1] for row in each] for each in rows]  # all but the seconds
    assert cut[0] == cut[1] == cut[2]


def test_the_folder_holds_the_scenario_that_a_resume_takes(rollouts, tmp_path):
    """A run that time ends says so, and goes on from its own scenario.toml to where it would have come."""
    whole = tuning.tune(scenario())
    out = tmp_path / "out"
    part = tuning.tune(scenario(), out=out, time_budget=0.0)
    assert part.resumable
    assert part.stopped == "the time budget of 0 s is used up"
    assert len(part.history) == 1
    resumed = tuning.tune(load_scenario(out / state.SETTINGS), out=out, resume=True)
    assert not resumed.resumable
    same(whole, resumed)


def test_sobol_sets_differ_from_draw_to_draw_and_are_the_same_for_all(rollouts):
    problem = problem_module.build_problem(scenario())
    first, again, other = (problem.drawn(8, draw).rows for draw in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)
    mass = int(np.flatnonzero(np.any(first != first[0], axis=0))[0])
    fractions = np.sort((first[:, mass] / 5.0 - 0.8) / 0.4)
    assert np.all(np.floor(8 * fractions) == np.arange(8))  # one in each eighth


def test_simulated_steps_are_counted(rollouts):
    problem = problem_module.build_problem(scenario())
    trials = DrawnTrials(problem)
    trials.values(np.zeros((3, problem.space.size)), 4, 0)
    assert trials.spent == 3 * 4 * 20_000
    trials.slopes(np.zeros((1, problem.space.size)), 2, 0)
    assert trials.spent == (12 + 20 * 2) * 20_000


def test_the_search_ends_with_its_budget_and_says_so(rollouts):
    result = tuning.tune(scenario(budget=5.0))
    assert result.stopped == "the budget of 5 million simulated steps is used up"
    spent = [row.steps for row in result.history]
    assert spent[-2] < 5e6 <= spent[-1]


def test_the_search_ends_where_nothing_improves(rollouts):
    result = tuning.tune(scenario(budget=1e5, gains=["K_I"], channels="shared"))
    assert result.stopped == "2 stages in a row improved nothing"
    assert result.history[-1].steps < 1e9


def test_failed_rollouts_cost_more_the_earlier_they_fail():
    found = batches.Evaluated(np.full((1, 3, 9), 1e9), np.array([[True, False, False]]), np.array([[1.0, 0.9, 0.1]]))
    assert found.costs(np.zeros(9))[0] == pytest.approx([0.0, 1.1 * FAILED, 1.9 * FAILED])


def test_adversaries_are_trained_on_from_then_on(rollouts, monkeypatch):
    sets, values = [], DrawnTrials.values

    def watched(trials, vectors, count, draw, precision):
        sets.append((count, trials._samples(count, draw).rows))
        return values(trials, vectors, count, draw, precision)

    monkeypatch.setattr(DrawnTrials, "values", watched)
    tuning.tune(scenario(budget=60.0, adversaries=1))
    added = [len(rows) - count for count, rows in sets]
    assert added == sorted(added)
    assert set(added) == {0, 1, 2}  # none before the first check, and those of the last two from then on
    last = sets[-1][1]
    mass = int(np.flatnonzero(np.any(last != last[0], axis=0))[0])
    ends = 5.0 * np.array([0.8, 1.2])  # the cost is convex in the mass, so an end of its range is worst
    assert np.abs(last[-1, mass] - ends).min() < 1e-6


@pytest.mark.parametrize(("precision", "coarse"), [("mixed", "float32"), ("float64", "float64")])
def test_float32_is_for_candidates_far_apart(rollouts, monkeypatch, precision, coarse):
    used, values = [], DrawnTrials.values

    def watched(trials, vectors, count, draw, kind):
        used.append(kind)
        return values(trials, vectors, count, draw, kind)

    monkeypatch.setattr(DrawnTrials, "values", watched)
    result = tuning.tune(scenario(precision=precision))
    stages_of = [row.stage for row in result.history]
    second = stages_of.index("scanning", stages_of.index("searching"))
    assert used == [coarse] * second + ["float64"] * (len(used) - second)
    assert len(used) > second


def test_search_gradient_weighs_the_samples_by_risk(rollouts):
    problem = problem_module.build_problem(scenario())
    cost = RobustCost(problem.cost.objective, problem.cost.coefficients, risk("cvar", 0.5))
    samples, x = problem.samples(3, 4), np.full(problem.space.size, 0.4)
    with jax.enable_x64(True):
        _, slopes = cost.slopes(x[None], samples)
        h = 1e-6 * np.eye(problem.space.size)[2]
        ahead, behind = cost.values(np.stack([x + h, x - h]), samples)
    assert slopes[0, 2] == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)


def test_outputs(rendered, rollouts, tmp_path):
    limits = {"requirements": {"force_min": ">= 0"}}
    settings = scenario(budget=8.0).with_overrides(limits | {"law.delta_floor": 0.1})
    result = tuning.tune(settings, out=tmp_path / "out")
    report.write_report(tmp_path / "out", result, settings)
    text = (tmp_path / "out" / "gains.toml").read_text()
    assert load_scenario("paper", **tomllib.loads(text)).parameters().gains == result.gains
    before, after = result.comparison.costs.mean(axis=1)
    assert f"# mean cost on 8 untouched samples: {before:.6g} before, {after:.6g} after" in text
    assert "# seed 0; 19 numbers tuned: K_sigma, gamma, K_lambda, K_I" in text
    assert "jax " in text
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").read_text().splitlines()))
    assert [float(row["best"]) for row in rows] == [row.best for row in result.history]
    text = (tmp_path / "out" / "report.txt").read_text()
    assert "cost, CVaR(0.9)" in text
    assert "requirement force_min >= 0: success before 1.000" in text
    assert "search ended: the budget of 8 million simulated steps is used up" in text
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"report.json", "scenario.toml"} <= written
    assert all((tmp_path / "out" / f"{name}.png").stat().st_size > 10_000 for name in ("convergence", "gains", "bands"))
    first = (tmp_path / "out" / "report.html").read_text()
    page = Reading(first)
    assert page.pictures == 3
    assert page.text.endswith(settings.to_toml())
    assert [row[1:3] for row in page.rows if row[0] == "cost, mean"] == [[f"{before:.5g}", f"{after:.5g}"]]
    assert len([row for row in page.rows if row[0].startswith("K_sigma[")]) == 6
    (tmp_path / "out" / "report.html").unlink()
    assert main(["report", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "report.html").read_text() == first


def test_history_grows_line_by_line_and_loses_what_the_state_does_not_know(rollouts, tmp_path):
    settings, lines = scenario(budget=8.0), []

    def look(row):
        text = (tmp_path / "out" / state.HISTORY).read_text()
        assert text.endswith("\n")
        lines.append(text.count("\n"))
        if row.iteration == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tuning.tune(settings, out=tmp_path / "out", progress=look)
    assert lines == [2, 3, 4, 5]
    path = tmp_path / "out" / state.HISTORY
    path.write_text(path.read_text() + "4,scann")  # what a full disk may leave
    result = tuning.tune(settings, out=tmp_path / "out", resume=True)
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [int(row["iteration"]) for row in rows] == list(range(len(result.history)))


def test_any_vector_has_its_report(rollouts):
    problem = tuning.build_problem(scenario())
    vector = problem.start + 0.1
    result = tuning.report(problem, vector)
    np.testing.assert_allclose(result.after, np.asarray(problem.space.values(vector)), rtol=1e-6)
    assert len(result.margins) == len(problem.names) == len(problem.low) == len(problem.high)
    assert "search ended" not in report.table(result)


def test_costs_of_vectors_beyond_the_bounds_are_those_at_the_bounds(rollouts):
    problem = problem_module.build_problem(scenario())
    far = problem.start + 100.0
    np.testing.assert_array_equal(problem.costs(far), problem.costs(problem.high))


def test_nothing_is_overwritten_by_a_run_that_does_not_fit(rollouts, tmp_path):
    settings, out = scenario(budget=2.0), tmp_path / "out"
    tuning.tune(settings, out=out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for changed, resume, message in [
        (settings, False, "--out: must be a folder without a tuning run"),
        (settings.with_overrides({"gains.K_a": 3.0}), True, r"--resume: .*K_a = 2\.0, was K_a = 3\.0"),
    ]:
        with pytest.raises(UserError, match=message):
            tuning.tune(changed, out=out, resume=resume)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    anew = tuning.tune(settings.with_overrides({"gains.K_a": 3.0}), out=out, overwrite=True)
    assert load_scenario("paper", **read_gains(out)).parameters().gains.K_a == anew.gains.K_a == 3.0
    with pytest.raises(UserError, match="--resume: must be used with a folder that has"):
        tuning.tune(settings, out=tmp_path / "other", resume=True)
    (out / state.NAME).write_bytes(b"PK spoilt")
    with pytest.raises(UserError, match=r"--resume: .* can be read"):
        tuning.tune(settings, out=out, resume=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"uncertainty": {}}, "uncertainty: must be given"),
        ({"tuning": {"tracking_from": 30.0}}, r"tuning\.tracking_from: must be before simulation\.duration"),
        ({"tuning": {"optimiser": "adamm"}}, r"tuning\.optimiser: must be auto, cma, lbfgs or an optimiser of optax"),
        ({"tuning": {"optimiser": "chain"}}, r"tuning\.optimiser"),
    ],
)
def test_settings_that_cannot_be_met_leave_nothing_behind(rollouts, changes, message, tmp_path):
    for out in (tmp_path / "new", tmp_path):
        with pytest.raises(UserError, match=message):
            tuning.tune(load_scenario("paper", **{"uncertainty": MASS} | changes), out=out)
    assert tmp_path.is_dir()  # was there before
    assert not any(tmp_path.iterdir())


def test_starting_gains_under_which_nothing_completes(rollouts):
    rollouts.lost = lambda vector: True
    with pytest.raises(UserError, match="gains: must be such that at least one validation sample completes"):
        tuning.tune(scenario())


def test_what_compiles_early_is_what_the_descents_ask_for(rollouts):
    tuning.tune(scenario(optimiser="lbfgs", budget=20.0))
    assert len(rollouts.begun) == 1
    assert set(rollouts.asked) == set(rollouts.begun)
    tuning.tune(scenario(budget=2.0))
    assert len(rollouts.begun) == 1  # without gradients there is nothing to compile for them


@pytest.mark.parametrize(("horizon", "checkpoint"), [(3.0, False), (20.0, True)])
def test_gradients_keep_every_step_of_short_horizons_only(horizon, checkpoint, monkeypatch):
    class Planned(Exception):
        pass

    def stop(structure, parameters, step, steps, plan, observer):
        raise Planned(plan.checkpoint, plan.packed)

    monkeypatch.setattr(objective_module, "rollout", stop)
    sensed = load_scenario("sensed")
    objective = objective_module.Objective.of(sensed, sensed.structure(), horizon)
    for for_gradient in (False, True):
        with pytest.raises(Planned) as planned:
            objective.evaluate(objective.space.start, sensed.parameters(), for_gradient)
        assert planned.value.args == (checkpoint and for_gradient, for_gradient)
