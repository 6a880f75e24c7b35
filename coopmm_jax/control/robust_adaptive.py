"""The paper's controller: robust and adaptive, (12)-(15) and (18)-(24), with the force control below (17).

Its gains are ``parameters.Gains``, whose methods are the functions of this module.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control import adaptive, backstepping, motion
from coopmm_jax.control.controller import Command, Freedom, Seen
from coopmm_jax.control.filtered_error import Filtered, filtered, force_feedback
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.mechanics.robot import per_robot

__all__ = ["command", "estimates", "force_feedback", "robust_term", "start"]


class ControllerState(NamedTuple):
    """State of the controller; also used for its rates."""

    integral: Vector  # I of the independent arm joints [rad], Idot = utilde
    eta: Pair[Scalar]  # of (15) [rad/s]
    c_hat: Vector  # (5,), bound estimates
    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


def start(gains: Gains, freedom: Freedom, zero: Scalar) -> ControllerState:
    """State at the start: integrals and eta at zero, bounds at their initial estimates (5,).

    Args:
        gains: of the rollout.
        freedom: numbers of velocities and rows.
        zero: a scalar of the rollout's dtype.
    """
    return ControllerState((zero,) * freedom.arm_joints, (zero, zero), gains.c_hat0, (zero,) * freedom.rows)


def command(gains: Gains, seen: Seen, state: ControllerState) -> Command:
    """(18)-(24) with the nominal model, and the generalised force F on all joints, with L^T F = U1 + U2."""
    structure, model, t, k, _ = seen
    now = filtered(gains, seen, state.integral, state.eta)
    U2, f = robust_term(gains, seen, now, state.c_hat)
    force = motion.on_all_joints(structure, k.reduction, motion.nominal_force(model, k, now.acceleration), U2)
    c_hat_rate = adaptive.adaptation(gains, f, now.sigma, state.c_hat, t)

    def state_rates(force_error: Vector) -> ControllerState:
        return ControllerState(now.integral_rate, now.eta_rates, c_hat_rate, force_error)

    return Command(force, state_rates, {"sigma": now.sigma})


def robust_term(gains: Any, seen: Seen, now: Filtered, c: Vector) -> tuple[Vector, adaptive.Regressors]:
    """U2 of (19) (n,), and the factors f_k of its bounds.

    Args:
        gains: of a controller, with beta, lam_min and delta_floor.
        seen: by the controller.
        now: filtered error.
        c: bounds of the uncertainty (5,), estimated or given.
    """
    structure, _, t, k, independent = seen
    f = motion.regressors(k, now.acceleration, independent)
    one, two = per_robot(lambda d, p: backstepping.coupling_signal(gains, d, p), now.targets, k.bodies.position)
    U2 = adaptive.robust_force(structure, gains, f, now.sigma, c, now.platform_error, one + two, t)
    return U2, f


def estimates(gains: Gains, state: ControllerState) -> Vector:
    """chat (5,)."""
    del gains
    return state.c_hat
