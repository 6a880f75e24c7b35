"""Stages of the search: scans, generations, descents along gradients."""

import numpy as np
import pytest

from tests.closed_costs import replace_rollouts, scenario
from tuning.cost import evaluate as batches
from tuning.cost import problem as problem_module
from tuning.cost.objective import FAILED
from tuning.cost.problem import unscaled
from tuning.cost.trials import DrawnTrials, steps_of
from tuning.search import method, stages
from tuning.search.method import Candidate


@pytest.fixture
def rollouts(monkeypatch):
    return replace_rollouts(monkeypatch)


@pytest.mark.parametrize(("knots", "kind"), [(1, stages.Generations), (4, stages.Generations), (8, stages.Descents)])
def test_auto_goes_along_gradients_where_numbers_are_many(knots, kind):
    assert isinstance(stages.plan(unscaled(scenario(schedule=knots))).wide, kind)


@pytest.mark.parametrize(("budget", "times"), [(0.99, 1), (1.01, 4)])
def test_narrow_generations_take_more_samples_if_the_budget_has_room_for_fifteen(budget, times):
    settings = {"optimiser": "cma", "samples": 3, "population": 8}
    fifteen = 15 * 8 * 12 * steps_of(unscaled(scenario())) / 1e6
    chosen = stages.plan(unscaled(scenario(budget=2.0 * budget * fifteen, **settings)))
    assert (chosen.wide.samples, chosen.narrow.samples) == (3, 3 * times)


def test_a_scan_finds_the_gain_that_is_far_off():
    class Far:
        low, high = np.full(5, -3.0), np.full(5, 3.0)

        def values(self, vectors, count, draw, precision="float64"):
            return np.sum((vectors - [0.0, 0.0, 2.9, 0.0, 0.0]) ** 2, axis=1)

    scan = stages.Scan(seed=1)
    place = stages.Place(np.zeros(5), 0, 0, 7, scan.begin(np.zeros(5)))
    for _ in range(5):
        assert not scan.ended(place, 0)
        place = scan.advance(place, Far()).place
    assert scan.ended(place, 0)
    np.testing.assert_array_equal(place.vector, [0.0, 0.0, 3.0, 0.0, 0.0])
    assert place.draw == 7  # all gains on the same samples


def test_generations_stay_between_the_bounds_and_come_to_the_best_point(rollouts):
    class Corner:
        low, high, seen = np.full(3, -1.0), np.full(3, 1.0), []

        def values(self, vectors, count, draw, precision="float64"):
            self.seen.append(vectors)
            return 1.0 + np.sum((vectors - [2.0, 0.3, -0.5]) ** 2, axis=1)

    trials, stage = Corner(), stages.Generations(0, 4, 16, 0.3, 1.0)
    place = stages.Place(np.zeros(3), 1, 0, 0, stage.begin(np.zeros(3)))
    while not stage.ended(place, 0):
        place = stage.advance(place, trials).place
    seen = np.concatenate(trials.seen)
    assert np.all((seen >= trials.low) & (seen <= trials.high))
    np.testing.assert_allclose(np.clip(stage.offer(place)[0], -1, 1), [1.0, 0.3, -0.5], atol=0.01)
    assert len(trials.seen) < 150


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


def candidate_at(chosen, vector):
    return Candidate(vector, chosen.start(vector))


@pytest.mark.parametrize("optimiser", ["lbfgs", "sgd"])
def test_steps_into_failing_gains_are_rejected_and_shortened(rollouts, optimiser):
    """Gains beyond a wall fail: the descent comes close and stays on the near side, and says how often it was held."""
    problem = problem_module.build_problem(scenario())
    chosen = method.method(optimiser, 1e3, "constant", None, 1)
    rollouts.lost = lambda vector: vector[0] > -1.3
    start = problem.space.inside(np.full(problem.space.size, -2.0))
    candidate, value, rejected = method.descend(DrawnTrials(problem), chosen, candidate_at(chosen, start), 3, 7, 4)
    assert value < FAILED
    assert -2.0 < candidate.vector[0] <= -1.3
    if optimiser == "sgd":
        assert rejected > 0


def test_a_gradient_that_is_not_finite_rejects_the_step_and_halves_the_next(rollouts, monkeypatch):
    problem = problem_module.build_problem(scenario())
    finite = batches.gradients
    monkeypatch.setattr(batches, "gradients", lambda *a: (finite(*a)[0], finite(*a)[1] * np.nan))
    chosen, start = method.LBFGS(), problem.start
    candidate, _, rejected = method.descend(DrawnTrials(problem), chosen, candidate_at(chosen, start), 3, 7, 2)
    np.testing.assert_array_equal(candidate.vector, start)
    assert rejected == 2
    assert candidate.reach == method.REACH / 4


def test_a_descent_goes_along_a_bound(rollouts):
    problem = problem_module.build_problem(scenario(bounds={"K_sigma": [0.45, 0.55]}))
    chosen = method.LBFGS()
    candidate, _, _ = method.descend(DrawnTrials(problem), chosen, candidate_at(chosen, problem.start), 3, 7, 12)
    inside = (candidate.vector >= problem.low) & (candidate.vector <= problem.high)
    assert inside.all()
    assert np.sum(candidate.vector[:6] == problem.high[:6]) >= 1
    _, (slope,) = problem.slopes(candidate.vector, problem.drawn(3, 7))
    assert np.abs(slope[6:]).max() < 0.2 * np.abs(problem.slopes(problem.start, problem.drawn(3, 7))[1]).max()
