"""Robust adaptive compensation (19) and its adaptation laws (20)-(24)."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot, norm, scaled
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.parameters import Structure


class Regressors(NamedTuple):
    """f_k of (19): the factors of the bounds c_k of Assumption 3.2."""

    inertia: Scalar  # |K_sigma sigma - nudot|
    coriolis: Scalar  # |u^1|
    coriolis_rate: Scalar  # |zetadot| |u^1|
    gravity: Scalar  # 1
    disturbance: Scalar  # |L|


def schedule(t: Scalar) -> Scalar:
    """alpha_k(t) = delta_k(t) = 1 / (1 + t)^2, t [s]: vanishing and integrable, as Assumption 3.1 asks."""
    return 1.0 / (1.0 + t) ** 2


def boundary_layer(gains: Gains, t: Scalar) -> Scalar:
    """delta_k(t) of (19), t [s], held above the parameter ``delta_floor`` so that the robust term stays smooth."""
    return jnp.maximum(schedule(t), gains.delta_floor)


def adaptation(gains: Gains, f: Regressors, sigma: Vector, c_hat: Vector, t: Scalar) -> Vector:
    """(20)-(24): rates of the bound estimates chat (5,)."""
    alpha, size = schedule(t), norm(sigma) / gains.lam_min
    return tuple(gamma * size * f_k - alpha * c for c, gamma, f_k in zip(c_hat, gains.gamma, f, strict=True))


def robust_force(
    structure: Structure,
    gains: Gains,
    f: Regressors,
    sigma: Vector,
    c_hat: Vector,
    platform_error: Vector,
    coupling: Vector,
    t: Scalar,
) -> Vector:
    """U2 of (19) (n,), along -sigma.

    Args:
        structure: static choices of (19).
        gains: of the controller.
        f: the bounds' regressors.
        sigma: filtered tracking error (n,).
        c_hat: bound estimates (5,).
        platform_error: utilde_b (4,).
        coupling: Lambda's non-zero entries (4,).
        t: time [s].
    """
    delta, size = boundary_layer(gains, t), norm(sigma)
    terms = []
    for c, f_k in zip(c_hat, f, strict=True):
        # (34) only closes with chat inside the denominator; (19) prints it without.
        proof = structure.robust_term == "proof"
        terms.append((c * f_k) ** 2 / (c * f_k * size + delta) if proof else c * f_k**2 / (f_k * size + delta))
    gain = gains.beta / gains.lam_min * sum(terms[1:], terms[0])
    return scaled(-(gain + _u26_gain(structure, gains, size, platform_error, coupling, delta)), sigma)


def _u26_gain(
    structure: Structure, gains: Gains, size: Scalar, platform_error: Vector, coupling: Vector, delta: Scalar
) -> Scalar:
    """U26 of (19) is minus this times sigma; ``corrected`` drops |utilde_b| and squares so that (39) holds."""
    Lambda2 = dot(coupling, coupling)
    Lambda = norm(coupling)
    if structure.u26 == "corrected":
        return gains.beta * Lambda2 / (Lambda * size + delta)
    return gains.beta * norm(platform_error) * Lambda2 / (Lambda * size * size + delta)
