"""Gradients along the figure of eight over 0.3 s, for test_path_motion.py."""

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from tests.beside_a_path import EIGHT, FULL, eight

STEP, STEPS = 1e-3, 300
# Numbers that are moved, and by how much in differences: truncation and rounding are both below 1e-9 there.
CHANGES = {"path": 3e-4, "rail": 3e-3, "rate": 1e-3, "offset": 3e-4, "k2": 3e-3, "curvature": 1e-3, "force": 1e-3}
# of a derivative by six evaluations, of sixth order
OFFSETS, WEIGHTS = np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60.0


def cost(x):
    """Integral of force errors and contact places, and the end, with the numbers of CHANGES moved by x (7,)."""
    path, rail, rate, offset, k2, curvature, force = x
    start = eight()
    surface = start.plant.surface._replace(shape=Conic(1.0 / 0.7 + curvature, 1.0 / 0.7))
    reference = start.reference._replace(
        path=EIGHT._replace(xs=(3.0 + path, 0.0)),
        timing=start.reference.timing._replace(rate=0.7 + rate),
        offset=(0.7 + offset, -0.7),
        contact_force=start.reference.contact_force._replace(amplitude=5.0 + force),
        surface=surface,
    )
    guide = start.plant.guide._replace(path=EIGHT._replace(ys=(0.0, 1.2 + rail)))
    parameters = start._replace(
        reference=reference,
        plant=start.plant._replace(guide=guide, surface=surface),
        gains=start.gains._replace(k2=start.gains.k2 + k2),
    )

    def update(total, t, signals):
        return total + STEP * (signals.force_error[0] ** 2 + 100.0 * sum(x**2 for x in signals.contact_point))

    run = rollout(FULL, parameters, STEP, STEPS, Plan.gradient(STEPS), Observer(jnp.zeros(()), update))
    return run.total + sum(0.5 * p.z1 + p.z2 + 0.3 * p.z3 + p.a1 for p in run.state.position)


def results():
    """The slopes by each of CHANGES by reverse mode, and by differences of sixth order."""
    both, zero = jax.jit(jax.value_and_grad(cost)), np.zeros(len(CHANGES))
    central = [
        sum(w * float(both(zero + k * h * unit)[0]) for k, w in zip(OFFSETS, WEIGHTS, strict=True)) / h
        for h, unit in zip(CHANGES.values(), np.eye(len(CHANGES)), strict=True)
    ]
    return {"reverse": both(zero)[1].tolist(), "central": central}
