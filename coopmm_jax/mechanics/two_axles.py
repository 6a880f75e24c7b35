"""Platform on two axles: a tractor with a trailer, or a car, with the arm on the rear axle. Chained form with n_v = 4.

The front axle stands ``wheelbase`` ahead of the rear one, in the middle of which the arm's platform has its origin, and
is turned against it by the steering angle phi. A trailer's front axle is a tractor with a differential drive, a car's
is steered and its rear wheels drive: the same kinematics and inertia, another map from torques to forces.

With z4 = dz3/dz1 = wheelbase cot(phi) - z2 the rear axle turns about a point at rho = z2 + z4 to its left, so that

    V = rho u1,   w = u1,   Vf = +-hypot(rho, wheelbase) u1,   wf = w + dphi/dt = (1 - z3 q) u1 - q u2
    q = wheelbase / (wheelbase^2 + rho^2)

for speed and yaw rate of both axles, and (8) has u2 = dz4/dt. Lengths of the chained form are in a ``unit`` of the
platform's own, as the chained form does not change with it: u2 is then about a steering rate, and the least eigenvalue
of the reduced inertia is some hundred times that of a form in metres. A front axle straight ahead is singular, as z4 is
infinite there; ``log_polar`` has the chart that does without.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.angle import angle_of
from coopmm_jax.algebra.matrix import Matrix
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.mechanics import log_polar
from coopmm_jax.mechanics.coordinates import LongPosition, with_joints
from coopmm_jax.parameters import Car, Front, FrontInertia


class FrontLumped(NamedTuple):
    """Masses and inertias of the front axle in which its equations are linear."""

    mass: Scalar  # with the wheels' spin [kg]
    yaw: Scalar  # about the axle's midpoint [kg m^2]
    moment: Scalar  # m_f d_f [kg m]


class FrontMotion(NamedTuple):
    """Front axle's body rates (Vf, wf): forward speed [m/s] and yaw rate [rad/s]."""

    map: Matrix  # from u (2 x 5)
    rates: Vector  # (2,)
    map_rate: Vector  # (2,) their derivative where udot = 0


class _Turn(NamedTuple):
    z3: Scalar  # [m]
    rho: Scalar  # from the centre of turning to the rear axle [m]
    ahead: Scalar  # likewise to the front axle, with the sign of rho [m]
    q: Scalar  # [1/m]


def _turn(front: Front, position: LongPosition) -> _Turn:
    rho = front.unit * (position.z2 + position.z4)
    squared = front.wheelbase * front.wheelbase + rho * rho
    ahead = jnp.where(rho < 0.0, -1.0, 1.0) * jnp.sqrt(squared)
    return _Turn(front.unit * position.z3, rho, ahead, front.wheelbase / squared)


def lengthened(front: Front, place: Vector, rho: Scalar, arm: Vector) -> LongPosition:
    """Chained coordinates from those of (6).

    Args:
        front: of the platform.
        place: z1, z2, z3 of (6) [rad, m, m].
        rho: distance of the centre of turning to the left of the rear axle [m].
        arm: joint angles (3,) [rad].
    """
    if front.chart is not None:
        return log_polar.lengthened(place, rho, arm)
    z1, z2, z3 = place
    return with_joints(LongPosition, (z1, z2 / front.unit, z3 / front.unit, (rho - z2) / front.unit), arm)


def place(front: Front, position: LongPosition) -> tuple[Scalar, Scalar, Scalar]:
    """z1, z2, z3 of (6) [rad, m, m]."""
    if front.chart is not None:
        return log_polar.place(position)
    return position.z1, front.unit * position.z2, front.unit * position.z3


def steering(front: Front, position: LongPosition) -> Scalar:
    """Angle phi of the front axle, positive to the left [rad]."""
    if front.chart is not None:
        return log_polar.steering(front, position)
    rho = _turn(front, position).rho
    side = jnp.where(rho < 0.0, -1.0, 1.0)
    return angle_of(side * rho, side * front.wheelbase)


def turning_radius(front: Front, angle: Scalar) -> Scalar:
    """rho [m] at a steering angle [rad]."""
    return front.wheelbase / jnp.tan(angle)


def platform_map(front: Front, position: LongPosition) -> tuple[Vector, Vector]:
    """Body rates V and w, rows (2,) in (u1, u2); the rear axle's do not see u2."""
    if front.chart is not None:
        at = log_polar.turn(front, position[:4])
        return (at.speed, 0), (at.yaw, 0)
    return (front.unit * (position.z2 + position.z4), 0), (1, 0)


