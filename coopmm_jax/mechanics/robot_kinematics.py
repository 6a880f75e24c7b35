"""Kinematics of one mobile manipulator: chained form (6)-(8), body rates, actuators, the arm's tip.

Positions are kept in the chained coordinates z1 = th, z2 = x cos th + y sin th, z3 = -x sin th + y cos th, which are
the platform's angle and its world position seen from its own axes (lateral, forward): no trigonometry of th is needed
until two robots meet. Between positions and forces stand the *body rates*, w = (V, w, W, Adot, Bdot): forward speed,
platform yaw rate, arm yaw rate, absolute pitch rates of both links, with w = T(z2) u for the coordinates
u = (u1, u2, a1dot, a2dot, a3dot) of (9).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Matrix, plus
from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics import two_axles
from coopmm_jax.mechanics.robot import ARM_JOINTS, PLATFORM, per_robot
from coopmm_jax.mechanics.two_axles import LongPosition
from coopmm_jax.parameters import Geometry, Pose


class Position(NamedTuple):
    """Chained coordinates [rad, m, m] and joint angles [rad] of one robot; also used for their rates."""

    z1: Scalar
    z2: Scalar
    z3: Scalar
    a1: Scalar
    a2: Scalar
    a3: Scalar


AnyPosition = Position | LongPosition


class Posture(NamedTuple):
    """Sines and cosines of one robot's arm, and where its tip is."""

    s1: Scalar  # arm yaw a1 from the forward axis
    c1: Scalar
    sA: Scalar  # pitch of link 2, A = a2
    cA: Scalar
    sB: Scalar  # pitch of link 3, B = a2 + a3
    cB: Scalar
    reach: Scalar  # of the tip along the arm's direction e [m]
    height: Scalar  # of the tip [m]


def chained(pose: Pose) -> Position:
    """(6): chained coordinates of a pose (x, y, th, a1, a2, a3)."""
    lateral, forward = in_platform(pose.x, pose.y, sincos(pose.th))
    return Position(pose.th, lateral, forward, pose.a1, pose.a2, pose.a3)


def standing(geometry: Geometry, pose: Pose, rho: Scalar) -> AnyPosition:
    """Chained coordinates of a pose, those of a platform on two axles included.

    Args:
        geometry: of the robot.
        pose: in the world.
        rho: turning radius where the pose leaves the front axle's angle open [m].
    """
    position, front = chained(pose), geometry.front
    if front is None:
        return position
    rho = rho if pose.steer is None else two_axles.turning_radius(front, pose.steer)
    return two_axles.lengthened(front, position[:3], rho, position[3:])


def placed(geometry: Geometry, position: AnyPosition) -> Position:
    """Coordinates of (6) and joint angles, whatever the platform has more."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return Position(*two_axles.place(geometry.front, position), *arm_of(position))
    assert isinstance(position, Position)
    return position


def steering(geometry: Pair[Geometry], position: Pair[AnyPosition]) -> Vector:
    """Angles of the front axles [rad], as many as the robots have."""
    both = zip(geometry, position, strict=True)
    return tuple(two_axles.steering(g.front, p) for g, p in both if g.front is not None and isinstance(p, LongPosition))


def unplaced(geometry: Pair[Geometry], place: Pair[Position], angles: Vector) -> Pair[AnyPosition]:
    """Chained coordinates of both robots from what ``placed`` and ``steering`` tell.

    Args:
        geometry: of both robots.
        place: coordinates of (6) and joint angles.
        angles: of the front axles [rad], as many as the robots have.
    """
    further = iter(angles)

    def of_one(g: Geometry, p: Position) -> AnyPosition:
        if g.front is None:
            return p
        return two_axles.lengthened(g.front, p[:3], two_axles.turning_radius(g.front, next(further)), arm_of(p))

    return per_robot(of_one, geometry, place)


def mismeasured(geometry: Geometry, position: AnyPosition, error: Position, bend: Scalar | None) -> AnyPosition:
    """Position as encoders tell it.

    Args:
        geometry: of the robot.
        position: as it is.
        error: of the coordinates of (6) and the joint angles [rad, m].
        bend: error of the front axle's angle [rad]; None where there is none.
    """
    front = geometry.front
    if front is None or bend is None or not isinstance(position, LongPosition):
        return Position(*plus(position, error))
    read = plus(placed(geometry, position), error)
    rho = two_axles.turning_radius(front, two_axles.steering(front, position) + bend)
    return two_axles.lengthened(front, read[:3], rho, read[3:])


def arm_of(position: AnyPosition) -> Vector:
    """Joint angles (3,) [rad]."""
    return position[-ARM_JOINTS:]


def unchained(position: Position) -> Vector:
    """Inverse of ``chained``: (x, y, th, a1, a2, a3) in the world (6,) [m, rad]."""
    x, y = in_world(position.z2, position.z3, sincos(position.z1))
    return x, y, position.z1, position.a1, position.a2, position.a3


def in_platform(x: Any, y: Any, turn: tuple[Any, Any]) -> tuple[Any, Any]:
    """A world position (x, y) [m] along a platform's lateral and forward axes; scalars, or arrays of one shape (...).

    Args:
        x: component along the world's first axis.
        y: component along the second.
        turn: sine and cosine of the platform's angle th.
    """
    s, c = turn
    return x * c + y * s, -x * s + y * c


def in_world(lateral: Any, forward: Any, turn: tuple[Any, Any]) -> tuple[Any, Any]:
    """Inverse of ``in_platform``: (x, y) [m] from what lies along the platform's axes, arrays (...) or scalars."""
    s, c = turn
    return lateral * c - forward * s, lateral * s + forward * c


