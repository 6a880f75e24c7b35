"""Terms of the proof of Theorem 3.1, (30)-(40), at any number of states at once.

The equations of this package are elementwise, so states whose leaves are arrays go through them as they are: no vmap
and no jit, hence nothing large to compile for this post-processing, whatever XLA's options.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.matrix import dot, minus, norm
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.control import adaptive, backstepping, motion
from coopmm_jax.control.reference import desired_motion
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics import partitioning
from coopmm_jax.mechanics.constrained_dynamics import both_dynamics, reduced_inertia, required_force
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.disturbance import disturbance_force
from coopmm_jax.mechanics.model import Model, build_model
from coopmm_jax.mechanics.plant import expected_kinematics
from coopmm_jax.mechanics.robot import PLATFORM
from coopmm_jax.mechanics.robot_dynamics import AnyLumped
from coopmm_jax.parameters import Parameters, Structure

# States evaluated together, the last one repeated to fill up: few enough to stay below 0.3 GB, many enough that the
# cost of a call does not count. Two sizes only, as each compiles its operations anew.
_BATCH, _FEW = 4096, 64


class Reduced(NamedTuple):
    """The reduced dynamics Mr u1dot + Cr u^1 + Gr + L^T d = L^T B tau, (11)."""

    M: Any  # (T, n, n)
    C: Any  # (T, n, n): linear in the velocities and symmetric as a bilinear map, (1/2) d(Cr u^1)/du^1
    G: Any  # (T, n)


class ProofTerms(NamedTuple):
    """The quantities of (30)-(40) at T instants."""

    plant: Reduced
    nominal: Reduced
    V1: Any  # (T,) of (31)
    V1_rate: Any  # (T,) its derivative along the flow
    decay: Any  # (T,) the decaying terms of (32), counted positive
    cross: Any  # (T,) utilde_b^T Lambda of (32)
    sigma: Any  # (T, n)
    sigma_rate: Any  # (T, n) along the flow
    independent: Any  # (T, n) u^1
    acceleration: Any  # (T, n) nudot - K_sigma sigma
    speed: Any  # (T,) |zetadot|
    disturbance: Any  # (T, n) L^T d
    disturbance_size: Any  # (T,) |d|, both robots, in u
    robust: Any  # (T, 6, n) U21 ... U26 of (19)
    c_hat: Any  # (T, 5)
    c_hat_rate: Any  # (T, 5)
    alpha: Any  # (T,)
    delta: Any  # (T,)


def proof_terms(structure: Structure, parameters: Parameters, t: np.ndarray, states: State) -> ProofTerms:
    """Evaluate ``ProofTerms`` as numpy arrays, in float64.

    Args:
        structure: static choices.
        parameters: of the rollout.
        t: (T,) [s].
        states: a ``State`` with leaves (T,).

    >>> from coopmm_jax.control.robust_adaptive import ControllerState
    >>> from coopmm_jax.mechanics.coordinates import Position
    >>> one, two = Position(0.0, 2.4, 0.0, 1.2, -0.8, 1.6), Position(0.0, 1.0, 0.0, 1.6, 2.3, 1.7)
    >>> state = State((one, two), (1.0, 0.0) * 3, ControllerState((0.0,) * 2, (0.0,) * 2, (1.0,) * 5, (0.0,) * 4))
    >>> states = jax.tree.map(lambda x: np.full(3, x), state)
    >>> proof_terms(Structure(), Parameters(), np.zeros(3), states).plant.M.shape
    (3, 6, 6)
    """
    count = len(t)
    size = _FEW if count <= _FEW else _BATCH
    batches = []
    with jax.enable_x64(True):
        model = build_model(parameters)
        for first in range(0, count, size):
            chosen = np.minimum(np.arange(first, first + size), count - 1)
            at, here = jax.tree.map(lambda x, chosen=chosen: jnp.asarray(np.asarray(x)[chosen]), (t, states))
            batches.append(jax.tree.map(np.asarray, evaluate(structure, model, at, here)))
    joined = jax.tree.map(lambda *parts: np.concatenate(parts, axis=-1)[..., :count], *batches)
    return jax.tree.map(lambda x: np.moveaxis(x, -1, 0), joined)


def evaluate(structure: Structure, model: Model, t: Scalar, state: State) -> ProofTerms:
    """``ProofTerms`` with the instants along the last axis.

    Args:
        structure: static choices.
        model: of the rollout.
        t: (T,) [s].
        state: a ``State`` with leaves (T,).
    """
    gains, part = model.gains, partitioning.partition(structure.rows, structure.joints)
    rates, _ = closed_loop(structure, model, t, state)
    (V1, sigma), (V1_rate, sigma_rate) = jax.jvp(
        partial(_V1_and_sigma, model, part), (t, state), (jnp.ones_like(t), rates)
    )
    # sigma = u^1 - nu, so nudot = d(u^1)/dt - sigmadot.
    damping = tuple(gain * s for gain, s in zip(gains.K_sigma, sigma, strict=True))
    acceleration = minus(minus(rates.velocity, sigma_rate), damping)

    k = expected_kinematics(structure, model, t, state.position, state.velocity, state.carriage)
    f = motion.regressors(k, acceleration, state.velocity)
    first, second = partitioning.split(part, sigma)
    platform_error = first[:PLATFORM] + second[:PLATFORM]  # sigma has no integral there
    signal, decay = _platform_terms(model, t, state)
    disturbing = disturbance_force(model.disturbance, t, model.geometry, k)
    like, trials = partial(_stacked, t), _trials(structure, model, t, state)
    return ProofTerms(
        plant=_reduced(trials, model.plant),
        nominal=_reduced(trials, model.nominal),
        V1=V1,
        V1_rate=V1_rate,
        decay=decay,
        cross=dot(platform_error, signal),
        sigma=like(sigma),
        sigma_rate=like(sigma_rate),
        independent=like(state.velocity),
        acceleration=like(acceleration),
        speed=motion.coordinate_speed(k, state.velocity),
        disturbance=like(partitioning.restrict(k.reduction, disturbing)),
        disturbance_size=norm(disturbing[0] + disturbing[1]),
        robust=like(_robust_terms(structure, gains, f, sigma, state.controller.c_hat, platform_error, signal, t)),
        c_hat=like(state.controller.c_hat),
        c_hat_rate=like(rates.controller.c_hat),
        alpha=adaptive.schedule(t),
        delta=adaptive.boundary_layer(gains, t),
    )


def _stacked(like: Scalar, entries: Any) -> jax.Array:
    """Nested tuples of scalars, structural ones included, as one array over the instants of ``like``."""
    if isinstance(entries, tuple | list):
        return jnp.stack([_stacked(like, entry) for entry in entries])
    return jnp.broadcast_to(jnp.asarray(entries, jnp.result_type(like)), jnp.shape(like))


def _V1_and_sigma(model: Model, part: partitioning.Partition, t: Scalar, state: State) -> tuple[Scalar, Vector]:
    """V1 of (31) and sigma as functions of the state, to be differentiated along the flow."""
    gains, controller = model.gains, state.controller
    V1 = 0.5 * dot(controller.eta, controller.eta)
    for desired, position in zip(desired_motion(model.reference, t), state.position, strict=True):
        V1 = V1 + backstepping.stored(gains, desired, position)
    z = motion.reference_velocities(model, part, t, state.position, controller.eta)
    utilde = minus(state.velocity, z)
    first, platform = len(part.independent[0]) - PLATFORM, (0.0,) * PLATFORM
    integral = (*platform, *controller.integral[:first], *platform, *controller.integral[first:])
    return V1, tuple(u + gains.K_u * i for u, i in zip(utilde, integral, strict=True))


def _platform_terms(model: Model, t: Scalar, state: State) -> tuple[Vector, Scalar]:
    """Lambda's non-zero entries (4,), and the decaying terms of (32) counted positive."""
    gains = model.gains
    signal: Vector = ()
    decay = gains.k0 * dot(state.controller.eta, state.controller.eta)
    for desired, position in zip(desired_motion(model.reference, t), state.position, strict=True):
        signal += backstepping.coupling_signal(gains, desired, position)
        decay = decay + backstepping.decay(gains, desired, position)
    return signal, decay


