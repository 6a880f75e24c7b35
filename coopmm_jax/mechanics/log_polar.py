"""Chart of a platform on two axles in polar coordinates about the world's origin: straight ahead is nothing special.

With the rear axle at r (cos z1, sin z1), heading beta to the left of the circle through it, on a path of curvature
kappa = tan(phi)/wheelbase, the chained form with n_v = 4 has

    z1: bearing,   z2 = ln r,   z3 = -tan(beta),   z4 = (1 - r kappa / cos(beta)) / cos(beta)^2

so that a circle about the origin is (t, ln R, 0, 0). With s = 1 + z3^2 speed and yaw rate of the rear axle are

    V = sigma u1,  sigma = exp(z2) sqrt(s)   and   w = tau u1,  tau = 1 - z4/s,

and the steering angle phi that of the vector (sigma, tau wheelbase). Singular is a heading towards or away from the
origin, alone. All of it is without a unit of length.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.angle import angle_of
from coopmm_jax.algebra.matrix import Matrix
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.mechanics.coordinates import LongPosition, with_joints
from coopmm_jax.parameters import Car, Front


class Turn(NamedTuple):
    """Rates of both axles for a unit of u1, and of the steering for u."""

    speed: Scalar  # sigma, of the rear axle [m]
    yaw: Scalar  # tau [-]
    ahead: Scalar  # speed of the front axle [m]
    bending: tuple[Scalar, Scalar]  # dphi/dt by u1 and by u2 [-]


def turn(front: Front, z: Vector) -> Turn:
    """``Turn`` at chained coordinates z (4,)."""
    _, z2, z3, z4 = z
    s = 1.0 + z3 * z3
    sigma, tau = jnp.exp(z2) * jnp.sqrt(s), 1.0 - z4 / s
    lever = tau * front.wheelbase
    squared = sigma * sigma + lever * lever
    sigma_rate = sigma * (z3 + z3 * z4 / s)  # by u1; tau's by u1 and by u2
    tau_rate = 2.0 * z3 * z4 * z4 / (s * s), -1.0 / s
    share = front.wheelbase / squared
    bending = (share * (tau_rate[0] * sigma - tau * sigma_rate), share * tau_rate[1] * sigma)
    return Turn(sigma, tau, jnp.sqrt(squared), bending)


def turn_and_rate(front: Front, position: LongPosition, u: Vector) -> tuple[Turn, Turn]:
    """``Turn``, and its time derivative at velocities u (n,)."""
    z = position[:4]
    rates = (u[0], u[0] * position.z3, u[0] * position.z4, u[1])
    return jax.jvp(lambda *z: turn(front, z), z, tuple(x + 0.0 * y for x, y in zip(rates, z, strict=True)))


def lengthened(place: Vector, rho: Scalar, arm: Vector) -> LongPosition:
    """Chained coordinates from those of (6).

    Args:
        place: z1, z2, z3 of (6) [rad, m, m].
        rho: distance of the centre of turning to the left of the rear axle, infinite straight ahead [m].
        arm: joint angles (k,) [rad].
    """
    heading, lateral, forward = place
    squared = lateral * lateral + forward * forward
    bearing = heading + angle_of(lateral, forward)
    z4 = (1.0 - squared / (lateral * rho)) * squared / (lateral * lateral)
    return with_joints(LongPosition, (bearing, 0.5 * jnp.log(squared), forward / lateral, z4), arm)


def place(position: LongPosition) -> tuple[Scalar, Scalar, Scalar]:
    """z1, z2, z3 of (6) [rad, m, m]."""
    z3 = position.z3
    lateral = jnp.exp(position.z2) / jnp.sqrt(1.0 + z3 * z3)
    return position.z1 - angle_of(1.0 + 0.0 * z3, z3), lateral, lateral * z3


def steering(front: Front, position: LongPosition) -> Scalar:
    """Angle phi of the front axle, positive to the left [rad]."""
    at = turn(front, position[:4])
    return angle_of(at.speed, at.yaw * front.wheelbase)


def turning_radius(front: Front, z: Vector) -> Scalar:
    """Distance rho of the centre of turning to the left, infinite straight ahead [m], at chained coordinates z (4,)."""
    at = turn(front, z)
    return at.speed / at.yaw


def front_rows(front: Front, position: LongPosition, u: Vector) -> tuple[Matrix, Vector]:
    """Speed and yaw rate of the front axle from u (2 x n), and their derivatives where udot = 0 (2,)."""
    now, rate = turn_and_rate(front, position, u)
    none = (0,) * (len(u) - 2)
    mapped = Matrix([(now.ahead, 0, *none), (now.yaw + now.bending[0], now.bending[1], *none)])
    turning = (rate.yaw + rate.bending[0]) * u[0] + rate.bending[1] * u[1]
    return mapped, (rate.ahead * u[0], turning)


def actuator_force(front: Front, wheel_radius: Scalar, position: LongPosition, torque: Vector) -> Vector:
    """``two_axles.actuator_force`` (n,) [N m]."""
    first, second, *joints = torque
    at = turn(front, position[:4])
    bend_1, bend_2 = at.bending
    if isinstance(front, Car):
        return (at.speed * first / wheel_radius + bend_1 * second, bend_2 * second, *joints)
    forward, turning = (first + second) / front.r_f, (first - second) * front.l_f / front.r_f
    return (at.ahead * forward + (at.yaw + bend_1) * turning, bend_2 * turning, *joints)


def actuator_torque(front: Front, wheel_radius: Scalar, position: LongPosition, force: Vector) -> Vector:
    """``two_axles.actuator_torque`` (n,) [N m]."""
    first, second, *joints = force
    at = turn(front, position[:4])
    bend_1, bend_2 = at.bending
    turning = second / bend_2
    if isinstance(front, Car):
        return (wheel_radius * (first - bend_1 * turning) / at.speed, turning, *joints)
    forward = (first - (at.yaw + bend_1) * turning) / at.ahead
    common, difference = 0.5 * front.r_f * forward, 0.5 * front.r_f * turning / front.l_f
    return (common + difference, common - difference, *joints)


def actuator_rates(front: Front, wheel_radius: Scalar, position: LongPosition, u: Vector) -> Vector:
    """``two_axles.actuator_rates`` (n,) [rad/s]."""
    at = turn(front, position[:4])
    bending = at.bending[0] * u[0] + at.bending[1] * u[1]
    if isinstance(front, Car):
        return (at.speed * u[0] / wheel_radius, bending, *u[2:])
    forward, turning = at.ahead * u[0], (at.yaw * u[0] + bending) * front.l_f
    return ((forward + turning) / front.r_f, (forward - turning) / front.r_f, *u[2:])
