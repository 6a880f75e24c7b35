"""Results of tuning that only real rollouts can show, for test_objective.py."""

import jax
import jax.numpy as jnp
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
KNOTS = {"schedule.times": [0.0, 0.03, 0.08]}  # of gains that change over time: one before tracking counts, one after
KNOTS |= {"schedule.k2": [5.0, 8.0, 6.0], "tuning.gains": ["K_sigma", "K_lambda", "k2", "K_u"]}


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
    found = {
        "gradient": gradients[0].tolist(),
        "central": ((ahead - behind) / (2.0 * STEP)).T.tolist(),
        "alone": [costs[0].tolist(), gradients[0].tolist()],
        "among": [among[8].tolist(), slopes[8].tolist()],
        "names": space.labels(),
        "terms": evaluate.evaluate(search.objective, start[None], samples).terms[0].tolist(),
        "single": evaluate.evaluate(search.objective, start[None], samples, "float32").terms[0].tolist(),
    }
    return found | _over_time()


def _over_time():
    """Slope along one direction of gains at their knots, by forward mode of the plain cost and by a difference."""
    problem = build_problem(load_scenario("sensed", **SCENARIO).with_overrides(KNOTS))
    cost, start, samples = problem.cost, problem.start, problem.samples(5, 2)
    direction = np.random.default_rng(1).normal(size=start.size)
    parameters = jax.tree.unflatten(samples.structure, list(jnp.asarray(samples.rows.T)))

    @jax.jit
    def along(vector):
        of_each = jax.vmap(cost.objective.cost, in_axes=(None, 0, None))
        return jax.jvp(lambda x: of_each(x, parameters, cost.coefficients), (vector,), (direction,))

    plain, slopes = along(start)
    step = 0.01 * STEP  # limits begin and end at a sample, which puts bends on the cost
    moved = start + step * np.array([[0.0], [1.0], [-1.0]]) * direction
    costs = evaluate.evaluate(cost.objective, moved, samples).costs(cost.coefficients)
    return {
        "plain": [plain.tolist(), costs[0].tolist()],
        "along_knots": [slopes.tolist(), ((costs[1] - costs[2]) / (2.0 * step)).tolist()],
        "knots": problem.names,
    }
