"""Gradients of a sampled loop's cost under torque limits, and central differences, for test_actuators.py."""

import jax.numpy as jnp

from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.scenario.scenario import load_scenario
from tests.gradient_results import by_forward_mode, central_differences, forward_slopes

LIMIT = {"wheel": 20.0, "joint": 4.0}  # [N m], low enough that much of the start is spent at them
STEP, STEPS = 1e-3, 500
NAMES = ("K_I", "K_lambda", "K_sigma", "k1")
RELATIVE_STEP = 1e-5  # of central differences: small enough that hardly a sample passes a hard limit's corner


def sample_cost(total, t, signals):
    """Mean square of force errors [N^2] and sigma, and the largest torque as a share of its actuator's limit."""
    cost, largest = total
    error = sum(e**2 for e in signals.force_error) + 100.0 * sum(s**2 for s in signals.computed["sigma"])
    for robot in signals.torque:
        for torque, kind in zip(robot, ("wheel",) * 2 + ("joint",) * 3, strict=True):
            largest = jnp.maximum(largest, jnp.abs(torque) / LIMIT[kind])
    return cost + error / STEPS, largest


def limited_cost(form):
    """Cost and largest share of a limit as a function of the gains of NAMES, and these; with a form of limits."""
    actuators = {f"{kind}_limit": limit for kind, limit in LIMIT.items()}
    scenario = load_scenario("sensed", actuators=actuators | {"limit_form": form})
    parameters = scenario.parameters()
    observer = Observer((jnp.zeros(()), jnp.zeros(())), sample_cost)

    def cost(gains):
        own = parameters._replace(gains=parameters.gains._replace(**gains))
        return rollout(scenario.structure(), own, STEP, STEPS, Plan.batch(STEPS, STEPS + 1), observer).total

    return cost, {name: getattr(parameters.gains, name) for name in NAMES}


def slopes(form):
    """Slopes by every gain, in forward mode and by central differences."""
    cost, gains = limited_cost(form)
    forward = by_forward_mode(cost)
    value, largest = forward(gains, gains)[0]
    return {
        "cost": float(value),
        "largest": float(largest),
        "gradient": [slope for slope, _ in forward_slopes(forward, gains)],
        "central": central_differences(lambda x: forward(x, gains)[0][0], gains, RELATIVE_STEP),
    }


def results():
    """Slopes and costs under each form of limits."""
    return {form: slopes(form) for form in ("hard", "smooth")}