def _robust_terms(
    structure: Structure,
    gains: Gains,
    f: adaptive.Regressors,
    sigma: Vector,
    c_hat: Vector,
    platform_error: Vector,
    signal: Vector,
    t: Scalar,
) -> tuple[Vector, ...]:
    """U21 ... U26 of (19) one by one: all of (19) with what feeds the other terms at zero."""
    zero = jnp.zeros_like(t)
    idle = (zero,) * len(signal)

    def only(j: int) -> Vector:
        alone = adaptive.Regressors(*(f_k if j == k else zero for k, f_k in enumerate(f)))
        return adaptive.robust_force(structure, gains, alone, sigma, c_hat, idle, idle, t)

    none = adaptive.Regressors(*(zero,) * len(f))
    U26 = adaptive.robust_force(structure, gains, none, sigma, c_hat, platform_error, signal, t)
    return (*(only(j) for j in range(len(f))), U26)


def _trials(structure: Structure, model: Model, t: Scalar, state: State) -> Kinematics:
    """Kinematics at rest and one unit to either side of u^1 in each direction, all at once along a leading axis."""
    n = len(state.velocity)
    moving = np.array([0.0] + [1.0] * (2 * n))[:, None]
    offsets = np.hstack([np.zeros((n, 1)), np.eye(n), -np.eye(n)])[:, :, None]
    trials = tuple(moving * jnp.asarray(u)[None] + offset for u, offset in zip(state.velocity, offsets, strict=True))
    now, position, carriage = jax.tree.map(lambda x: x[None], (t, state.position, state.carriage))
    return expected_kinematics(structure, model, now, position, trials, carriage)


def _reduced(k: Kinematics, lumped: tuple[AnyLumped, AnyLumped]) -> Reduced:
    """The reduced dynamics with the plant's or the controller's lumped parameters, from ``_trials``.

    The bias Cr u^1 + Gr is quadratic in u^1, so central differences of unit step are its derivative.
    """
    dynamics = both_dynamics(lumped, k)
    position, trial = k.bodies.position[0].z1, k.velocity[0][0]
    M = _stacked(position, reduced_inertia(k, dynamics).rows)
    h = _stacked(trial, partitioning.restrict(k.reduction, required_force(dynamics, k.L_rate)))
    n = M.shape[0]
    return Reduced(M[:, :, 0], 0.25 * (h[:, 1 : n + 1] - h[:, n + 1 :]), h[:, 0])
