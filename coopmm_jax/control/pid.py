"""PID of each wheel and each independent arm joint with gravity compensation, and PI on the forces.

    e = B^T p, edot = B^T (u^1 - r)                      with p and r of ``joint_errors``
    tau = -K_p e - K_int int e - K_d edot,  F = G0 + B tau

B^T turns errors of the platform into angles of its wheels, as it turns its velocities into their rates. The joints that
the constraints decide get their gravity compensation and the force control alone. No inertia and no other joint enters:
B. Siciliano, L. Sciavicco, L. Villani and G. Oriolo, Robotics (2009), sections 8.3 and 8.5.1. Its gains are
``kinds.baselines.Pid``.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import plus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.controller import Command, Freedom, Seen, from_torque
from coopmm_jax.control.filtered_error import force_feedback
from coopmm_jax.control.joint_errors import joint_errors
from coopmm_jax.kinds.baselines import Pid
from coopmm_jax.mechanics.partitioning import on_independent, parted
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_dynamics import gravity_force
from coopmm_jax.mechanics.robot_kinematics import actuator_rates

__all__ = ["command", "force_feedback", "start"]


class PidState(NamedTuple):
    """State of the controller; also used for its rates."""

    error_integral: Vector  # of e (n,) [rad s]
    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


def start(gains: Pid, freedom: Freedom, zero: Scalar) -> PidState:
    """State at the start, all zero.

    Args:
        gains: of the controller.
        freedom: numbers of velocities and rows.
        zero: a scalar of the rollout's dtype.
    """
    del gains
    return PidState((zero,) * freedom.velocities, (zero,) * freedom.rows)


def command(gains: Pid, seen: Seen, state: PidState) -> Command:
    """Generalised force F on all joints: weight of the arms, and the torques of the PIDs."""
    k, model = seen.k, seen.model
    part, errors = k.reduction.part, joint_errors(seen)
    position, velocity = _of_actuators(seen, errors.position), _of_actuators(seen, errors.velocity)
    torque = tuple(
        -(K_p * e + K_int * integral + K_d * rate)
        for K_p, e, K_int, integral, K_d, rate in zip(
            gains.K_p, position, gains.K_int, state.error_integral, gains.K_d, velocity, strict=True
        )
    )
    weight = per_robot(
        lambda lumped, arm, geometry: gravity_force(lumped, model.gravity, arm, geometry),
        model.nominal,
        k.bodies.arm,
        model.geometry,
    )
    force = per_robot(plus, weight, from_torque(seen, on_independent(part, torque)))
    signals = {"joint_error": position, "joint_rate_error": velocity}
    return Command(force, lambda force_error: PidState(position, force_error), signals)


def _of_actuators(seen: Seen, independent: Vector) -> Vector:
    """Angles or rates (n,) of wheels and independent arm joints for those of the independent velocities (n,)."""
    part = seen.k.reduction.part
    joints: Pair[Vector] = on_independent(part, independent)
    rates = per_robot(actuator_rates, seen.model.geometry, seen.k.bodies.position, joints)
    return parted(part, rates)[0]
