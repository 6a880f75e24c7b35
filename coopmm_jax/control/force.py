"""Force control around the contact, below (17): lambda_h = lambda_d - K_lambda e - K_I int e."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.types import Vector


class ForceFeedback(NamedTuple):
    """Feedback of the force error e (m,) at one instant: lambda_h = lambda_d - proportional e - held."""

    proportional: Vector  # (m,) [-], greater than -1
    held: Vector  # (m,) [N], such as an integral part: what does not depend on e at this instant


def pi_feedback(K_lambda: Vector, K_I: Vector, integral: Vector) -> ForceFeedback:
    """Proportional and integral force control.

    Args:
        K_lambda: (m,) [-].
        K_I: (m,) [1/s].
        integral: E (m,) of the force error [N s].
    """
    return ForceFeedback(K_lambda, tuple(ki * E for ki, E in zip(K_I, integral, strict=True)))


def force_command(feedback: ForceFeedback, desired: Vector, error: Vector) -> Vector:
    """lambda_h (m,) [N] from the desired force and the force error e (m,) [N]."""
    return tuple(d - kp * e - held for d, kp, held, e in zip(desired, *feedback, error, strict=True))


def ideal_force_error(feedback: ForceFeedback, without_feedback: Vector, desired: Vector) -> Vector:
    """e (m,) [N] when the force is measured at once: (1 + K_lambda) e = lambda_0 - lambda_d - K_I E.

    The algebraic loop closes in one division because lambda = lambda_0 + (lambda_h - lambda_d) row by row;
    K_lambda > -1 is what keeps it solvable (proof of Theorem 3.1).

    Args:
        feedback: of the controller.
        without_feedback: lambda_0 (m,), the multiplier under lambda_h = lambda_d [N].
        desired: lambda_d (m,) [N].
    """
    return tuple(
        (free - held) / (1.0 + kp) for free, kp, held in zip(minus(without_feedback, desired), *feedback, strict=True)
    )
