"""The control law of model.md section 3 on numpy arrays, for the two robots with all four constraint rows.

zeta (2, 4) holds (z1, z2, z3, a1) of each robot; u^1 (6,) their rates' inputs (u1, u2, a1dot).

>>> desired_motion(Reference(), 0.0)[0].round(2).tolist()
[[0.0, 2.4, 0.0, 1.05], [0.0, 1.0, 0.0, 1.57]]
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.parameters import ALL_ROWS, Gains, Parameters, Reference, Structure
from tests.oracles import lagrangian

INDEPENDENT = [0, 1, 2, 5, 6, 7]  # entries of u (10,) that make up u^1
ARMS = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0])  # which entries of u^1 have an integral


class ControllerState(NamedTuple):
    """States of the controller."""

    integral: np.ndarray  # (2,)
    eta: np.ndarray  # (2,)
    c_hat: np.ndarray  # (5,)
    force_integral: np.ndarray  # (4,)


class Law(NamedTuple):
    """Quantities that the motion controller computes at one instant."""

    sigma: np.ndarray  # (6,)
    nu_rate: np.ndarray  # (6,)
    U1: np.ndarray  # (6,)
    U2: np.ndarray  # (6,)
    force: np.ndarray  # F on all joints (10,)
    integral_rate: np.ndarray  # (2,)
    eta_rate: np.ndarray  # (2,)
    c_hat_rate: np.ndarray  # (5,)


def norm(x: np.ndarray) -> float:
    """Euclidean norm, smoothed."""
    return np.sqrt(np.sum(np.square(x)) + 1e-16)


def desired_motion(reference: Reference, t: float) -> tuple[jax.Array, jax.Array]:
    """zeta_d (2, 4) and its derivative at t."""

    def zeta(t: float) -> jax.Array:
        arm = jnp.array(reference.arm_centre) - jnp.array(reference.arm_swing) * jnp.cos(reference.arm_rate * t)
        radius = jnp.array(reference.radius)
        return jnp.stack([reference.rate * t * jnp.ones(2), radius, jnp.zeros(2), arm], axis=1)

    return jax.jvp(zeta, (t,), (1.0,))


def backstepping_errors(gains: Gains, reference: Reference, t: float, zeta: jax.Array) -> tuple[jax.Array, ...]:
    """s1, s2, s3 of (14), each (2,)."""
    e = zeta - desired_motion(reference, t)[0]
    return e[:, 0], e[:, 1], e[:, 2] + gains.k2 * e[:, 1] * reference.rate


def reference_velocity(gains: Gains, reference: Reference, t: float, zeta: jax.Array, eta: jax.Array) -> jax.Array:
    """z (6,) of (12) and (13); u_d = (rate, 0) is constant."""
    target, target_rate = desired_motion(reference, t)
    e, u_d1 = zeta - target, reference.rate
    _, s2, s3 = backstepping_errors(gains, reference, t, zeta)
    z_b2 = -s2 * u_d1 - gains.k3 * s3 - gains.k2 * u_d1**2 * e[:, 2]
    z_a = target_rate[:, 3] - gains.K_a * e[:, 3]
    return jnp.stack([u_d1 + eta, z_b2, z_a], axis=1).ravel()


def coupling_signal(gains: Gains, reference: Reference, t: float, zeta: np.ndarray) -> np.ndarray:
    """Non-zero entries of Lambda (2, 2), a row per robot."""
    s1, s2, s3 = map(np.asarray, backstepping_errors(gains, reference, t, zeta))
    return np.stack([gains.k1 * s1 + (s2 + gains.k2 * reference.rate * s3) * zeta[:, 2], s3], axis=1)


def robust_force(
    structure: Structure,
    gains: Gains,
    f: np.ndarray,
    sigma: np.ndarray,
    c_hat: np.ndarray,
    utilde_b: np.ndarray,
    Lambda: np.ndarray,
    t: float,
) -> np.ndarray:
    """U2 of (19) (6,), its six terms one by one."""
    delta, size = max((1 + t) ** -2, gains.delta_floor), norm(sigma)
    U2 = np.zeros_like(sigma)
    for c, f_k in zip(c_hat, f, strict=True):
        if structure.robust_term == "proof":
            U2 -= gains.beta / gains.lam_min * c**2 * f_k**2 * sigma / (c * f_k * size + delta)
        else:
            U2 -= gains.beta / gains.lam_min / c * c**2 * f_k**2 * sigma / (f_k * size + delta)
    if structure.u26 == "printed":
        return U2 - gains.beta * norm(utilde_b) * np.sum(Lambda**2) * sigma / (norm(Lambda) * size**2 + delta)
    return U2 - gains.beta * np.sum(Lambda**2) * sigma / (norm(Lambda) * size + delta)


def motion_control(
    structure: Structure, parameters: Parameters, t: float, q: np.ndarray, u: np.ndarray, controller: ControllerState
) -> Law:
    """(18)-(24) at q (2, 6) and an admissible u (10,)."""
    gains, reference = parameters.gains, parameters.reference
    u1 = u[INDEPENDENT]
    zeta = np.array([[*lagrangian.chained_position(q_i), q_i[3]] for q_i in q])
    zeta_rate = np.array([[u[i], u[i] * z[2], u[i + 1], u[i + 2]] for i, z in zip((0, 5), zeta, strict=True)])
    Lambda = coupling_signal(gains, reference, t, zeta)
    eta_rate = -gains.k0 * controller.eta - Lambda[:, 0]
    z, z_rate = jax.jvp(
        lambda *at: reference_velocity(gains, reference, *at), (t, zeta, controller.eta), (1.0, zeta_rate, eta_rate)
    )
    utilde = u1 - np.asarray(z)
    sigma = utilde + gains.K_u * ARMS * np.repeat(controller.integral, 3)
    nu_rate = np.asarray(z_rate) - gains.K_u * ARMS * utilde
    wanted = nu_rate - np.array(gains.K_sigma) * sigma

    nominal = lagrangian.coupled_terms(parameters.plant._replace(inertia=parameters.nominal), ALL_ROWS, q, u)
    L, L_dot_u1 = lagrangian.velocity_basis(ALL_ROWS, nominal)
    Mr, bias = lagrangian.reduced_terms(ALL_ROWS, nominal)
    U1 = Mr @ wanted + bias
    all_rates = np.concatenate([zeta_rate.ravel(), u[[3, 4, 8, 9]]])
    f = np.array([norm(wanted), norm(u1), norm(all_rates) * norm(u1), 1.0, norm(L)])
    utilde_b = utilde.reshape(2, 3)[:, :2].ravel()
    U2 = robust_force(structure, gains, f, sigma, controller.c_hat, utilde_b, Lambda, t)
    spread = np.linalg.pinv(L.T)
    full = nominal.M @ (L @ wanted + L_dot_u1) + nominal.h + spread @ U2
    return Law(
        sigma,
        nu_rate,
        U1,
        U2,
        force=full if structure.feedforward == "full" else spread @ (U1 + U2),
        integral_rate=utilde[[2, 5]],
        eta_rate=eta_rate,
        c_hat_rate=np.array(gains.gamma) / gains.lam_min * norm(sigma) * f - controller.c_hat / (1 + t) ** 2,
    )
