"""Gradients along a path over 0.3 s, of a trailer and a car, for test_path_motion.py."""

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.parameters import Car, FrontInertia, Trailer
from tests.beside_a_path import FULL, ROUND, round_about

STEP, STEPS = 1e-3, 300
# Numbers that are moved, and by how much in differences: truncation and rounding are both below 1e-9 there.
CHANGES = {
    **{"path": 3e-4, "rail": 3e-3, "rate": 1e-3, "offset": 3e-4, "k2": 3e-3, "curvature": 1e-3, "force": 1e-3},
    **{"wheelbase": 1e-3, "r_f": 1e-3, "d_f": 1e-3, "m_f": 1e-2, "I_f": 5e-3, "k4": 3e-3},
}
# of a derivative by six evaluations, of sixth order
OFFSETS, WEIGHTS = np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60.0
FRONTS = ((Trailer(), FrontInertia()), (Car(), FrontInertia(1.0, 0.5, 0.1)))


def moved(x):
    """Parameters with the numbers of CHANGES moved by x (13,); the units of length follow the path."""
    path, rail, rate, offset, k2, curvature, force, wheelbase, r_f, d_f, m_f, I_f, k4 = x
    start = round_about()
    surface = start.plant.surface._replace(shape=Conic(1.0 / 0.7 + curvature, 1.0 / 0.7))
    reference = start.reference._replace(
        path=ROUND._replace(xc=(ROUND.xc[0] + path,)),
        timing=start.reference.timing._replace(rate=1.0 + rate),
        offset=(0.7 + offset, -0.7),
        contact_force=start.reference.contact_force._replace(amplitude=5.0 + force),
        surface=surface,
    )

    def longer(geometry, front):
        lengths = {"wheelbase": front.wheelbase + wheelbase, "r_f": front.r_f + r_f, "d_f": front.d_f + d_f}
        return geometry._replace(front=front._replace(**lengths))

    def heavier(inertia, front):
        return inertia._replace(front=front._replace(m_f=front.m_f + m_f, I_f=front.I_f + I_f))

    plant, fronts = start.plant, tuple(zip(*FRONTS, strict=True))
    plant = plant._replace(
        geometry=tuple(map(longer, plant.geometry, fronts[0])),
        inertia=tuple(map(heavier, plant.inertia, fronts[1])),
        guide=plant.guide._replace(path=ROUND._replace(ys=(ROUND.ys[0] + rail,))),
        surface=surface,
    )
    gains = start.gains._replace(k2=start.gains.k2 + k2, k4=start.gains.k4 + k4)
    return start._replace(plant=plant, gains=gains, reference=reference)


def cost(x):
    """Integral of force errors and contact places, and the end of robots and force loop, under ``moved`` numbers."""

    def update(total, t, signals):
        return total + STEP * (signals.force_error[0] ** 2 + 100.0 * sum(x**2 for x in signals.contact_point))

    # Each step is kept, which compiles faster than checkpoints do; test_gradients.py has these.
    plan = Plan.gradient(STEPS, STEPS + 1, checkpoint=False)
    run = rollout(FULL, moved(x), STEP, STEPS, plan, Observer(jnp.zeros(()), update))
    ends = sum(0.5 * p.z1 + p.z2 + 0.3 * p.z3 + 0.1 * p.z4 + p.a1 for p in run.state.position)
    return run.total + ends + sum(run.state.controller.force_integral)


def results():
    """The slopes by each of CHANGES by reverse mode, and by differences of sixth order."""
    both, zero = jax.jit(jax.value_and_grad(cost)), np.zeros(len(CHANGES))
    central = [
        sum(w * float(both(zero + k * h * unit)[0]) for k, w in zip(OFFSETS, WEIGHTS, strict=True)) / h
        for h, unit in zip(CHANGES.values(), np.eye(len(CHANGES)), strict=True)
    ]
    return {"reverse": both(zero)[1].tolist(), "central": central}
