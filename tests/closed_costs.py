"""Closed-form costs in the place of rollouts, for tests of what tuning does around them."""

import functools

import jax
import jax.numpy as jnp
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


def replace_rollouts(monkeypatch):
    """Closed forms instead of rollouts; ``lost`` says which vectors fail."""

    class Stand:
        calls, lost = 0, staticmethod(lambda vector: False)
        begun, asked = [], []  # gradients: what is compiled early, and what is asked for

    def evaluate(objective, vectors, samples, precision="float64"):
        terms = np.asarray(many("terms", np.asarray(vectors), samples.rows, np.ones(len(TERMS))))
        lost = np.array([[Stand.lost(vector)] * len(samples) for vector in vectors])
        return batches.Evaluated(terms, ~lost, np.where(lost, 0.5, 1.0))

    def gradients(objective, vectors, samples, coefficients):
        Stand.calls += 1
        Stand.asked.append((objective, samples.structure, samples.rows.shape[1]))
        return tuple(np.array(x) for x in many("gradient", np.asarray(vectors), samples.rows, coefficients))

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
