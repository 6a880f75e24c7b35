"""Desired motion and force of section IV, with the derivatives that (12) and (13) ask for."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.parameters import Reference


class Desired(NamedTuple):
    """Desired motion of one robot at one time: chained coordinates, inputs, independent arm joints."""

    z1: Scalar  # [rad]
    z2: Scalar  # [m]
    z3: Scalar
    u1: Scalar  # [rad/s]
    u2: Scalar  # [m/s]
    u1_rate: Scalar  # [rad/s^2]
    arm: Vector  # [rad]
    arm_rate: Vector  # [rad/s]


def desired_motion(reference: Reference, t: Scalar) -> Pair[Desired]:
    """At t [s] both robots drive circles of radius z_d2 at a constant rate; arm yaw swings about its centre.

    The chained form (6) of a circle about the origin is z_d = (rate t, radius, 0), u_d = (rate, 0).
    """
    s, c = sincos(reference.arm_rate * t)

    def circle(radius: Scalar, centre: Scalar, swing: Scalar) -> Desired:
        angle, speed = centre - swing * c, swing * reference.arm_rate * s
        return Desired(reference.rate * t, radius, 0.0, reference.rate, 0.0, 0.0, (angle,), (speed,))

    return per_robot(circle, reference.radius, reference.arm_centre, reference.arm_swing)


def desired_force(reference: Reference, rows: tuple[str, ...]) -> Vector:
    """lambda_d (m,) [N]: the contact presses, every other row idles."""
    return tuple(reference.contact_force if name == "contact_normal" else 0.0 for name in rows)
