"""Results of falsify that only real rollouts can show, for test_falsify.py."""

import dataclasses
from unittest import mock

import numpy as np

import coopmm_jax as cm
from coopmm_jax.scenario.variation import LOWEST
from tuning.cost.objective import TERMS
from tuning.cost.problem import build_problem
from tuning.studies import falsify as module
from tuning.studies.falsify import SampleCost, falsify, worst_samples

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


def gradients(problem):
    """By reverse mode, by one-sided and by central differences, of all terms at two points, one of them at an end."""
    search = dataclasses.replace(problem.cost, coefficients=np.full(len(TERMS), 1e-2))
    landscape = SampleCost(search, problem.variation, problem.space.start)
    points = np.array([[0.3, 0.6, 0.8, 0.4, 0.1], [0.9, 0.2, 0.5, 0.7, 0.95]])
    moved = points[:, None, None] + STEP * np.array([1.0, -1.0])[:, None, None] * np.eye(5)  # (points, signs, D, D)
    ahead, behind = np.moveaxis(landscape.values(moved.reshape(-1, 5)).reshape(2, 2, 5), 1, 0)
    return {
        "reverse": landscape.reverse(points).tolist(),
        "differences": landscape.differences(points, landscape.values(points)).tolist(),
        "central": ((ahead - behind) / (2.0 * STEP)).tolist(),
        "finite_at_the_end": bool(np.all(np.isfinite(landscape.reverse(np.full((1, 5), LOWEST))))),
    }


def replayed(found, problem, folder):
    """The cost of a found sample from the ordinary simulation of its file, whose one term is the contact force's."""
    path = folder / "worst.toml"
    path.write_text(found.scenario.to_toml(), encoding="utf-8")
    run = cm.simulate(cm.load_scenario(path))
    contact = run.rows.index("contact_normal")
    error = run.constraint_force[:, contact] - run.constraint_force_desired[:, contact]
    return float(np.mean(error**2) * problem.cost.coefficients[list(TERMS).index("force")])


def results(folder):
    """Gradients, the course of a search by each kind of gradient, and what became of its scenario."""
    scenario = cm.load_scenario("paper", **SCENARIO)
    problem = build_problem(scenario)
    found, again = (falsify(scenario, 80, 16) for _ in range(2))
    worst = worst_samples(problem, problem.space.start, 3, 80, 16)
    landscape = SampleCost(problem.cost, problem.variation, problem.space.start)
    answers = gradients(problem) | {
        "cost": found.cost,
        "nominal_cost": found.nominal_cost,
        "nominal_replayed": replayed(dataclasses.replace(found, scenario=scenario), problem, folder),
        "replayed": replayed(found, problem, folder),
        "certain": not found.scenario.uncertainty.entries(),
        "same": found == again,
        "random": float(module.random_costs(problem, 80).max()),
        "spent": [found.rollouts, found.steps],
        "numbers": found.numbers,
        "worst": problem.cost.each(landscape.vector, worst).tolist(),
    }
    with mock.patch.object(module, "DIFFERENCES", 0):
        by_reverse = falsify(scenario, 80, 16, problem).cost
    return answers | {"by_reverse": by_reverse}
