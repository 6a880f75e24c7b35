"""Gradients of a sampled loop's cost under torque limits, and central differences, for test_actuators.py."""

import functools
from unittest import mock

import jax.numpy as jnp

from coopmm_jax.loop import force_loop
from coopmm_jax.loop.devices import limited
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


def either(smooth, structure, hardware, torque):
    """Torques within limits of the form that is chosen, as data: one program for both."""
    features = structure.features
    hard = structure._replace(features=features._replace(torque_limits=True, smooth_limits=False))
    soft = structure._replace(features=features._replace(torque_limits=False, smooth_limits=True))
    forms = (limited(form, hardware, torque) for form in (soft, hard))
    return tuple(jnp.where(smooth, x, y) for x, y in zip(*forms, strict=True))


def results():
    """Slopes by every gain, in forward mode and by central differences, and costs, under each form of limits."""
    actuators = {f"{kind}_limit": limit for kind, limit in LIMIT.items()}
    scenario = load_scenario("sensed", actuators=actuators)
    parameters = scenario.parameters()
    gains = {name: getattr(parameters.gains, name) for name in NAMES}
    observer = Observer((jnp.zeros(()), jnp.zeros(())), sample_cost)

    def cost(gains, smooth):
        own = parameters._replace(gains=parameters.gains._replace(**gains))
        with mock.patch.object(force_loop, "limited", functools.partial(either, smooth)):
            return rollout(scenario.structure(), own, STEP, STEPS, Plan.alone(STEPS, STEPS + 1), observer).total

    forward, found = by_forward_mode(cost), {}
    for form, smooth in {"hard": False, "smooth": True}.items():
        value = functools.partial(lambda smooth, x: forward(x, gains, smooth)[0][0], smooth)
        reached, largest = forward(gains, gains, smooth)[0]
        found[form] = {
            "cost": float(reached),
            "largest": float(largest),
            "gradient": [slope for slope, _ in forward_slopes(forward, gains, smooth)],
            "central": central_differences(value, gains, RELATIVE_STEP),
        }
    return found
