"""Gradients of the loop along a path, of a trailer and a car, for test_path_motion.py."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.lookahead import aims_ahead
from coopmm_jax.loop.rollout import as_scalars
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Car, FrontInertia, Trailer
from tests.beside_a_path import FULL, ROUND, round_about

T = 0.3  # [s]
VELOCITY = (-0.3, 0.2, -0.1, 0.4, 0.1, 0.3)  # of the independent ones
# Numbers that are moved, and by how much in differences: truncation and rounding are both below 1e-9 there.
CHANGES = {
    **{"path": 3e-4, "rail": 3e-3, "rate": 1e-3, "offset": 3e-4, "k2": 3e-3, "curvature": 1e-3, "force": 1e-3},
    **{"wheelbase": 1e-3, "r_f": 1e-3, "d_f": 1e-3, "m_f": 1e-2, "I_f": 5e-3, "k4": 3e-3, "state": 1e-4},
}
# of a derivative by six evaluations, of sixth order
OFFSETS, WEIGHTS = np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60.0
FRONTS = ((Trailer(), FrontInertia()), (Car(), FrontInertia(1.0, 0.5, 0.1)))


def moved(x):
    """Parameters with the numbers of CHANGES moved by x (14,), the state apart; units of length follow the path."""
    path, rail, rate, offset, k2, curvature, force, wheelbase, r_f, d_f, m_f, I_f, k4, _ = x
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
        guide=plant.guide._replace(path=ROUND._replace(y0=ROUND.y0 + rail)),
        surface=surface,
    )
    gains = start.gains._replace(k2=start.gains.k2 + k2, k4=start.gains.k4 + k4)
    return start._replace(plant=plant, gains=gains, reference=reference)


@functools.cache
def moving():
    """The state at the start, but not at rest: its leaves and their tree."""
    parameters = as_scalars(moved(np.zeros(len(CHANGES))), float)
    start = jax.jit(lambda p: initial_state(FULL, build_model(p), p).state)(parameters)
    return jax.tree.flatten(jax.device_get(start._replace(velocity=VELOCITY)))


def start(x):
    """Weighted sum of the joints and the carriage from which a rollout starts."""
    parameters = as_scalars(moved(x), float)
    state = initial_state(FULL, build_model(parameters), parameters).state
    leaves = jax.tree.leaves((state.position, state.carriage))
    return sum(w * leaf for w, leaf in zip(np.linspace(0.5, 1.0, len(leaves)), leaves, strict=True))


def rates(x):
    """Weighted sum of the rates of ``moving``, by which everything moves."""
    (leaves, tree), parameters = moving(), as_scalars(moved(x), float)
    state = jax.tree.unflatten(tree, [leaf + x[-1] for leaf in leaves])
    found, _ = closed_loop(FULL, build_model(parameters), T, state)
    return sum(w * rate for w, rate in zip(np.linspace(0.5, 1.0, len(leaves)), jax.tree.leaves(found), strict=True))


def aims(x):
    """Weighted sum of what a rollout computes ahead of two of its steps."""
    values = aims_ahead(build_model(moved(x)).reference, 1e-3, float, False)(round(1000 * T), 2).values
    return jnp.vdot(values, np.linspace(0.5, 1.0, values.size).reshape(values.shape))


def results(function):
    """Slopes of a function by each of CHANGES in reverse mode, and by differences of sixth order."""
    both, zero = jax.jit(jax.value_and_grad(function)), np.zeros(len(CHANGES))
    central = [
        WEIGHTS @ [float(both(zero + k * h * unit)[0]) for k in OFFSETS] / h
        for h, unit in zip(CHANGES.values(), np.eye(len(CHANGES)), strict=True)
    ]
    return dict(zip(CHANGES, zip(both(zero)[1].tolist(), central, strict=True), strict=True))
