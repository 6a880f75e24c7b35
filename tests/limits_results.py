"""Gradients of a sampled loop's cost under torque limits, and central differences, for test_actuators.py."""

import jax
import jax.numpy as jnp

from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.scenario.scenario import load_scenario
from tests.gradient_results import central_differences, flat

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
        return rollout(scenario.structure(), own, STEP, STEPS, Plan.gradient(STEPS), observer).total

    return cost, {name: getattr(parameters.gains, name) for name in NAMES}


def by_reverse_mode(form):
    """Slopes by every gain, in reverse mode and by central differences."""
    cost, gains = limited_cost(form)
    reverse = jax.jit(jax.value_and_grad(cost, has_aux=True))
    (value, largest), gradient = reverse(gains)
    central = central_differences(lambda x: reverse(x)[0][0], gains, RELATIVE_STEP)
    return {"cost": float(value), "largest": float(largest), "gradient": flat(gradient), "central": central}


def by_forward_mode(form):
    """One slope along all gains as they are, by forward mode, which compiles in a quarter of the time."""
    cost, gains = limited_cost(form)
    forward = jax.jit(lambda scale: jax.jvp(lambda s: cost(jax.tree.map(lambda x: s * x, gains)), (scale,), (1.0,)))
    (value, largest), (slope, _) = forward(1.0)
    central = central_differences(lambda x: forward(x["scale"])[0][0], {"scale": 1.0}, RELATIVE_STEP)
    return {"cost": float(value), "largest": float(largest), "gradient": [float(slope)], "central": central}


def results():
    """Slopes and costs under each form of limits."""
    return {"hard": by_forward_mode("hard"), "smooth": by_reverse_mode("smooth")}
