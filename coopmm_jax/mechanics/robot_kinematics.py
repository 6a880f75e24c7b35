"""Kinematics of one mobile manipulator: chained form (6)-(8), body rates, actuators, the arm's tip.

Positions are kept in the chained coordinates z1 = th, z2 = x cos th + y sin th, z3 = -x sin th + y cos th, which are
the platform's angle and its world position seen from its own axes (lateral, forward): no trigonometry of th is needed
until two robots meet. Between positions and forces stand the *body rates*, w = (V, w, W, Adot, Bdot): forward speed,
platform yaw rate, arm yaw rate, absolute pitch rates of both links, with w = T(z2) u for the coordinates
u = (u1, u2, a1dot, a2dot, a3dot) of (9). ``pitch_links`` has the arms with other links: where one is described here as
(5,) it has as many entries as the robot has joints.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.matrix import Matrix, add, mul, plus, sub
from coopmm_jax.algebra.sincos import sincos, wrapped
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics import pitch_links, two_axles
from coopmm_jax.mechanics.coordinates import AnyPosition, LongPosition, Position, arm_of, at_place, platform_of
from coopmm_jax.mechanics.pitch_links import LinkPosture
from coopmm_jax.mechanics.robot import PLATFORM, per_robot
from coopmm_jax.parameters import Geometry, Pose


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


AnyPosture = Posture | LinkPosture


def chained(pose: Pose) -> Position:
    """(6): chained coordinates of a pose (x, y, th, a1, a2, a3)."""
    lateral, forward = in_platform(pose.x, pose.y, sincos(pose.th))
    return at_place((pose.th, lateral, forward), (pose.a1, *pose.joints))


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
        return at_place(two_axles.place(geometry.front, position), arm_of(position))
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
        return type(position)(*plus(position, error))
    read = plus(placed(geometry, position), error)
    rho = two_axles.turning_radius(front, two_axles.steering(front, position) + bend)
    return two_axles.lengthened(front, read[:3], rho, read[3:])


def unchained(position: Position) -> Vector:
    """Inverse of ``chained``: (x, y, th, a1, a2, a3) in the world (6,) [m, rad]."""
    x, y = in_world(position.z2, position.z3, sincos(position.z1))
    return x, y, position.z1, *arm_of(position)


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
        return type(position)(u[0], u[0] * position.z3, u[0] * position.z4, u[1], *u[PLATFORM:])
    return type(position)(*chained_rates(position, u[0], u[1]), *u[PLATFORM:])


def arm_moved(position: AnyPosition, change: Vector) -> AnyPosition:
    """A position (or its rates) with the arm's entries of ``change`` (5,) added to its joints."""
    return type(position)(*position[: platform_of(position)], *plus(arm_of(position), change[PLATFORM:]))


def posture(geometry: Geometry, position: AnyPosition) -> AnyPosture:
    """Trigonometry of the arm, evaluated once and shared by everything below."""
    if geometry.arm is not None:
        return pitch_links.posture(geometry.arm, geometry.l1, arm_of(position))
    s1, c1 = sincos(position.a1)
    sA, cA = sincos(position.a2)
    sB, cB = sincos(position.a2 + position.a3)
    reach = 2.0 * (geometry.l2 * cA + geometry.l3 * cB)
    height = 2.0 * (geometry.l1 + geometry.l2 * sA + geometry.l3 * sB)
    return Posture(s1, c1, sA, cA, sB, cB, reach, height)


def body_map(geometry: Geometry, position: AnyPosition) -> Matrix:
    """T(z2) (5 x 5) with body rates = T u: T2 of (7) and the absolute angles in one matrix."""
    if geometry.front is not None and isinstance(position, LongPosition):
        V, w = two_axles.platform_map(geometry.front, position)
    else:
        V, w = (position.z2, 1), (1, 0)
    arm = ((1, 0), (1, 1)) if geometry.arm is None else pitch_links.rates_map(geometry.arm)
    none = (0,) * len(arm)
    return Matrix([(*V, 0, *none), (*w, 0, *none), (*w, 1, *none), *((0, 0, 0, *row) for row in arm)])


