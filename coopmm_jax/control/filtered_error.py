"""Filtered error sigma below (15), and what the laws that drive it to zero share: U1 of (18), states, force control."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control import backstepping, motion
from coopmm_jax.control.controller import Freedom, Seen
from coopmm_jax.control.force import ForceFeedback, pi_feedback
from coopmm_jax.control.gain_schedule import rate
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.mechanics.coordinates import AnyPosition
from coopmm_jax.mechanics.partitioning import split
from coopmm_jax.mechanics.robot import PLATFORM, per_robot
from coopmm_jax.mechanics.robot_kinematics import position_rates


class FilterState(NamedTuple):
    """State of a law on sigma that adapts nothing; also used for its rates."""

    integral: Vector  # I of the independent arm joints [rad], Idot = utilde
    eta: Pair[Scalar]  # of (15) [rad/s]
    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


class Filtered(NamedTuple):
    """Filtered error at one instant, what it is taken against, and what follows from it."""

    targets: Pair[Desired]
    sigma: Vector  # (n,)
    acceleration: Vector  # nudot - K_sigma sigma (n,)
    platform_error: Vector  # utilde_b (4,)
    integral_rate: Vector  # utilde of the independent arm joints
    eta_rates: Pair[Scalar]  # (15)


def filtered(gains: Any, seen: Seen, integral: Vector, eta: Pair[Scalar]) -> Filtered:
    """Sigma below (15) and the acceleration nudot - K_sigma sigma (n,) that (18) asks for.

    Args:
        gains: of a controller, with those of (12)-(15), K_u and K_sigma.
        seen: by the controller.
        integral: I of the independent arm joints [rad].
        eta: of each robot [rad/s].
    """
    _, model, t, k, independent = seen
    part, position = k.reduction.part, k.bodies.position
    targets = desired_motion(model.reference, t)

    def eta_rate(desired: Desired, at: AnyPosition, value: Scalar) -> Scalar:
        return backstepping.eta_rate(gains, desired, at, value)

    eta_rates = per_robot(eta_rate, targets, position, eta)
    rates = per_robot(position_rates, position, k.velocity)
    z, z_rate = motion.reference_and_rate(model, part, (t, position, eta), rates, eta_rates)
    K_u_rate = rate("K_u", model, t)
    errors = motion.motion_errors(gains, part, z, z_rate, independent, integral, K_u_rate)
    damping = tuple(gain * s for gain, s in zip(gains.K_sigma, errors.sigma, strict=True))
    first, second = split(part, errors.utilde)
    return Filtered(
        targets=targets,
        sigma=errors.sigma,
        acceleration=minus(errors.nu_rate, damping),
        platform_error=first[:PLATFORM] + second[:PLATFORM],
        integral_rate=first[PLATFORM:] + second[PLATFORM:],
        eta_rates=eta_rates,
    )


def start(gains: Any, freedom: Freedom, zero: Scalar) -> FilterState:
    """State at the start, all zero.

    Args:
        gains: of the controller.
        freedom: numbers of velocities and rows.
        zero: a scalar of the rollout's dtype.
    """
    del gains
    return FilterState((zero,) * freedom.arm_joints, (zero, zero), (zero,) * freedom.rows)


def state_rates(now: Filtered) -> Callable[[Vector], FilterState]:
    """Rates of the state, as a function of the measured force error (m,) [N]."""
    return lambda force_error: FilterState(now.integral_rate, now.eta_rates, force_error)


def force_feedback(gains: Any, state: Any) -> ForceFeedback:
    """lambda_h = lambda_d - K_lambda e_lambda - K_I E, below (17)."""
    return pi_feedback(gains.K_lambda, gains.K_I, state.force_integral)
