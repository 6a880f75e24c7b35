"""Gradients by numbers of surface and contact, as JSON: run by test_compliant_contact.py in a process of its own.

Of its own for the reason that gradient_worker.py gives.
"""

import functools
import json

import jax
import jax.numpy as jnp

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.parameters import Gains, Hardware, Parameters, Plant, Structure, Surface
from tests.gradient_worker import central_differences, flat
from tests.workers import start_worker

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


def main():
    """Print the slopes by each of NUMBERS, sorted, and central differences: before the tip lifts off, and landed."""
    start_worker()
    plan = Plan.gradient(STEPS)
    reverse = jax.jit(jax.grad(lambda x, steps: cost(x, steps, plan)))
    value = jax.jit(lambda x, steps: cost(x, steps, plan))
    results = {}
    for name, steps, change in (("pressed", 150, 1e-4), ("landed", STEPS, 1e-5)):  # an impact is far from linear
        results[name] = flat(reverse(NUMBERS, steps))
        results[f"{name}_central"] = central_differences(functools.partial(value, steps=steps), NUMBERS, change)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
