"""Results of tuning that only real rollouts can show, for test_objective.py."""

import numpy as np

from coopmm_jax.parameters import Gains
from coopmm_jax.scenario.scenario import load_scenario
from tuning.cost import evaluate
from tuning.cost.objective import TERMS
from tuning.cost.problem import build_problem

HORIZON = 0.1  # [s]
# Every gain that can be tuned, in a loop where each matters: limits of which the start asks more.
SCENARIO = {
    "law": {"delta_floor": 0.953, "feedforward": "projected"},  # the floor above delta(t), a dip of the contact force
    "actuators": {"wheel_limit": 25.0, "joint_limit": 15.0},
    "simulation": {"duration": HORIZON},
    "uncertainty": {"disturbance.scale": {"distribution": "uniform", "low": 1.0, "high": 4.0}},
    "tuning": {
        "gains": [name for name in Gains._fields if name != "k4"],  # of two axles only
        "channels": "shared",
        "tracking_from": 0.03,
        "validation_samples": 4,
        "weights": dict.fromkeys(TERMS, 1.0),
    },
}
STEP = 1e-4  # of central differences


def results():
    """Gradient and central differences (n,), one candidate's costs alone and among eight others, and names."""
    problem = build_problem(load_scenario("sensed", **SCENARIO))
    search, space, samples = problem.cost, problem.space, problem.samples(5, 4)
    start = space.start
    costs, gradients = evaluate.gradients(search.objective, start[None], samples, search.coefficients)
    moved = np.concatenate([start + sign * STEP * np.eye(space.size) for sign in (1, -1)])
    ahead, behind = np.split(evaluate.evaluate(search.objective, moved, samples).costs(search.coefficients), 2)
    others = np.concatenate([start + 0.1 * np.random.default_rng(0).normal(size=(8, space.size)), start[None]])
    weightings = np.outer([*np.linspace(0.1, 5.0, 8), 1.0], search.coefficients)  # one for each candidate
    among, slopes = evaluate.gradients(search.objective, others, samples, weightings)
    own = evaluate.evaluate(search.objective, start[None], samples)
    return {
        "gradient": gradients[0].tolist(),
        "central": ((ahead - behind) / (2.0 * STEP)).T.tolist(),
        "alone": [costs[0].tolist(), gradients[0].tolist()],
        "among": [among[8].tolist(), slopes[8].tolist()],
        "names": space.labels(),
        "terms": own.terms[0].tolist(),
        "costs": [costs[0].tolist(), own.costs(search.coefficients)[0].tolist()],
        "single": evaluate.evaluate(search.objective, start[None], samples, "float32").terms[0].tolist(),
    }
