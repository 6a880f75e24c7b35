"""The course of a tuning run, around closed-form costs in the place of rollouts."""

import csv
import functools
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tuning
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import load_scenario
from tuning.cost import evaluate as tiles
from tuning.cost import objective as objective_module
from tuning.cost import problem as problem_module
from tuning.cost.objective import FAILED, TERMS
from tuning.cost.risk import risk
from tuning.reports import tune as report
from tuning.search import method
from tuning.search.method import Candidate, Search
from tuning.studies import comparison, state
from tuning.studies import tune as study
from tuning.studies.comparison import Comparison

MASS = {"plant.m_p": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
QUICK = {"validation_samples": 4, "test_samples": 8, "race_samples": 2, "samples": 3, "starts": 16, "horizon": 2.0}


def scenario(**settings):
    return load_scenario("paper", uncertainty=MASS, tuning=QUICK | settings)


def terms_of(vector, row):
    """A curved valley in every pair of neighbours, at a place that depends on the sample; all terms positive."""
    place = 0.3 + 0.1 * jnp.mean(jnp.where(jnp.abs(row) < 100.0, row, 0.0))  # no limits, no number of a noise stream
    bends = (vector[1:] - 0.2 * vector[:-1] ** 2) ** 2
    total = jnp.sum(bends) + jnp.sum((vector - place) ** 2 * jnp.linspace(0.1, 3.0, len(vector)))
    return jnp.stack([total / (i + 1) + 0.01 for i in range(len(TERMS))])


@functools.partial(jax.jit, static_argnums=0)
def many(kind, vectors, rows, coefficients):
    def cost(vector, row):
        return jnp.dot(coefficients, terms_of(vector, row))

    function = terms_of if kind == "terms" else jax.value_and_grad(cost)
    return jax.vmap(lambda v: jax.vmap(lambda r: function(v, r))(rows))(vectors)


@pytest.fixture
def rollouts(monkeypatch):
    """Closed forms instead of rollouts; ``lost`` says which vectors fail."""

    class Stand:
        calls, lost = 0, staticmethod(lambda vector: False)
        begun, asked = [], []  # gradients: what is compiled early, and what is asked for

    def evaluate(objective, vectors, samples):
        terms = np.asarray(many("terms", np.asarray(vectors), samples.rows, np.ones(len(TERMS))))
        lost = np.array([[Stand.lost(vector)] * len(samples) for vector in vectors])
        return tiles.Evaluated(terms, ~lost, np.where(lost, 0.5, 1.0))

    def gradients(objective, vectors, samples, coefficients):
        Stand.calls += 1
        Stand.asked.append((objective, samples.structure, samples.rows.shape[1]))
        return tuple(np.array(x) for x in many("gradient", np.asarray(vectors), samples.rows, coefficients))

    def compare(problem, vectors, first, count):
        samples = problem.samples(first, count)
        found = evaluate(None, vectors, samples)
        metrics = {name: np.ones((2, count)) for name in ("contact_loss_fraction", "force_min")}
        series = {name: np.ones((2, 2, 3)) for name in comparison.measure.SERIES}
        costs = found.costs(problem.validation.coefficients)
        return Comparison(costs, found.terms, metrics, np.where(found.completed, 0, 1), np.arange(3.0), series)

    monkeypatch.setattr(tiles, "evaluate", evaluate)
    monkeypatch.setattr(tiles, "gradients", gradients)
    monkeypatch.setattr(
        tiles, "compile_gradients", lambda o, samples: Stand.begun.append((o, samples.structure, samples.rows.shape[1]))
    )
    monkeypatch.setattr(study, "compare", compare)  # tuning.tune is the function
    return Stand


def same(one, other):
    np.testing.assert_array_equal(one.after, other.after)
    assert [row[:-1] for row in one.history] == [row[:-1] for row in other.history]  # all but the seconds
    np.testing.assert_array_equal(one.comparison.costs, other.comparison.costs)


def test_tuning_lowers_the_cost_on_samples_it_has_not_seen(rollouts):
    result = tuning.tune(scenario(iterations=6))
    before, after = result.comparison.costs.mean(axis=1)
    assert after < 0.2 * before
    assert [row.best for row in result.history] == sorted((row.best for row in result.history), reverse=True)


def test_every_term_is_one_under_the_starting_gains(rollouts):
    problem = problem_module.build_problem(scenario(weights=dict.fromkeys(TERMS, 1.0)))
    fixed = problem.samples(problem_module.VALIDATION, QUICK["validation_samples"])
    value = problem.validation.values(problem.space.start[None], fixed)[0]
    assert value == pytest.approx(len(TERMS), rel=1e-6)  # the risk is float32 here, outside tune()


def test_same_seed_same_bits_and_another_seed_others(rollouts):
    first, again = (tuning.tune(scenario(iterations=2)) for _ in range(2))
    same(first, again)
    other = tuning.tune(scenario(iterations=2).with_overrides({"simulation.seed": 1}))
    assert np.any(other.after != first.after)


@pytest.mark.parametrize("settings", [{}, {"optimiser": "adam"}, {"adversaries": 2}], ids=str)
def test_killed_and_resumed_is_uninterrupted(rollouts, tmp_path, settings):
    settings = scenario(iterations=4, patience=9, **settings)
    whole = tuning.tune(settings, out=tmp_path / "whole")

    def kill(row):
        if row.iteration == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tuning.tune(settings, out=tmp_path / "part", progress=kill)
    assert not (tmp_path / "part" / "gains.toml").exists()
    resumed = tuning.tune(settings, out=tmp_path / "part", resume=True)
    same(whole, resumed)
    texts = [(tmp_path / name / "gains.toml").read_bytes() for name in ("whole", "part")]
    assert texts[0] == texts[1]


def test_a_descent_does_not_depend_on_those_beside_it(rollouts):
    problem = problem_module.build_problem(scenario())
    chosen, samples = method.LBFGS(), problem.samples(7, 3)
    starts = [Candidate(x, chosen.start(x)) for x in np.random.default_rng(0).normal(size=(8, problem.space.size))]
    together, _, _ = method.descend(problem.training, chosen, starts, samples, 3)
    alone, _, _ = method.descend(problem.training, chosen, starts[4:5], samples, 3)
    for a, b in zip(jax.tree.leaves(together[4]), jax.tree.leaves(alone[0]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_lbfgs_solves_a_quadratic_in_as_many_steps_as_it_has_pairs():
    """With exact curvature pairs of a 6-dimensional quadratic the two-loop direction becomes Newton's."""
    rng = np.random.default_rng(1)
    A = rng.normal(size=(6, 6))
    H, chosen = A @ A.T + np.eye(6), method.LBFGS()
    memory, conjugate = chosen.start(np.zeros(6)), np.linalg.eigh(H)[1].T
    for step in conjugate:
        memory = chosen.learn(memory, step, H @ step)
    g = rng.normal(size=6)
    direction, _ = chosen.direction(memory, np.zeros(6), g)
    np.testing.assert_allclose(direction, -np.linalg.solve(H, g), rtol=1e-12)


def test_a_pair_of_negative_curvature_is_not_learnt():
    chosen = method.LBFGS()
    memory = chosen.start(np.zeros(2))
    assert chosen.learn(memory, np.ones(2), -np.ones(2)) is memory


@pytest.mark.parametrize("optimiser", ["lbfgs", "sgd"])
def test_steps_into_failing_gains_are_rejected_and_shortened(rollouts, optimiser):
    """Gains beyond a wall fail: the descent comes close and stays on the near side, and says how often it was held."""
    problem = problem_module.build_problem(scenario())
    chosen = method.method(optimiser, 1e3, "constant", None, 1)
    rollouts.lost = lambda vector: vector[0] > -1.3
    start = np.full(problem.space.size, -2.0)
    candidates, values, rejected = method.descend(
        problem.training, chosen, [Candidate(start, chosen.start(start))], problem.samples(7, 3), 4
    )
    assert values[0] < FAILED
    assert -2.0 < candidates[0].vector[0] <= -1.3
    if optimiser == "sgd":
        assert rejected > 0


def test_a_gradient_that_is_not_finite_rejects_the_step_and_halves_the_next(rollouts, monkeypatch):
    problem = problem_module.build_problem(scenario())
    finite = tiles.gradients
    monkeypatch.setattr(tiles, "gradients", lambda *a: (finite(*a)[0], finite(*a)[1] * np.nan))
    start = np.zeros(problem.space.size)
    chosen = method.LBFGS()
    (candidate,), _, rejected = method.descend(
        problem.training, chosen, [Candidate(start, chosen.start(start))], problem.samples(7, 3), 2
    )
    np.testing.assert_array_equal(candidate.vector, start)
    assert rejected == 2
    assert candidate.reach == method.REACH / 4


def test_failed_rollouts_cost_more_the_earlier_they_fail():
    found = tiles.Evaluated(np.full((1, 3, 9), 1e9), np.array([[True, False, False]]), np.array([[1.0, 0.9, 0.1]]))
    assert found.costs(np.zeros(9))[0] == pytest.approx([0.0, 1.1 * FAILED, 1.9 * FAILED])


def test_race_keeps_the_best_in_order(rollouts):
    problem = problem_module.build_problem(scenario())
    starts = np.random.default_rng(5).normal(size=(10, problem.space.size))
    samples = problem.samples(3, 2)
    kept = method.race(problem.training, starts, samples, 3)
    values = problem.training.values(starts, samples)
    np.testing.assert_array_equal(kept, starts[np.argsort(values)[:3]])


def test_each_iteration_halves_the_descents_and_doubles_their_samples(rollouts, monkeypatch):
    lanes, descend = [], method.descend

    def watched(search, chosen, candidates, samples, steps):
        lanes.append((len(candidates), len(samples), samples.rows[0].tobytes()))
        return descend(search, chosen, candidates, samples, steps)

    monkeypatch.setattr(method, "descend", watched)
    tuning.tune(scenario(iterations=4, survivors=5, patience=9))
    assert [lane[:2] for lane in lanes] == [(5, 3), (2, 7), (1, 15), (1, 15)]
    assert len({lane[2] for lane in lanes}) == 4  # drawn anew


def test_adversaries_are_trained_on_from_then_on(rollouts, monkeypatch):
    trained, descend = [], method.descend

    def watched(search, chosen, candidates, samples, steps):
        trained.append(samples.rows)
        return descend(search, chosen, candidates, samples, steps)

    monkeypatch.setattr(method, "descend", watched)
    tuning.tune(scenario(iterations=3, survivors=1, adversaries=1, patience=9))
    assert [len(rows) for rows in trained] == [3, 4, 5]
    np.testing.assert_array_equal(trained[2][3], trained[1][3])
    mass = int(np.flatnonzero(np.any(trained[0] != trained[0][0], axis=0))[0])
    ends = 5.0 * np.array([0.8, 1.2])  # the cost is convex in the mass, so an end of its range is worst
    assert np.min(np.abs(ends - trained[1][3, mass])) < 1e-6


def test_the_better_half_is_kept_best_first():
    candidates = [Candidate(np.array([float(i)]), None) for i in range(5)]
    kept = method.better_half(candidates, np.array([3.0, 1.0, np.inf, 0.5, 2.0]))
    assert [c.vector[0] for c in kept] == [3.0, 1.0]
    assert method.better_half(kept[:1], np.array([7.0])) == kept[:1]


def test_search_gradient_weighs_the_samples_by_risk(rollouts):
    problem = problem_module.build_problem(scenario())
    search = Search(problem.training.objective, problem.training.coefficients, risk("cvar", 0.5))
    samples, x = problem.samples(3, 4), np.full(problem.space.size, 0.4)
    with jax.enable_x64(True):
        _, slopes = search.slopes(x[None], samples)
        h = 1e-6 * np.eye(problem.space.size)[2]
        ahead, behind = search.values(np.stack([x + h, x - h]), samples)
    assert slopes[0, 2] == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)


def test_stops_on_a_plateau_and_on_a_spent_budget(rollouts):
    flat = tuning.tune(scenario(iterations=50, patience=2, optimiser="sgd", learning_rate=1e-300))
    assert len(flat.history) < 20
    assert len(tuning.tune(scenario(iterations=50, time_budget=1e-9)).history) == 1


def test_outputs(rollouts, tmp_path):
    limits = {"requirements": {"force_min": ">= 0"}}
    settings = scenario(iterations=2).with_overrides(limits | {"law.delta_floor": 0.1})
    result = tuning.tune(settings, out=tmp_path / "out")
    report.write_report(tmp_path / "out", result)
    written = tomllib.loads((tmp_path / "out" / "gains.toml").read_text())
    assert load_scenario("paper", **written).parameters().gains == result.gains
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").read_text().splitlines()))
    assert [float(row["best"]) for row in rows] == [row.best for row in result.history]
    text = (tmp_path / "out" / "report.txt").read_text()
    assert "cost, CVaR(0.9)" in text
    assert "requirement force_min >= 0: success before 1.000" in text
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"convergence.png", "gains.png", "bands.png", "report.json"} <= written


def test_nothing_is_overwritten_by_a_run_that_does_not_fit(rollouts, tmp_path):
    settings, out = scenario(iterations=1), tmp_path / "out"
    tuning.tune(settings, out=out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for changed, resume, message in [
        (settings, False, "--out: must be a folder without a tuning run"),
        (settings.with_overrides({"gains.K_a": 3.0}), True, r"--resume: .*K_a = 2\.0, was K_a = 3\.0"),
    ]:
        with pytest.raises(UserError, match=message):
            tuning.tune(changed, out=out, resume=resume)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    with pytest.raises(UserError, match="--resume: must be used with a folder that has"):
        tuning.tune(settings, out=tmp_path / "other", resume=True)
    (out / state.NAME).write_bytes(b"PK spoilt")
    with pytest.raises(UserError, match=r"--resume: .* can be read"):
        tuning.tune(settings, out=out, resume=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"uncertainty": {}}, "uncertainty: must be given"),
        ({"tuning": {"horizon": 30.0}}, r"tuning\.horizon: must be at most simulation\.duration"),
        ({"tuning": {"tracking_from": 3.0}}, r"tuning\.tracking_from: must be before tuning\.horizon"),
        ({"tuning": {"survivors": 9, "starts": 8}}, r"tuning\.survivors: must be at most tuning\.starts"),
        ({"tuning": {"optimiser": "adamm"}}, r"tuning\.optimiser: must be lbfgs or an optimiser of optax"),
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
    tuning.tune(scenario())
    assert len(rollouts.begun) == 1
    assert set(rollouts.asked) == set(rollouts.begun)


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