def platform_map_rate(front: Front, position: LongPosition, u: Vector) -> tuple[Scalar, Scalar]:
    """Derivatives of V and w where udot = 0 [m/s^2, rad/s^2]."""
    if front.chart is not None:
        _, rate = log_polar.turn_and_rate(front, position, u)
        return rate.speed * u[0], rate.yaw * u[0]
    return front.unit * u[0] * (u[0] * position.z3 + u[1]), 0


def front_motion(front: Front, position: LongPosition, u: Vector) -> FrontMotion:
    """Motion of the front axle at velocities u (5,)."""
    if front.chart is not None:
        rows, bias = log_polar.front_rows(front, position, u)
        return FrontMotion(rows, rows @ u, bias)
    (z3, rho, ahead, q), z4 = _turn(front, position), front.unit * position.z4
    u1, u2 = u[0], front.unit * u[1]
    rho_rate = u1 * z3 + u2
    q_rate = -2.0 * q * q * rho * rho_rate / front.wheelbase
    none = (0,) * (len(u) - 2)
    mapped = Matrix([(ahead, 0, *none), (1.0 - z3 * q, -q * front.unit, *none)])
    map_rate = (u1 * rho * rho_rate / ahead, -u1 * (u1 * z4 * q + z3 * q_rate) - u2 * q_rate)
    return FrontMotion(mapped, mapped @ u, map_rate)


def front_lumped(front: Front, inertia: FrontInertia) -> FrontLumped:
    """Lumped parameters of the front axle [kg, kg m^2, kg m]."""
    m, i = front, inertia
    return FrontLumped(
        mass=i.m_f + 2.0 * i.I_wf / m.r_f**2,
        yaw=i.I_f + i.m_f * m.d_f**2 + 2.0 * i.I_wf * (m.l_f / m.r_f) ** 2,
        moment=i.m_f * m.d_f,
    )


def front_bias(m: FrontLumped, rates: Vector) -> Vector:
    """Centrifugal forces of the front axle in its body rates (2,) [N, N m]."""
    V, w = rates
    return -m.moment * (w * w), m.moment * (w * V)


def actuator_force(front: Front, wheel_radius: Scalar, position: LongPosition, torque: Vector) -> Vector:
    """Generalised force in u (5,) of two torques of the platform and those of the joints [N m].

    Args:
        front: of the platform. Of a trailer the torques are of the tractor's right and left wheel; of a car of the
            rear wheels together, and of the steering.
        wheel_radius: of the rear wheels [m].
        position: of the robot.
        torque: (5,) [N m].
    """
    if front.chart is not None:
        return log_polar.actuator_force(front, wheel_radius, position, torque)
    first, second, *joints = torque
    z3, rho, ahead, q = _turn(front, position)
    if isinstance(front, Car):
        return (rho * first / wheel_radius - z3 * q * second, -q * second * front.unit, *joints)
    forward, turning = (first + second) / front.r_f, (first - second) * front.l_f / front.r_f
    return (ahead * forward + (1.0 - z3 * q) * turning, -q * turning * front.unit, *joints)


def actuator_torque(front: Front, wheel_radius: Scalar, position: LongPosition, force: Vector) -> Vector:
    """Inverse of ``actuator_force``: the five torques [N m] that exert a generalised force in u."""
    if front.chart is not None:
        return log_polar.actuator_torque(front, wheel_radius, position, force)
    first, second, *joints = force
    z3, rho, ahead, q = _turn(front, position)
    turning = -second / (q * front.unit)
    if isinstance(front, Car):
        return (wheel_radius * (first + z3 * q * turning) / rho, turning, *joints)
    forward = (first - (1.0 - z3 * q) * turning) / ahead
    common, difference = 0.5 * front.r_f * forward, 0.5 * front.r_f * turning / front.l_f
    return (common + difference, common - difference, *joints)


def actuator_rates(front: Front, wheel_radius: Scalar, position: LongPosition, u: Vector) -> Vector:
    """Rates of the actuators (5,) [rad/s]: B^T u, so that torque times rate is power."""
    if front.chart is not None:
        return log_polar.actuator_rates(front, wheel_radius, position, u)
    z3, rho, ahead, q = _turn(front, position)
    bending = -q * (z3 * u[0] + front.unit * u[1])  # dphi/dt
    if isinstance(front, Car):
        return (rho * u[0] / wheel_radius, bending, *u[2:])
    forward, turning = ahead * u[0], (u[0] + bending) * front.l_f
    return ((forward + turning) / front.r_f, (forward - turning) / front.r_f, *u[2:])
