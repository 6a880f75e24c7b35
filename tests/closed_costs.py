"""Closed-form costs in the place of rollouts, for tests of what tuning does around them."""

import jax
import numpy as np

from coopmm_jax.scenario.scenario import load_scenario
from tuning.cost import evaluate as batches
from tuning.cost.objective import TERMS
from tuning.studies import compare as sets
from tuning.studies import comparison
from tuning.studies import result as outcome
from tuning.studies.comparison import Comparison

MASS = {"plant.m_p": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
QUICK = {"validation_samples": 4, "test_samples": 8, "screening_samples": 2, "samples": 2, "starts": 16, "budget": 20.0}


def scenario(**settings):
    return load_scenario("paper", uncertainty=MASS, tuning=QUICK | settings)


def sizes(rows):
    """Mean size of each sample's numbers (N,), without limits and numbers of a noise stream."""
    return np.mean(np.where(np.abs(rows) < 100.0, rows, 0.0), axis=-1)


def terms_of(vector, size):
    """A curved valley in every pair of neighbours (n, ...), at a place that depends on the sample; all positive."""
    weights = np.linspace(0.1, 3.0, len(vector)).reshape(-1, *(1,) * (vector.ndim - 1))
    bends = ((vector[1:] - 0.2 * vector[:-1] ** 2) ** 2).sum(0)
    total = bends + ((vector - 0.3 - 0.1 * size) ** 2 * weights).sum(0)
    return [total / (i + 1) + 0.01 for i in range(len(TERMS))]


@jax.jit
def costs_and_slopes(vectors, sizes, coefficients):
    """Of vectors (C, n) on samples of N sizes: (C, N) and (C, N, n)."""

    def cost(vector, size):
        return sum(coefficient * term for coefficient, term in zip(coefficients, terms_of(vector, size)))

    of_sizes = jax.vmap(jax.value_and_grad(cost), in_axes=(None, 0))
    return jax.vmap(of_sizes, in_axes=(0, None))(vectors, sizes)


def replace_rollouts(monkeypatch):
    """Closed forms instead of rollouts; ``lost`` says which vectors fail."""

    class Stand:
        calls, lost = 0, staticmethod(lambda vector: False)
        begun, asked = [], []  # gradients: what is compiled early, and what is asked for

    def evaluate(objective, vectors, samples, precision="float64"):
        terms = np.stack(terms_of(np.asarray(vectors).T[..., None], sizes(samples.rows)), axis=-1)
        lost = np.array([[Stand.lost(vector)] * len(samples) for vector in vectors])
        return batches.Evaluated(terms, ~lost, np.where(lost, 0.5, 1.0))

    def gradients(objective, vectors, samples, coefficients):
        Stand.calls += 1
        Stand.asked.append((objective, samples.structure, samples.rows.shape[1]))
        return tuple(np.array(x) for x in costs_and_slopes(np.asarray(vectors), sizes(samples.rows), coefficients))

    def compare(problem, vectors, first, count):
        samples = problem.samples(first, count)
        found = evaluate(None, vectors, samples)
        metrics = {name: np.ones((len(vectors), count)) for name in ("contact_loss_fraction", "force_min", "force_max")}
        series = {name: np.ones((len(vectors), 2, 3)) for name in comparison.measure.SERIES}
        costs = found.costs(problem.cost.coefficients)
        return Comparison(costs, found.terms, metrics, np.where(found.completed, 0, 1), np.arange(3.0), series)

    monkeypatch.setattr(batches, "evaluate", evaluate)
    monkeypatch.setattr(batches, "gradients", gradients)
    monkeypatch.setattr(
        batches,
        "compile_gradients",
        lambda o, samples: Stand.begun.append((o, samples.structure, samples.rows.shape[1])),
    )
    monkeypatch.setattr(batches, "compile_costs", lambda *_: None)
    monkeypatch.setattr(comparison, "compile_ahead", lambda _: None)
    monkeypatch.setattr(outcome, "compare", compare)
    monkeypatch.setattr(sets, "compare", compare)
    return Stand
