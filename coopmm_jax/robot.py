"""One mobile manipulator: chained form (6)-(8), inertia matrix and bias forces (5), (9).

Positions are kept in the chained coordinates z1 = th, z2 = x cos th + y sin th, z3 = -x sin th + y cos th, which are
the platform's angle and its world position seen from its own axes (lateral, forward): no trigonometry of th is needed
until two robots meet. Inertia is written in *body rates*, w = (V, w, W, Adot, Bdot): forward speed, platform yaw rate,
arm yaw rate, absolute pitch rates of both links. There the matrix is sparsest, and w = T(z2) u leads to the coordinates
u = (u1, u2, a1dot, a2dot, a3dot) of (9).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.components import Matrix, Scalar, Vector, plus, sincos
from coopmm_jax.parameters import Geometry, Inertia, Pose


class Position(NamedTuple):
    """Chained coordinates [rad, m, m] and joint angles [rad] of one robot; also used for their rates."""

    z1: Scalar
    z2: Scalar
    z3: Scalar
    a1: Scalar
    a2: Scalar
    a3: Scalar


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


class Lumped(NamedTuple):
    """The combinations of masses and inertias that enter the equations, in which they are linear.

    First and second moments are those of the point masses (rods' centres, object) at p cos A + q cos B along e.
    """

    platform: Scalar  # translating mass with the wheels' spin [kg]
    yaw: Scalar  # about the axle midpoint, arm's base on its mount included [kg m^2]
    platform_moment: Scalar  # m_p d + (m1 + arm) mount_offset [kg m]
    column: Scalar  # I1
    I2: Scalar
    I3: Scalar
    Sp: Scalar  # sum m p [kg m]
    Sq: Scalar
    Spp: Scalar  # sum m p^2 [kg m^2]
    Spq: Scalar
    Sqq: Scalar


def chained(pose: Pose) -> Position:
    """(6): chained coordinates of a pose (x, y, th, a1, a2, a3)."""
    s, c = sincos(pose.th)
    return Position(pose.th, pose.x * c + pose.y * s, -pose.x * s + pose.y * c, pose.a1, pose.a2, pose.a3)


def unchained(position: Position) -> Pose:
    """Inverse of ``chained``."""
    s, c = sincos(position.z1)
    z2, z3 = position.z2, position.z3
    return Pose(z2 * c - z3 * s, z2 * s + z3 * c, position.z1, position.a1, position.a2, position.a3)


def posture(geometry: Geometry, position: Position) -> Posture:
    """Trigonometry of the arm, evaluated once and shared by everything below."""
    s1, c1 = sincos(position.a1)
    sA, cA = sincos(position.a2)
    sB, cB = sincos(position.a2 + position.a3)
    reach = 2.0 * (geometry.l2 * cA + geometry.l3 * cB)
    height = 2.0 * (geometry.l1 + geometry.l2 * sA + geometry.l3 * sB)
    return Posture(s1, c1, sA, cA, sB, cB, reach, height)


def lump(geometry: Geometry, inertia: Inertia) -> Lumped:
    """Lumped parameters of one robot (masses [kg], inertias [kg m^2], lengths [m])."""
    g, i = geometry, inertia
    arm = i.m2 + i.m3 + i.m_obj
    on_mount = i.m1 + arm
    return Lumped(
        platform=i.m_p + on_mount + 2.0 * i.I_w / g.r**2,
        yaw=i.m_p * g.d**2 + i.I_p + 2.0 * i.I_w * (g.l / g.r) ** 2 + on_mount * g.mount_offset**2,
        platform_moment=i.m_p * g.d + on_mount * g.mount_offset,
        column=i.I1,
        I2=i.I2,
        I3=i.I3,
        Sp=g.l2 * (i.m2 + 2.0 * (i.m3 + i.m_obj)),
        Sq=g.l3 * (i.m3 + 2.0 * i.m_obj),
        Spp=g.l2**2 * (i.m2 + 4.0 * (i.m3 + i.m_obj)),
        Spq=g.l2 * g.l3 * (2.0 * i.m3 + 4.0 * i.m_obj),
        Sqq=g.l3**2 * (i.m3 + 4.0 * i.m_obj),
    )


def body_inertia(lumped: Lumped, geometry: Geometry, arm: Posture) -> Matrix:
    """Inertia matrix in body rates (V, w, W, Adot, Bdot); symmetric positive definite."""
    m, b = lumped, geometry.mount_offset
    first = m.Sp * arm.cA + m.Sq * arm.cB  # sum m rho: first moment of the arm along e
    second = m.Spp * arm.cA**2 + 2.0 * m.Spq * arm.cA * arm.cB + m.Sqq * arm.cB**2
    W = m.column + m.I2 * arm.cA**2 + m.I3 * arm.cB**2 + second
    pA, qB = m.Sp * arm.sA, m.Sq * arm.sB
    AB = m.Spq * (arm.cA * arm.cB + arm.sA * arm.sB)
    VW, VA, VB = -arm.s1 * first, -arm.c1 * pA, -arm.c1 * qB
    bs, bc = b * arm.s1, b * arm.c1
    wW, wA, wB = bc * first, -bs * pA, -bs * qB
    return Matrix(
        [
            [m.platform, 0, VW, VA, VB],
            [0, m.yaw, wW, wA, wB],
            [VW, wW, W, 0, 0],
            [VA, wA, 0, m.Spp + m.I2, AB],
            [VB, wB, 0, AB, m.Sqq + m.I3],
        ]
    )


def body_bias(lumped: Lumped, geometry: Geometry, gravity: Scalar, arm: Posture, rates: Vector) -> Vector:
    """Coriolis, centrifugal and gravity forces in body rates, by Kane's partial velocities.

    Each point mass contributes (partial velocity) . (acceleration with constant body rates); rates = (V, w, W, Adot,
    Bdot). ``base_e, base_n`` is the mount's acceleration in the arm's frame (e, n).
    """
    m, b = lumped, geometry.mount_offset
    V, w, W, A, B = rates
    s1, c1, sA, cA, sB, cB = arm[:6]
    first = m.Sp * cA + m.Sq * cB
    along_A, along_B = m.Spp * cA + m.Spq * cB, m.Spq * cA + m.Sqq * cB
    sway = m.Sp * sA * A + m.Sq * sB * B  # -(d/dt) sum m rho
    radial = -(m.Sp * cA * A * A + m.Sq * cB * B * B) - W * W * first  # sum m (acceleration along e)
    coriolis = -2.0 * W * sway  # sum m (acceleration along n)
    base_e = w * (V * s1 - b * w * c1)
    base_n = w * (V * c1 + b * w * s1)
    turn_A, turn_B = sA * (along_A + m.I2 * cA), sB * (along_B + m.I3 * cB)
    cross = m.Spq * (sA * cB - cA * sB)
    return (
        c1 * radial - s1 * coriolis - m.platform_moment * w * w,
        m.platform_moment * w * V + b * (s1 * radial + c1 * coriolis),
        first * base_n - 2.0 * W * (turn_A * A + turn_B * B),
        m.Sp * (gravity * cA - sA * base_e) + cross * B * B + turn_A * W * W,
        m.Sq * (gravity * cB - sB * base_e) - cross * A * A + turn_B * W * W,
    )


def body_map(position: Position) -> Matrix:
    """T(z2) (5 x 5) with body rates = T u: T2 of (7) and the absolute angles in one matrix."""
    return Matrix([[position.z2, 1, 0, 0, 0], [1, 0, 0, 0, 0], [1, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 1, 1]])


def body_map_rate(position: Position, u: Vector) -> Vector:
    """Tdot u (5,): only V = u2 + z2 u1 has a coefficient that moves, z2dot = u1 z3."""
    return (u[0] * u[0] * position.z3, 0, 0, 0, 0)


class Dynamics(NamedTuple):
    """(9) of one robot at one state, in body rates: M w' + bias with w' = T udot."""

    inertia: Matrix
    bias: Vector  # Coriolis, centrifugal, gravity, and M Tdot u


def dynamics(
    lumped: Lumped, geometry: Geometry, gravity: Scalar, position: Position, arm: Posture, T: Matrix, velocity: Vector
) -> Dynamics:
    """Inertia and bias of one robot moving at ``velocity`` u (5,)."""
    inertia = body_inertia(lumped, geometry, arm)
    bias = body_bias(lumped, geometry, gravity, arm, T @ velocity)
    return Dynamics(inertia, plus(inertia @ body_map_rate(position, velocity), bias))


def inverse_dynamics(d: Dynamics, T: Matrix, acceleration: Vector) -> Vector:
    """Generalised force M_i2 udot + C_i2 u + G_i2 of (9) in u (5,) [N m, N, N m, N m, N m]."""
    return T.T @ plus(d.inertia @ (T @ acceleration), d.bias)


def actuator_force(geometry: Geometry, position: Position, torque: Vector) -> Vector:
    """B_i2 tau of (9): generalised force in u of (right wheel, left wheel, joint 1, 2, 3) torques [N m]."""
    right, left, *joints = torque
    forward = (right + left) / geometry.r
    turning = (right - left) * geometry.l / geometry.r
    return (turning + position.z2 * forward, forward, *joints)


def actuator_torque(geometry: Geometry, position: Position, force: Vector) -> Vector:
    """Inverse of ``actuator_force``: the five torques [N m] that exert a generalised force in u."""
    turning, forward, *joints = force
    turning = turning - position.z2 * forward
    common, difference = 0.5 * geometry.r * forward, 0.5 * geometry.r * turning / geometry.l
    return (common + difference, common - difference, *joints)


def actuator_rates(geometry: Geometry, position: Position, u: Vector) -> Vector:
    """Rates of the two wheels and three joints [rad/s]: B^T u, so that torque times rate is power."""
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
