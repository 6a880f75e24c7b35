"""Kinematic control of one robot in chained form, (12)-(15) at n_v = 3; ``chain`` has them for any n_v.

With e = zeta - zeta_d the backstepping errors are s1 = e1, s2 = e2, s3 = e3 + k2 s2 u_d1; the reference velocities
z = (z_b1, z_b2, z_a) would drive them to zero if u followed z exactly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.sincos import wrapped
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.control import chain
from coopmm_jax.control.chain import Chain
from coopmm_jax.control.reference import Desired
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.mechanics.coordinates import AnyPosition, LongPosition, Position


class Errors(NamedTuple):
    """Tracking errors e2, e3 and backstepping errors s1, s2, s3 of (14)."""

    e2: Scalar
    e3: Scalar
    s1: Scalar
    s2: Scalar
    s3: Scalar


def backstepping_errors(gains: Gains, desired: Desired, position: Position) -> Errors:
    """(14), the heading's modulo a turn. At n_v = 3 there is no s_(n-2) term in s3: (26) decides."""
    e2, e3 = position.z2 - desired.z2, position.z3 - desired.z3
    return Errors(e2, e3, wrapped(position.z1 - desired.z1), e2, e3 + gains.k2 * e2 * desired.u1)


def _long(gains: Any, desired: Desired, position: LongPosition) -> tuple[Vector, Chain]:
    """Gains (4,) and chain of a platform on two axles."""
    zeta, long = position[:4], desired.long
    assert long is not None
    e = tuple(x - y for x, y in zip(zeta, long.zeta, strict=True))
    return (gains.k1, gains.k2, gains.k3, gains.k4), Chain(zeta, (wrapped(e[0]), *e[1:]), long.u1, long.u2)


def coupling_signal(gains: Gains, desired: Desired, position: AnyPosition) -> tuple[Scalar, Scalar]:
    """Lambda_i's non-zero entries (2,), defined below (30): how velocity errors of the platform enter Vdot_1."""
    if isinstance(position, LongPosition):
        return chain.signal(*_long(gains, desired, position))
    s = backstepping_errors(gains, desired, position)
    return gains.k1 * s.s1 + s.s2 * position.z3 + gains.k2 * desired.u1 * s.s3 * position.z3, s.s3


def eta_rate(gains: Gains, desired: Desired, position: AnyPosition, eta: Scalar) -> Scalar:
    """(15), which is (28): eta_dot = -k0 eta - Lambda_1 [rad/s^2]."""
    return -gains.k0 * eta - coupling_signal(gains, desired, position)[0]


def stored(gains: Gains, desired: Desired, position: AnyPosition) -> Scalar:
    """Share of one robot in V1 of (31), without that of eta; a scalar."""
    if isinstance(position, LongPosition):
        return chain.stored(*_long(gains, desired, position))
    s = backstepping_errors(gains, desired, position)
    return 0.5 * (gains.k1 * s.s1 * s.s1 + s.s2 * s.s2 + s.s3 * s.s3)


def decay(gains: Gains, desired: Desired, position: AnyPosition) -> Scalar:
    """Share of one robot in the decaying terms of (32), a scalar counted positive, without that of eta."""
    if isinstance(position, LongPosition):
        return chain.decay(*_long(gains, desired, position))
    s = backstepping_errors(gains, desired, position)
    return gains.k2 * (s.s2 * desired.u1) ** 2 + gains.k3 * s.s3 * s.s3


def reference_velocity(gains: Gains, desired: Desired, position: AnyPosition, arm: Vector, eta: Scalar) -> Vector:
    """z = (z_b1, z_b2, z_a) of (12) and (13) [rad/s, m/s, rad/s].

    Args:
        gains: of the controller.
        desired: motion of this robot.
        position: its coordinates.
        arm: the independent arm joints [rad], as many as ``desired.arm`` has.
        eta: of (15) [rad/s].
    """
    z_a = (
        rate - gains.K_a * wrapped(joint - target)
        for joint, target, rate in zip(arm, desired.arm, desired.arm_rate, strict=True)
    )
    return (*_platform_velocity(gains, desired, position, eta), *z_a)


def _platform_velocity(gains: Gains, desired: Desired, position: AnyPosition, eta: Scalar) -> tuple[Scalar, Scalar]:
    """z_b (2,) of (12)."""
    if isinstance(position, LongPosition):
        return chain.platform_velocity(*_long(gains, desired, position), eta)
    s, u_d1 = backstepping_errors(gains, desired, position), desired.u1
    z_b2 = desired.u2 - s.s2 * u_d1 - gains.k3 * s.s3 - gains.k2 * (u_d1**2 * s.e3 + desired.u1_rate * s.e2)
    return u_d1 + eta, z_b2