def chained_rates(position: Position, u1: Scalar, u2: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """(8) at n_v = 3: rates of z1, z2, z3 [rad/s, m/s, m/s]."""
    return u1, u1 * position.z3, u2


def position_rates(position: AnyPosition, u: Vector) -> AnyPosition:
    """(8) and the arm: rates of a robot's coordinates from its velocities u (5,)."""
    if isinstance(position, LongPosition):
        return LongPosition(u[0], u[0] * position.z3, u[0] * position.z4, u[1], *u[PLATFORM:])
    return Position(*chained_rates(position, u[0], u[1]), *u[PLATFORM:])


def arm_moved(position: AnyPosition, change: Vector) -> AnyPosition:
    """A position (or its rates) with the arm's entries of ``change`` (5,) added to its joints."""
    return type(position)(*position[:-ARM_JOINTS], *plus(arm_of(position), change[PLATFORM:]))


def posture(geometry: Geometry, position: AnyPosition) -> Posture:
    """Trigonometry of the arm, evaluated once and shared by everything below."""
    s1, c1 = sincos(position.a1)
    sA, cA = sincos(position.a2)
    sB, cB = sincos(position.a2 + position.a3)
    reach = 2.0 * (geometry.l2 * cA + geometry.l3 * cB)
    height = 2.0 * (geometry.l1 + geometry.l2 * sA + geometry.l3 * sB)
    return Posture(s1, c1, sA, cA, sB, cB, reach, height)


def body_map(geometry: Geometry, position: AnyPosition) -> Matrix:
    """T(z2) (5 x 5) with body rates = T u: T2 of (7) and the absolute angles in one matrix."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return two_axles.body_map(geometry.front, position)
    return Matrix([[position.z2, 1, 0, 0, 0], [1, 0, 0, 0, 0], [1, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 1, 1]])


def body_map_rate(geometry: Geometry, position: AnyPosition, u: Vector) -> Vector:
    """Tdot u (5,): only V = u2 + z2 u1 has a coefficient that moves, z2dot = u1 z3."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return two_axles.body_map_rate(geometry.front, position, u)
    return (u[0] * u[0] * position.z3, 0, 0, 0, 0)


def actuator_force(geometry: Geometry, position: AnyPosition, torque: Vector) -> Vector:
    """B_i2 tau of (9): generalised force in u of (right wheel, left wheel, joint 1, 2, 3) torques [N m]."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return two_axles.actuator_force(geometry.front, geometry.r, position, torque)
    right, left, *joints = torque
    forward = (right + left) / geometry.r
    turning = (right - left) * geometry.l / geometry.r
    return (turning + position.z2 * forward, forward, *joints)


def actuator_torque(geometry: Geometry, position: AnyPosition, force: Vector) -> Vector:
    """Inverse of ``actuator_force``: the five torques [N m] that exert a generalised force in u."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return two_axles.actuator_torque(geometry.front, geometry.r, position, force)
    turning, forward, *joints = force
    turning = turning - position.z2 * forward
    common, difference = 0.5 * geometry.r * forward, 0.5 * geometry.r * turning / geometry.l
    return (common + difference, common - difference, *joints)


def actuator_rates(geometry: Geometry, position: AnyPosition, u: Vector) -> Vector:
    """Rates of the two wheels and three joints [rad/s]: B^T u, so that torque times rate is power."""
    if geometry.front is not None and isinstance(position, LongPosition):
        return two_axles.actuator_rates(geometry.front, geometry.r, position, u)
    forward, turning = u[1] + position.z2 * u[0], u[0] * geometry.l
    return ((forward + turning) / geometry.r, (forward - turning) / geometry.r, *u[2:])


def arm_angles(geometry: Geometry, reach: Scalar, rise: Scalar, elbow: Scalar) -> tuple[Scalar, Scalar]:
    """Pitch joints (a2, a3) [rad] that put the tip at ``reach`` along e and ``rise`` above the column [m].

    Args:
        elbow: any number with the wanted sign of a3.
    """
    A, B = 2.0 * geometry.l2, 2.0 * geometry.l3
    cosine = (reach**2 + rise**2 - A**2 - B**2) / (2.0 * A * B)
    # Out of reach the arm is stretched; the rollout then says so, as the constraint cannot be met.
    a3 = jnp.copysign(jnp.arccos(jnp.clip(cosine, -1.0, 1.0)), elbow)
    a2 = jnp.arctan2(rise, reach) - jnp.arctan2(B * jnp.sin(a3), A + B * jnp.cos(a3))
    return a2, a3


def tip_rows(geometry: Geometry, arm: Posture) -> tuple[Vector, Vector, Vector]:
    """Jacobian rows (5,) of the tip's velocity along e, n and up, in body rates."""
    b, s1, c1 = geometry.mount_offset, arm.s1, arm.c1
    A, B = 2.0 * geometry.l2, 2.0 * geometry.l3
    along = (c1, b * s1, 0, -A * arm.sA, -B * arm.sB)
    across = (-s1, b * c1, arm.reach, 0, 0)
    return along, across, (0, 0, 0, A * arm.cA, B * arm.cB)


def tip_position(geometry: Geometry, position: Position, arm: Posture) -> tuple[Scalar, Scalar]:
    """Horizontal position of the tip from the world's origin, along the arm's own axes e and n [m]."""
    forward = position.z3 + geometry.mount_offset
    along = -arm.s1 * position.z2 + arm.c1 * forward + arm.reach
    return along, -arm.c1 * position.z2 - arm.s1 * forward


def tip_in_platform(geometry: Geometry, position: Position, arm: Posture) -> Vector:
    """Tip along the platform's lateral and forward axes from the world's origin, and its height [m]."""
    lateral = position.z2 - arm.reach * arm.s1
    return lateral, position.z3 + geometry.mount_offset + arm.reach * arm.c1, arm.height


def tip_bias(geometry: Geometry, arm: Posture, rates: Vector, T_rate: Vector) -> Vector:
    """Acceleration of the tip along e, n and up when udot = 0 [m/s^2]."""
    b = geometry.mount_offset
    V, w, W, A, B = rates
    A2, B2 = 2.0 * geometry.l2 * A * A, 2.0 * geometry.l3 * B * B
    reach_rate = -2.0 * (geometry.l2 * arm.sA * A + geometry.l3 * arm.sB * B)
    lateral, forward = -w * V, T_rate[0] - b * w * w
    along = -arm.s1 * lateral + arm.c1 * forward - arm.cA * A2 - arm.cB * B2 - W * W * arm.reach
    across = -arm.c1 * lateral - arm.s1 * forward + 2.0 * W * reach_rate
    return along, across, -(arm.sA * A2 + arm.sB * B2)
