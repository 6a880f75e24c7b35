"""Gradients by numbers of surface and contact, for test_compliant_contact.py."""

import functools

import jax.numpy as jnp

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.parameters import Gains, Hardware, Parameters, Plant, Structure, Surface
from tests.gradient_results import by_forward_mode, central_differences, forward_slopes

STEP, STEPS = 1e-3, 350
NUMBERS = {"curvature_n": 1.3, "curvature_e": 1.1, "penetration": 1e-3, "damping": 2.0, "K_lambda": 0.3}
STRUCTURE = Structure(feedforward="full", contact="compliant")


def cost(numbers, steps, plan):
    """Integral of squared force and of position errors, under NUMBERS, over so many steps."""
    shape = Conic(numbers["curvature_n"], numbers["curvature_e"])
    gains = Gains(K_lambda=(numbers["K_lambda"],) * 4, delta_floor=0.1)
    parameters = Parameters(
        plant=Plant(surface=Surface(shape=shape)),
        gains=gains,
        hardware=Hardware(penetration=numbers["penetration"], contact_damping=numbers["damping"]),
    )

    def update(total, t, signals):
        return total + STEP * (signals.force_error[0] ** 2 + 100.0 * sum(x**2 for x in signals.contact_point))

    return rollout(STRUCTURE, parameters, STEP, steps, plan, Observer(jnp.zeros(()), update)).total


def results():
    """The slopes by each of NUMBERS, sorted, and central differences: before the tip lifts off, and landed."""
    forward = by_forward_mode(lambda x, steps: cost(x, steps, Plan.gradient(STEPS)))
    found = {}
    for name, steps, change in (("pressed", 150, 1e-4), ("landed", STEPS, 1e-5)):  # an impact is far from linear
        found[name] = forward_slopes(forward, NUMBERS, steps)
        value = functools.partial(lambda steps, x: forward(x, NUMBERS, steps)[0], steps)
        found[f"{name}_central"] = central_differences(value, NUMBERS, change)
    return found