def body_map_rate(geometry: Geometry, position: AnyPosition, u: Vector) -> Vector:
    """Tdot u (5,): only V = u2 + z2 u1 has a coefficient that moves, z2dot = u1 z3."""
    if geometry.front is not None and isinstance(position, LongPosition):
        V, w = two_axles.platform_map_rate(geometry.front, position, u)
    else:
        V, w = u[0] * u[0] * position.z3, 0
    return (V, w, w, *(0,) * (len(u) - 3))


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


def arm_joints(geometry: Geometry, reach: Scalar, rise: Scalar, near: Vector) -> Vector:
    """Joints of the arm after its yaw (k,) that put the tip at ``reach`` along e and ``rise`` above the column [m].

    Args:
        geometry: of the robot.
        reach: of the tip [m].
        rise: likewise [m].
        near: joints (k,) that tell the side of the elbow, and where those stay that are not needed for it.
    """
    if geometry.arm is not None:
        return pitch_links.joints_at(geometry.arm, reach, rise, near)
    return pitch_links.two_angles((geometry.l2, geometry.l3), reach, rise, wrapped(near[1]))


def tip_rows(geometry: Geometry, arm: AnyPosture) -> tuple[Vector, Vector, Vector]:
    """Jacobian rows (5,) of the tip's velocity along e, n and up, in body rates."""
    if isinstance(arm, LinkPosture):
        return pitch_links.tip_rows(geometry, arm)
    b, s1, c1 = geometry.mount_offset, arm.s1, arm.c1
    A, B = 2.0 * geometry.l2, 2.0 * geometry.l3
    along = (c1, b * s1, 0, -A * arm.sA, -B * arm.sB)
    across = (-s1, b * c1, arm.reach, 0, 0)
    return along, across, (0, 0, 0, A * arm.cA, B * arm.cB)


def tip_position(geometry: Geometry, position: Position, arm: AnyPosture) -> tuple[Scalar, Scalar]:
    """Horizontal position of the tip from the world's origin, along the arm's own axes e and n [m]."""
    forward = position.z3 + geometry.mount_offset
    along = -arm.s1 * position.z2 + arm.c1 * forward + arm.reach
    return along, -arm.c1 * position.z2 - arm.s1 * forward


def tip_in_platform(geometry: Geometry, position: Position, arm: AnyPosture) -> Vector:
    """Tip along the platform's lateral and forward axes from the world's origin, and its height [m]."""
    lateral = position.z2 - arm.reach * arm.s1
    return lateral, position.z3 + geometry.mount_offset + arm.reach * arm.c1, arm.height


def tip_bias(geometry: Geometry, arm: AnyPosture, rates: Vector, T_rate: Vector) -> Vector:
    """Acceleration of the tip along e, n and up when udot = 0 [m/s^2]."""
    b = geometry.mount_offset
    V, w, W = rates[:3]
    lateral, forward = sub(-w * V, mul(b, T_rate[1])), T_rate[0] - b * w * w
    if isinstance(arm, LinkPosture):
        inward, reach_rate, up = pitch_links.tip_bias(geometry, arm, rates)
    else:
        A, B = rates[3:]
        A2, B2 = 2.0 * geometry.l2 * A * A, 2.0 * geometry.l3 * B * B
        inward, up = (arm.cA * A2, arm.cB * B2), -(arm.sA * A2 + arm.sB * B2)
        reach_rate = -2.0 * (geometry.l2 * arm.sA * A + geometry.l3 * arm.sB * B)
    along = -arm.s1 * lateral + arm.c1 * forward
    for x in inward:
        along = along - x
    across = -arm.c1 * lateral - arm.s1 * forward + 2.0 * W * reach_rate
    return along - W * W * arm.reach, add(across, mul(arm.reach, T_rate[2])), up
