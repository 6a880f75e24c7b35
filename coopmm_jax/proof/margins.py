"""Margins of the proof's steps and of the bound (40) while a rollout is traced: how far each holds at each instant.

As in ``lyapunov.py``, the bounds c_k of Assumption 3.2 are the least that hold along the motion, so all of the motion
has to be known: the rollout's states are kept, and looked at afterwards, at a few hundred instants.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Matrix, cholesky_solve
from coopmm_jax.algebra.types import Scalar
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics import partitioning
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot_kinematics import unplaced
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.proof.steps import STEPS, bounds_at, check_loop, sides, uncertainty_of
from coopmm_jax.proof.terms import ProofTerms, evaluate

# Signal of each step, and of the bound (40), whose excess is that of all steps.
NAMES = (*(f"proof_{step.strip('()')}" for step in STEPS), "proof_40")
INSTANTS = 401  # of a rollout that are looked at, at most


def state_of(structure: Structure, parameters: Parameters, signals: Signals) -> State:
    """State of the proof's loop, from its signals at one instant; every leaf is a scalar."""
    position = unplaced(build_model(parameters).geometry, signals.position, signals.steering)
    part = partitioning.partition(structure.rows, structure.joints)
    independent, _ = partitioning.parted(part, signals.velocity)
    return State(position, independent, signals.controller, carriage=signals.carriage)


def margins(structure: Structure, parameters: Parameters, t: jax.Array, states: State) -> dict[str, jax.Array]:
    """Right less left side of each step and of (40) by signal, (T,); negative where it does not hold [1/s].

    Args:
        structure: static choices.
        parameters: of the rollout.
        t: instants (T,) [s].
        states: of the loop, leaves (T,).

    Raises:
        UserError: a loop that the proof is not about.
    """
    check_loop(structure, parameters)
    model = build_model(parameters)

    def terms_at(instant: tuple[Scalar, State]) -> ProofTerms:
        one = jax.tree.map(lambda x: x[None], instant)
        return jax.tree.map(lambda x: x[..., 0], evaluate(structure, model, *one))

    terms = jax.lax.map(terms_at, (t, states))  # side by side they take XLA minutes to compile
    uncertainty = uncertainty_of(terms)
    c = jnp.max(bounds_at(jnp, terms, uncertainty, _spectral), axis=1)
    left, right = sides(jnp, parameters.gains, terms, uncertainty, c, _solve)
    found = [right[step] - left[step] for step in STEPS]
    return dict(zip(NAMES, [*found, jnp.sum(jnp.stack(found), axis=0)], strict=True))


def instants(last: Scalar) -> tuple[jax.Array, jax.Array]:
    """Numbers of the samples that are looked at (T,), and how many samples lie from one to the next.

    Args:
        last: number of the run's last sample.
    """
    stride = jnp.maximum(1, -(-jnp.asarray(last, jnp.int32) // (INSTANTS - 1)))
    return jnp.minimum(stride * jnp.arange(INSTANTS, dtype=jnp.int32), last), stride


# Not by LAPACK: of two batches at a time that call it, XLA's threads wait for each other for ever.
def _solve(matrices: jax.Array, right: jax.Array) -> jax.Array:
    """x (T, n) of M x = b, from positive definite M (T, n, n) and b (T, n)."""
    n = range(right.shape[-1])
    rows = Matrix([[matrices[:, i, j] for j in n] for i in n])
    return jnp.stack(cholesky_solve(rows, [right[:, i] for i in n])[0], axis=-1)


def _spectral(matrices: jax.Array) -> jax.Array:
    """Norms (T,) of matrices (T, n, n), with a derivative where they vanish.

    The largest eigenvalue of S = M^T M is tr(S P) of P = S^p / tr(S^p), p = 2^52; its derivative is that of S alone.
    """
    square = _product(jnp.swapaxes(matrices, -1, -2), matrices)
    positive = _trace(square) > 0.0
    first = jnp.where(positive[:, None, None], square, jnp.eye(square.shape[-1]))

    def squared(_: Any, power: jax.Array) -> jax.Array:
        power = _product(power, power)
        return power / _trace(power)[:, None, None]

    start = jax.lax.stop_gradient(first / _trace(first)[:, None, None])
    projector = jax.lax.stop_gradient(jax.lax.fori_loop(0, 52, squared, start))
    return jnp.where(positive, jnp.sqrt(_trace(_product(first, projector))), 0.0)


def _product(left: jax.Array, right: jax.Array) -> jax.Array:
    return jnp.sum(left[..., :, :, None] * right[..., None, :, :], axis=-2)


def _trace(matrices: jax.Array) -> jax.Array:
    return jnp.trace(matrices, axis1=-2, axis2=-1)
