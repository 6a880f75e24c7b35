"""Inertia matrix and bias forces of one mobile manipulator, (5) and (9).

Both are written in body rates, w = (V, w, W, Adot, Bdot), where the inertia matrix is sparsest, and are linear in a few
lumped masses. What does not depend on masses is computed once for the plant and the controller's nominal model.
``link_dynamics`` has arms with other links.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, plus
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.mechanics import link_dynamics, two_axles
from coopmm_jax.mechanics.link_dynamics import LinkFactors, LinkLumped
from coopmm_jax.mechanics.pitch_links import LinkPosture, lifts
from coopmm_jax.mechanics.robot_kinematics import AnyPosture, Posture
from coopmm_jax.mechanics.two_axles import FrontLumped, FrontMotion
from coopmm_jax.parameters import Geometry, Inertia, LinkInertia


class Lumped(NamedTuple):
    """The combinations of masses and inertias that enter the equations, in which they are linear.

    First and second moments are those of the point masses (rods' centres, object) at p cos A + q cos B along e; the
    rods' own moments of inertia come on top of the second ones.
    """

    platform: Scalar  # translating mass with the wheels' spin [kg]
    yaw: Scalar  # about the axle midpoint, arm's base on its mount included [kg m^2]
    platform_moment: Scalar  # m_p d + (m1 + arm) mount_offset [kg m]
    column: Scalar  # I1
    Sp: Scalar  # sum m p [kg m]
    Sq: Scalar
    Jp: Scalar  # I2 + sum m p^2 [kg m^2]
    Spq: Scalar
    Jq: Scalar  # I3 + sum m q^2 [kg m^2]
    front: FrontLumped | None = None  # of a platform on two axles


AnyLumped = Lumped | LinkLumped


def lump(geometry: Geometry, inertia: Inertia) -> AnyLumped:
    """Lumped parameters of one robot (masses [kg], inertias [kg m^2], lengths [m])."""
    g, i = geometry, inertia
    if g.arm is not None and i.links is not None:
        return _lump_links(g, i, i.links)
    arm = i.m2 + i.m3 + i.m_obj
    on_mount = i.m1 + arm
    return Lumped(
        platform=i.m_p + on_mount + 2.0 * i.I_w / g.r**2,
        yaw=i.m_p * g.d**2 + i.I_p + 2.0 * i.I_w * (g.l / g.r) ** 2 + on_mount * g.mount_offset**2,
        platform_moment=i.m_p * g.d + on_mount * g.mount_offset,
        column=i.I1,
        Sp=g.l2 * (i.m2 + 2.0 * (i.m3 + i.m_obj)),
        Sq=g.l3 * (i.m3 + 2.0 * i.m_obj),
        Jp=i.I2 + g.l2**2 * (i.m2 + 4.0 * (i.m3 + i.m_obj)),
        Spq=g.l2 * g.l3 * (2.0 * i.m3 + 4.0 * i.m_obj),
        Jq=i.I3 + g.l3**2 * (i.m3 + 4.0 * i.m_obj),
        front=None if g.front is None or i.front is None else two_axles.front_lumped(g.front, i.front),
    )


def _lump_links(g: Geometry, i: Inertia, links: LinkInertia) -> LinkLumped:
    assert g.arm is not None
    arm = sum(links.m_links, start=i.m_obj)
    on_mount = i.m1 + arm
    S, J = link_dynamics.moments(g.arm.l_links, links, i.m_obj)
    return LinkLumped(
        platform=i.m_p + on_mount + 2.0 * i.I_w / g.r**2,
        yaw=i.m_p * g.d**2 + i.I_p + 2.0 * i.I_w * (g.l / g.r) ** 2 + on_mount * g.mount_offset**2,
        platform_moment=i.m_p * g.d + on_mount * g.mount_offset,
        column=i.I1,
        arm=arm,
        S=S,
        J=J,
        front=None if g.front is None or i.front is None else two_axles.front_lumped(g.front, i.front),
    )


class Factors(NamedTuple):
    """Factors of the masses in one robot's inertia and bias: the same for plant and nominal model."""

    arm: Posture
    cA_cA: Scalar
    cA_cB: Scalar
    cB_cB: Scalar
    sA_cA: Scalar
    sA_cB: Scalar
    sB_cA: Scalar
    sB_cB: Scalar
    cos_elbow: Scalar  # of A - B
    sin_elbow: Scalar
    mount: tuple[Scalar, Scalar]  # of the arm from the axle, along n and e [m]
    rates: Vector  # (V, w, W, Adot, Bdot)
    squares: tuple[Scalar, Scalar, Scalar]  # W^2, Adot^2, Bdot^2
    swing: tuple[Scalar, Scalar]  # 2 W Adot, 2 W Bdot
    base_n: Scalar  # acceleration of the mount across the arm, under constant body rates [m/s^2]
    weight: tuple[Scalar, Scalar]  # force of a unit first moment against pitching A and B [m/s^2]
    inward: tuple[Vector, Vector]  # (V, w): forces on the platform of unit first moments along p and q


AnyFactors = Factors | LinkFactors


def factors(geometry: Geometry, gravity: Scalar, arm: AnyPosture, rates: Vector) -> AnyFactors:
    """``Factors`` at body rates (V, w, W, Adot, Bdot), by Kane's partial velocities.

    Each point mass contributes (partial velocity) . (acceleration with constant body rates), whose parts along the
    arm's axes e and n are ``base`` of the mount, and ``radial`` and ``coriolis`` of the mass relative to it.
    """
    if isinstance(arm, LinkPosture):
        return link_dynamics.factors(geometry, gravity, arm, rates)
    b = geometry.mount_offset
    V, w, W, A, B = rates
    s1, c1, sA, cA, sB, cB = arm[:6]
    bs, bc = b * s1, b * c1
    sA_cB, sB_cA = sA * cB, sB * cA
    WW, AA, BB = W * W, A * A, B * B
    WA, WB = 2.0 * W * A, 2.0 * W * B
    base_e = w * (V * s1 - w * bc)

    def inward(c: Scalar, s: Scalar, square: Scalar, swing: Scalar) -> Vector:
        radial, coriolis = c * (square + WW), s * swing
        return s1 * coriolis - c1 * radial, -(bs * radial + bc * coriolis)

    return Factors(
        arm=arm,
        cA_cA=cA * cA,
        cA_cB=cA * cB,
        cB_cB=cB * cB,
        sA_cA=sA * cA,
        sA_cB=sA_cB,
        sB_cA=sB_cA,
        sB_cB=sB * cB,
        cos_elbow=cA * cB + sA * sB,
        sin_elbow=sA_cB - sB_cA,
        mount=(bs, bc),
        rates=rates,
        squares=(WW, AA, BB),
        swing=(WA, WB),
        base_n=w * (V * c1 + w * bs),
        weight=(gravity * cA - sA * base_e, gravity * cB - sB * base_e),
        inward=(inward(cA, sA, AA, WA), inward(cB, sB, BB, WB)),
    )


def body_inertia(m: AnyLumped, f: AnyFactors) -> Matrix:
    """Inertia matrix (5 x 5) in body rates (V, w, W, Adot, Bdot); symmetric positive definite."""
    if isinstance(m, LinkLumped) and isinstance(f, LinkFactors):
        return link_dynamics.body_inertia(m, f)
    assert isinstance(m, Lumped)
    assert isinstance(f, Factors)
    arm, (bs, bc) = f.arm, f.mount
    first = m.Sp * arm.cA + m.Sq * arm.cB  # sum m rho: first moment of the arm along e
    W = m.column + m.Jp * f.cA_cA + m.Spq * (2.0 * f.cA_cB) + m.Jq * f.cB_cB
    VW, VA, VB = -arm.s1 * first, -m.Sp * (arm.c1 * arm.sA), -m.Sq * (arm.c1 * arm.sB)
    wW, wA, wB = bc * first, -m.Sp * (bs * arm.sA), -m.Sq * (bs * arm.sB)
    AB = m.Spq * f.cos_elbow
    return Matrix(
        [
            [m.platform, 0, VW, VA, VB],
            [0, m.yaw, wW, wA, wB],
            [VW, wW, W, 0, 0],
            [VA, wA, 0, m.Jp, AB],
            [VB, wB, 0, AB, m.Jq],
        ]
    )


def body_bias(m: AnyLumped, f: AnyFactors) -> Vector:
    """Coriolis, centrifugal and gravity forces in body rates (5,) [N, N m, N m, N m, N m]."""
    if isinstance(m, LinkLumped) and isinstance(f, LinkFactors):
        return link_dynamics.body_bias(m, f)
    assert isinstance(m, Lumped)
    assert isinstance(f, Factors)
    V, w = f.rates[:2]
    WW, AA, BB = f.squares
    (VA, wA), (VB, wB) = f.inward
    first = m.Sp * f.arm.cA + m.Sq * f.arm.cB
    turn_A = m.Jp * f.sA_cA + m.Spq * f.sA_cB
    turn_B = m.Spq * f.sB_cA + m.Jq * f.sB_cB
    cross = m.Spq * f.sin_elbow
    return (
        m.Sp * VA + m.Sq * VB - m.platform_moment * (w * w),
        m.Sp * wA + m.Sq * wB + m.platform_moment * (w * V),
        first * f.base_n - turn_A * f.swing[0] - turn_B * f.swing[1],
        m.Sp * f.weight[0] + cross * BB + turn_A * WW,
        m.Sq * f.weight[1] - cross * AA + turn_B * WW,
    )


def gravity_force(m: AnyLumped, gravity: Scalar, arm: AnyPosture, geometry: Geometry) -> Vector:
    """G_i2 of (9) in u (5,): what holds the arm's weight [0, 0, 0, N m, N m]."""
    if isinstance(m, LinkLumped) and isinstance(arm, LinkPosture) and geometry.arm is not None:
        return link_dynamics.gravity_force(m, gravity, arm, lifts(geometry.arm))
    assert isinstance(m, Lumped)
    assert isinstance(arm, Posture)
    A, B = m.Sp * gravity * arm.cA, m.Sq * gravity * arm.cB
    return (0, 0, 0, A + B, B)


class Dynamics(NamedTuple):
    """(9) of one robot at one state, in body rates: M w' + bias with w' = T udot + Tdot u.

    Those of a platform on two axles are seven: its front axle's follow the others.
    """

    inertia: Matrix
    bias: Vector  # Coriolis, centrifugal, gravity
    T: Matrix
    T_rate: Vector  # Tdot u


def dynamics(lumped: AnyLumped, f: AnyFactors, T: Matrix, T_rate: Vector, front: FrontMotion | None = None) -> Dynamics:
    """Inertia and bias of one robot.

    Args:
        lumped: masses, of the plant or of the controller's model.
        f: what goes with them.
        T: body rates from u (5 x 5).
        T_rate: Tdot u (5,).
        front: motion of the front axle, of a platform that has one.
    """
    inertia, bias = body_inertia(lumped, f), body_bias(lumped, f)
    if front is None or lumped.front is None:
        return Dynamics(inertia, bias, T, T_rate)
    ahead = lumped.front
    rows = [(*row, 0, 0) for row in inertia.rows]
    inertia = Matrix([*rows, (*(0,) * len(rows), ahead.mass, 0), (*(0,) * len(rows), 0, ahead.yaw)])
    bias = (*bias, *two_axles.front_bias(ahead, front.rates))
    return Dynamics(inertia, bias, Matrix([*T.rows, *front.map.rows]), (*T_rate, *front.map_rate))


def inverse_dynamics(d: Dynamics, acceleration: Vector) -> Vector:
    """Generalised force M_i2 udot + C_i2 u + G_i2 of (9) in u (5,) [N m, N, N m, N m, N m]."""
    return d.T.T @ plus(d.inertia @ plus(d.T @ acceleration, d.T_rate), d.bias)


def inertial_force(d: Dynamics, acceleration: Vector) -> Vector:
    """The part of ``inverse_dynamics`` (5,) that udot (5,) causes, M_i2 udot."""
    return d.T.T @ (d.inertia @ (d.T @ acceleration))
