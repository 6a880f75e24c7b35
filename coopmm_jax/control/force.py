"""Force control around the contact, below (17): lambda_h = lambda_d - K_lambda e - K_I int e."""

from __future__ import annotations

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.types import Vector
from coopmm_jax.parameters import Gains


def force_command(gains: Gains, desired: Vector, error: Vector, integral: Vector) -> Vector:
    """lambda_h (m,) [N] from the force error e (m,) [N] and its integral [N s]."""
    return tuple(
        d - kp * e - ki * E for d, kp, ki, e, E in zip(desired, gains.K_lambda, gains.K_I, error, integral, strict=True)
    )


def ideal_force_error(gains: Gains, without_feedback: Vector, desired: Vector, integral: Vector) -> Vector:
    """e (m,) [N] when the force is measured at once: (1 + K_lambda) e = lambda_0 - lambda_d - K_I E.

    The algebraic loop closes in one division because lambda = lambda_0 + (lambda_h - lambda_d) row by row;
    K_lambda > -1 is what keeps it solvable (proof of Theorem 3.1).

    Args:
        gains: of the force loop.
        without_feedback: lambda_0 (m,), the multiplier under lambda_h = lambda_d [N].
        desired: lambda_d (m,) [N].
        integral: E (m,) [N s].
    """
    return tuple(
        (free - ki * E) / (1.0 + kp)
        for free, kp, ki, E in zip(minus(without_feedback, desired), gains.K_lambda, gains.K_I, integral, strict=True)
    )
