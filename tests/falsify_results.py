"""Results of falsify that only real rollouts can show, for test_falsify.py."""

import dataclasses

import jax.numpy as jnp
import numpy as np

import coopmm_jax as cm
from coopmm_jax.scenario.variation import LOWEST, vary
from tuning.cost.objective import TERMS, Evaluation, Objective
from tuning.cost.problem import build_problem, with_objective
from tuning.studies.falsify import SampleCost, falsify, random_costs, worst_samples

HORIZON = 0.1  # [s]
MASS = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
# Every distribution, numbers of both robots, numbers that share a draw.
UNCERTAINTY = {
    "plant.masses": MASS | {"group": "scale"},
    "plant.l2": {"distribution": "truncated_normal", "mean": 1.0, "std": 0.02, "low": 0.97, "high": 1.04}
    | {"relative": True, "group": "scale"},
    "reference.contact_force": {"distribution": "normal", "mean": 15.0, "std": 1.0},
    "disturbance.frequency": {"distribution": "log_uniform", "low": 0.5, "high": 2.0},
    "initial.th": {"distribution": "normal", "mean": 0.0, "std": 0.02, "each": True},
}
SCENARIO = {
    "law": {"delta_floor": 0.95},  # above delta(t), a dip of the contact force
    "simulation": {"duration": HORIZON, "stream": 3},
    "uncertainty": UNCERTAINTY,
    "tuning": {
        "tracking_from": 0.03,
        "validation_samples": 4,
        "weights": dict.fromkeys(TERMS, 0.0) | {"force": 1.0},
    },
}
STEP = 1e-5  # of central differences


class InClosedForm(Objective):
    """A closed form of what varies, and of the gains, in the place of rollouts."""

    def evaluate(self, vector, parameters, for_gradient=False):
        (one, two), (first, second) = parameters.plant.inertia, parameters.plant.geometry
        angles = (parameters.start[0].th - 0.02) ** 2 + jnp.sin(parameters.start[1].th)
        cost = one.m_p * two.m1 * (first.l2 + second.l2**2) + jnp.exp(0.1 * parameters.reference.contact_force)
        cost = cost + parameters.disturbance[0].wave.frequency * angles
        terms = tuple((i + 1.0) * cost + jnp.sum(vector**2) for i in range(len(self.terms)))
        return Evaluation(terms, cost > 0.0, 1.0)


def closed_problem(scenario):
    """The problem of a scenario with ``InClosedForm`` as its objective."""
    variation = vary(scenario)
    objective = InClosedForm.of(scenario, variation.structure(), HORIZON)
    problem = with_objective(scenario, variation, objective)
    return dataclasses.replace(problem, cost=dataclasses.replace(problem.cost, coefficients=np.full(len(TERMS), 1e-2)))


def slopes(cost, problem):
    """By reverse mode, by one-sided and by central differences at two points, one of them at an end; and at the lowest.

    Args:
        cost: of ``problem``'s samples, as ``SampleCost`` takes it.
        problem: with the uncertainty of this file.
    """
    landscape = SampleCost(cost, problem.variation, problem.start)
    points = np.array([[0.3, 0.6, 0.8, 0.4, 0.1], [0.9, 0.2, 0.5, 0.7, 0.95]])
    moved = points[:, None, None] + STEP * np.array([1.0, -1.0])[:, None, None] * np.eye(5)  # (points, signs, D, D)
    ahead, behind = np.moveaxis(landscape.values(moved.reshape(-1, 5)).reshape(2, 2, 5), 1, 0)
    reverse = landscape.reverse(np.concatenate([points, np.full((1, 5), LOWEST)]))
    return {
        "reverse": reverse[:2],
        "differences": landscape.differences(points, landscape.values(points)),
        "central": (ahead - behind) / (2.0 * STEP),
        "at_the_end": reverse[2],
    }


def assert_alike(slopes):
    """All kinds of ``slopes`` agree, and none vanishes."""
    scale = np.abs(slopes["central"]).max(axis=1, keepdims=True)
    for kind, error in (("reverse", 1e-6), ("differences", 1e-5)):
        np.testing.assert_array_less(np.abs(slopes[kind] - slopes["central"]) / scale, error)
    np.testing.assert_allclose(slopes["reverse"], slopes["central"], rtol=2e-6)
    assert np.all(slopes["central"] != 0.0)
    assert np.all(np.isfinite(slopes["at_the_end"]))


def replayed(found, problem, folder):
    """The cost of a found sample from the ordinary simulation of its file, whose one term is the contact force's."""
    path = folder / "worst.toml"
    path.write_text(found.scenario.to_toml(), encoding="utf-8")
    run = cm.simulate(cm.load_scenario(path))
    contact = run.rows.index("contact_normal")
    error = run.constraint_force[:, contact] - run.constraint_force_desired[:, contact]
    return float(np.mean(error**2) * problem.cost.coefficients[list(TERMS).index("force")])


def results(folder):
    """The course of a search, and what became of its scenario."""
    scenario = cm.load_scenario("paper", **SCENARIO)
    problem = build_problem(scenario)
    found, again = (falsify(scenario, 80, 16) for _ in range(2))
    worst = worst_samples(problem, problem.space.start, 3, 80, 16)
    landscape = SampleCost(problem.cost, problem.variation, problem.space.start)
    return {
        "cost": found.cost,
        "nominal_cost": found.nominal_cost,
        "nominal_replayed": replayed(dataclasses.replace(found, scenario=scenario), problem, folder),
        "replayed": replayed(found, problem, folder),
        "certain": not found.scenario.uncertainty.entries(),
        "same": found == again,
        "random": float(random_costs(problem, 80).max()),
        "spent": [found.rollouts, found.steps],
        "numbers": found.numbers,
        "worst": problem.cost.each(landscape.vector, worst).tolist(),
    }
