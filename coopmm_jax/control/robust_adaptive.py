"""The paper's controller: robust and adaptive, (12)-(15) and (18)-(24), with the force control below (17).

Its gains are ``parameters.Gains``, whose methods are the functions of this module.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control import adaptive, backstepping, motion
from coopmm_jax.control.controller import Command, Freedom, Seen
from coopmm_jax.control.force import ForceFeedback, pi_feedback
from coopmm_jax.control.gain_schedule import rate
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.mechanics.partitioning import split
from coopmm_jax.mechanics.robot import PLATFORM, per_robot
from coopmm_jax.mechanics.robot_kinematics import Position, position_rates
from coopmm_jax.parameters import Gains


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
    structure, model, t, k, independent = seen
    part, position = k.reduction.part, k.bodies.position
    targets = desired_motion(model.reference, t)

    def eta_rate(desired: Desired, at: Position, eta: Scalar) -> Scalar:
        return backstepping.eta_rate(gains, desired, at, eta)

    eta_rates = per_robot(eta_rate, targets, position, state.eta)
    rates = per_robot(position_rates, position, k.velocity)
    z, z_rate = motion.reference_and_rate(model, part, (t, position, state.eta), rates, eta_rates)
    K_u_rate = rate("K_u", model.schedule, t)
    errors = motion.motion_errors(gains, part, z, z_rate, independent, state.integral, K_u_rate)
    damping = tuple(gain * s for gain, s in zip(gains.K_sigma, errors.sigma, strict=True))
    acceleration = minus(errors.nu_rate, damping)
    first, second = split(part, errors.utilde)

    f = motion.regressors(k, acceleration, independent)
    one, two = per_robot(lambda d, p: backstepping.coupling_signal(gains, d, p), targets, position)
    platform_error = first[:PLATFORM] + second[:PLATFORM]
    U2 = adaptive.robust_force(structure, gains, f, errors.sigma, state.c_hat, platform_error, one + two, t)
    force = motion.on_all_joints(structure, k.reduction, motion.nominal_force(model, k, acceleration), U2)
    integral_rate = first[PLATFORM:] + second[PLATFORM:]
    c_hat_rate = adaptive.adaptation(gains, f, errors.sigma, state.c_hat, t)

    def state_rates(force_error: Vector) -> ControllerState:
        return ControllerState(integral_rate, eta_rates, c_hat_rate, force_error)

    return Command(force, state_rates, {"sigma": errors.sigma})


def force_feedback(gains: Gains, state: ControllerState) -> ForceFeedback:
    """lambda_h = lambda_d - K_lambda e_lambda - K_I E, below (17)."""
    return pi_feedback(gains.K_lambda, gains.K_I, state.force_integral)


def estimates(gains: Gains, state: ControllerState) -> Vector:
    """chat (5,)."""
    del gains
    return state.c_hat
