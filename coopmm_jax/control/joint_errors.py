"""Errors of the independent joints in position and velocity, for controllers of the joints themselves.

Heading z1 and arm angles are what they are. The lateral position z2 has no input of its own: it comes in with the
forward one, as s3 of (14),

    p = (e1, e3 + k2 u_d1 e2, q - q_d)            r = (u_d1, u_d2 - k2 (u_d1^2 e3 + u_d1dot e2), qdot_d)

so that pdot = u^1 - r where the heading is right, and e2dot = -k2 u_d1^2 e2 where p vanishes: C. Samson, "Control of
chained systems", IEEE Trans. Automatic Control 40 (1995).
"""

from __future__ import annotations

from typing import NamedTuple

import jax

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.sincos import wrapped
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.backstepping import backstepping_errors
from coopmm_jax.control.controller import Seen
from coopmm_jax.control.gain_schedule import in_force
from coopmm_jax.control.motion import arm_joints
from coopmm_jax.control.posture import desired_postures, with_posture
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.errors import UserError
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import position_rates


class JointErrors(NamedTuple):
    """Errors of the independent joints at one instant."""

    position: Vector  # p (n,) [rad, m, rad]
    velocity: Vector  # u^1 - r (n,) [rad/s, m/s, rad/s]
    reference_rate: Vector  # rdot (n,)


def joint_errors(seen: Seen) -> JointErrors:
    """Errors p and u^1 - r (n,), and rdot (n,) by the chain rule over time and positions.

    Raises:
        UserError: a platform on two axles, whose front axle is not told where to turn.
    """
    _, model, t, k, independent = seen
    position = k.bodies.position
    if any(geometry.front is not None for geometry in model.geometry):
        raise UserError("law.controller", "one with backstepping, where a platform has two axles", "one of the joints")
    moving = (t * 0.0 + 1.0, per_robot(position_rates, position, k.velocity))
    reference, rate, errors = jax.jvp(lambda *at: _reference(seen, *at), (t, position), moving, has_aux=True)
    return JointErrors(errors, minus(independent, reference), rate)


def _reference(seen: Seen, t: Scalar, position: Pair[Position]) -> tuple[Vector, Vector]:
    """r (n,) and p (n,) of both robots at t [s]."""
    model, part = seen.model, seen.k.reduction.part
    gains = in_force(model, t)

    def of_one(desired: Desired, posture: Pair[Vector], p: Position, arm: Vector) -> Pair[Vector]:
        desired = with_posture(desired, posture, len(arm))
        s, u_d1 = backstepping_errors(gains, desired, p), desired.u1
        forward = desired.u2 - gains.k2 * (u_d1**2 * s.e3 + desired.u1_rate * s.e2)
        angles = (wrapped(joint - target) for joint, target in zip(arm, desired.arm, strict=True))
        return (u_d1, forward, *desired.arm_rate), (s.s1, s.s3, *angles)

    arms, targets = arm_joints(part, position), desired_motion(model.reference, t)
    (r1, p1), (r2, p2) = per_robot(of_one, targets, desired_postures(model, part, t), position, arms)
    return r1 + r2, p1 + p2
