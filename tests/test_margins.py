"""Robust choice of gains, their margins, and the cost's slopes where gains chatter."""

import jax
import numpy as np
import pytest

import tuning
from tests.closed_costs import replace_rollouts, scenario
from tuning.cost import evaluate as batches
from tuning.cost import problem as problem_module
from tuning.reports import tune as report
from tuning.studies import chatter, margins


@pytest.fixture
def rollouts(monkeypatch):
    return replace_rollouts(monkeypatch)


def test_of_near_equal_gains_the_sturdier_is_kept(rollouts):
    """The cost of the stand-in is smooth; next to a wall its neighbours fail."""
    problem = problem_module.build_problem(scenario())
    rollouts.lost = lambda vector: vector[0] > -0.1
    near = np.zeros((2, problem.space.size))
    near[:, 0] = [-0.2, -1.0]
    kept = margins.sturdiest(problem, near, np.array([1.0, 1.005]))
    np.testing.assert_array_equal(kept, near[1])
    np.testing.assert_array_equal(margins.sturdiest(problem, near, np.array([1.0, 1.02])), near[0])


def test_of_equally_sturdy_gains_the_cheaper_is_kept(rollouts):
    """Changes of one gain cost the second vector a little less, by less than it costs more itself."""
    problem = problem_module.build_problem(scenario())
    near = np.zeros((2, problem.space.size))
    near[:, 0] = [-1.0, -0.999]
    own = problem.costs(near)
    assert 0.0 < own[0] - own[1] < 1e-3 * own[0]
    values = own[0] * np.array([1.0, 1.005])
    np.testing.assert_array_equal(margins.sturdiest(problem, near, values), near[0])


def test_margins_end_where_the_cost_rises_or_a_robot_fails(rollouts):
    problem = problem_module.build_problem(scenario())
    rollouts.lost = lambda vector: vector[0] > 0.5 + np.log(1.3)
    vector = np.full(problem.space.size, 0.5)
    found = margins.margins(problem, vector)
    assert [margin.name for margin in found] == problem.names
    assert found[0].above == "fails"
    assert found[0].high == pytest.approx(np.exp(0.5) * 1.2, rel=1e-6)
    limit = 1.1 * problem.cost.values(vector[None], problem.drawn(margins.SAMPLES, problem_module.CHOICE))[0]
    checked = 0
    for i, margin in enumerate(found):
        for value, beyond in ((margin.low, margin.below), (margin.high, margin.above)):
            moved = vector.copy()
            moved[i] = np.log(value + (margin.name.startswith("K_lambda")))
            samples = problem.drawn(margins.SAMPLES, problem_module.CHOICE)
            assert problem.cost.values(moved[None], samples)[0] <= limit * (1 + 1e-6)
            checked += beyond == "cost"
    assert checked > 0


def test_margins_end_at_bounds(rollouts):
    """The cost of the stand-in grows by less than a tenth up to the nearest bounds."""
    problem = problem_module.build_problem(scenario(gains=["K_lambda"], bounds={"K_lambda": [0.28, 0.32]}))
    found = margins.margins(problem, problem.space.start)
    assert {(margin.below, margin.above) for margin in found} == {("bound", "bound")}
    assert {(round(margin.low, 9), round(margin.high, 9)) for margin in found} == {(0.28, 0.32)}


@pytest.mark.parametrize(("ripple", "chattering"), [(0.0, False), (1e-3, True)])
def test_ripples_on_the_cost_are_told_from_its_slope(rollouts, monkeypatch, ripple, chattering):
    """Ripples of a thousandth, 0.006 from crest to crest: no larger step sees them."""
    smooth = batches.evaluate

    def evaluate(objective, vectors, samples, precision="float64"):
        found = smooth(objective, vectors, samples)
        waves = ripple * np.sin(1e3 * np.asarray(vectors)).sum(axis=1)
        return found._replace(terms=found.terms * (1.0 + waves)[:, None, None])

    monkeypatch.setattr(batches, "evaluate", evaluate)
    result = tuning.report(tuning.build_problem(scenario()), np.full(19, 0.35))
    assert result.slopes.chattering == chattering
    assert ("the gains chatter" in report.table(result)) == chattering


def test_slopes_over_both_lengths_agree_with_the_exact_one(rollouts):
    problem = tuning.build_problem(scenario())
    vector = np.full(problem.space.size, 0.35)
    with jax.enable_x64(True):
        found = chatter.slopes(problem, vector)
        _, exact = problem.slopes(vector, problem.drawn(chatter.SAMPLES, problem_module.CHOICE))
    assert found.small == pytest.approx(np.linalg.norm(exact), rel=1e-6)
    assert found.large == pytest.approx(np.linalg.norm(exact), rel=0.02)


def test_a_step_that_fails_is_a_margins_matter_not_a_slopes(rollouts):
    problem = tuning.build_problem(scenario())
    vector = np.full(problem.space.size, 0.35)
    rollouts.lost = staticmethod(lambda x: x[0] > 0.37)
    with jax.enable_x64(True):
        assert not chatter.slopes(problem, vector).chattering
