"""The robust adaptive motion controller: its state, and its command at one instant, (18)-(24)."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control import adaptive, backstepping, motion
from coopmm_jax.control.gain_schedule import rate
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import split
from coopmm_jax.mechanics.robot import PLATFORM, ROBOTS, per_robot
from coopmm_jax.mechanics.robot_kinematics import Position, position_rates
from coopmm_jax.parameters import Gains, Structure


class ControllerState(NamedTuple):
    """State of the controller; also used for its rates."""

    integral: Vector  # I of the independent arm joints [rad], Idot = utilde
    eta: Pair[Scalar]  # of (15) [rad/s]
    c_hat: Vector  # (5,), bound estimates
    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


class MotionCommand(NamedTuple):
    """Force that the motion controller asks for, and the rates of its state."""

    force: Pair[Vector]  # F on all joints of each robot (5,), with L^T F = U1 + U2
    sigma: Vector
    integral_rate: Vector
    eta_rate: Pair[Scalar]
    c_hat_rate: Vector

    def rates(self, force_error: Vector) -> ControllerState:
        """Rates of the controller's state under a measured force error e_lambda (m,) [N]."""
        return ControllerState(self.integral_rate, self.eta_rate, self.c_hat_rate, force_error)


def at_rest(gains: Gains, velocities: int, rows: int, zero: Scalar) -> ControllerState:
    """State at the start: integrals and eta at zero, bounds at their initial estimates (5,).

    Args:
        gains: of the rollout.
        velocities: number n of independent velocities.
        rows: number m of constraint rows.
        zero: a scalar of the rollout's dtype.
    """
    return ControllerState((zero,) * (velocities - ROBOTS * PLATFORM), (zero, zero), gains.c_hat0, (zero,) * rows)


def motion_control(
    structure: Structure, model: Model, t: Scalar, k: Kinematics, independent: Vector, state: ControllerState
) -> MotionCommand:
    """(18)-(24) with the nominal model, and the generalised force F on all joints.

    Args:
        structure: static choices.
        model: gains, reference and nominal model.
        t: time [s].
        k: kinematics at the measured state.
        independent: u^1 (n,), as measured.
        state: of the controller.
    """
    gains, part, position = model.gains, k.reduction.part, k.bodies.position
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
    return MotionCommand(
        force=motion.on_all_joints(structure, k.reduction, motion.nominal_force(model, k, acceleration), U2),
        sigma=errors.sigma,
        integral_rate=first[PLATFORM:] + second[PLATFORM:],
        eta_rate=eta_rates,
        c_hat_rate=adaptive.adaptation(gains, f, errors.sigma, state.c_hat, t),
    )
