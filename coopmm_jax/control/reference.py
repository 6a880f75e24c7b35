"""Desired motion and force, with the derivatives that (12) and (13) ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.path_motion import Aim, Known, aim_at, moving
from coopmm_jax.control.polar_motion import PolarAim
from coopmm_jax.kinds.courses import current
from coopmm_jax.kinds.paths import is_closed
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.surfaces import shape_of
from coopmm_jax.parameters import LogPolar, PathReference, Reference, Surface


class LongDesired(NamedTuple):
    """Desired motion of a platform on two axles at one time, in its own chart, lengths in its own unit."""

    zeta: Vector  # z1, ..., z4 (4,)
    u1: Vector  # u_d1 and its first two derivatives (3,)
    u2: Scalar  # [1/s]


class Desired(NamedTuple):
    """Desired motion of one robot at one time: coordinates of (6), inputs, independent arm joints."""

    z1: Scalar  # [rad]
    z2: Scalar  # [m]
    z3: Scalar
    u1: Scalar  # [rad/s]
    u2: Scalar  # [m/s]
    u1_rate: Scalar  # [rad/s^2]
    arm: Vector  # [rad]
    arm_rate: Vector  # [rad/s]
    long: LongDesired | None = None  # of a platform on two axles


AnyReference = Reference | PathReference | Known


def at_instant(reference: AnyReference, t: Scalar, aim: Aim | None = None) -> Reference | Known:
    """The reference as whatever is asked of it at t [s] should use it: a path is then evaluated once.

    Args:
        reference: of the rollout.
        t: time [s].
        aim: of a path at that time, where it is known already.
    """
    if not isinstance(reference, PathReference):
        return reference
    return Known(reference, aim_at(reference, t) if aim is None else aim, t)


def phase(reference: AnyReference, t: Scalar) -> Scalar:
    """Phase at t [s]: of a path's point, of circles the desired yaw of both platforms [rad]."""
    if isinstance(reference, Reference):
        return reference.rate * t
    return _path(reference).timing.phase(t)


def repeats(reference: AnyReference) -> bool:
    """True if the desired place is the same when the phase has gone on by 2 pi."""
    return isinstance(reference, Reference) or is_closed(_path(reference).path)


def _path(reference: PathReference | Known) -> PathReference:
    return reference.reference if isinstance(reference, Known) else reference


def desired_motion(reference: AnyReference, t: Scalar) -> Pair[Desired]:
    """Desired motion of both robots at t [s].

    >>> desired_motion(Reference(rate=2.0), 0.0)[0].u1
    2.0
    """
    now = at_instant(reference, t)
    return _circles(now, t) if isinstance(now, Reference) else _beside_the_path(now, t)


def _circles(reference: Reference, t: Scalar) -> Pair[Desired]:
    """Both robots drive circles of radius z_d2 at a constant rate, as in section IV; arm yaw swings about its centre.

    The chained form (6) of a circle about the origin is z_d = (rate t, radius, 0), u_d = (rate, 0).
    """
    s, c = sincos(reference.arm_rate * t)

    def circle(radius: Scalar, centre: Scalar, swing: Scalar, unit: Any) -> Desired:
        angle, speed = centre - swing * c, swing * reference.arm_rate * s
        turn, rate = reference.rate * t, reference.rate
        long = None
        if unit is not None:
            z2 = jnp.log(radius) if isinstance(unit, LogPolar) else radius / unit
            long = LongDesired((turn, z2, 0.0, 0.0), (rate, 0.0, 0.0), 0.0)
        return Desired(turn, radius, 0.0, rate, 0.0, 0.0, (angle,), (speed,), long)

    return per_robot(circle, reference.radius, reference.arm_centre, reference.arm_swing, reference.unit)


def _beside_the_path(known: Known, t: Scalar) -> Pair[Desired]:
    """Motion along a path at the instant t [s] at which it is known; its first derivatives by t are right too."""
    aim = known.aim

    def at(value: Scalar, rate: Scalar) -> Scalar:
        return moving(value, rate, t, known.t)

    heading, turn = at(aim.heading, aim.turn.value), at(aim.turn.value, aim.turn.rate)
    turn_rate, advance = at(aim.turn.rate, aim.turn.acceleration), at(aim.advance, aim.advance_rate)
    across, ahead = at(aim.across, aim.turn.value * aim.ahead), at(aim.ahead, aim.advance)
    yaw, yaw_rate = at(aim.yaw.value, aim.yaw.rate), at(aim.yaw.rate, aim.yaw.acceleration)
    arms = ((yaw,), (yaw_rate,)), ((0.5 * math.pi,), (0.0,))

    def beside(offset: Scalar, unit: Any, arm: tuple[Vector, Vector], polar: PolarAim | None) -> Desired:
        desired = Desired(heading, across + offset, ahead, turn, advance, turn_rate, *arm)
        if polar is not None:
            return desired._replace(long=_polar(polar, at))
        if unit is None or aim.long is None:
            return desired
        z4, advance_4 = at(aim.long.z4.value, aim.long.z4.rate), at(aim.long.z4.rate, aim.long.z4.acceleration)
        zeta = (heading, desired.z2 / unit, ahead / unit, z4 / unit)
        rates = (turn, turn_rate, at(aim.turn.acceleration, aim.long.turn_jerk))
        return desired._replace(long=LongDesired(zeta, rates, advance_4 / unit))

    return per_robot(beside, known.reference.offset, known.reference.unit, arms, aim.polar)


def _polar(aim: PolarAim, at: Callable[[Scalar, Scalar], Scalar]) -> LongDesired:
    """Chained form about the origin; ``at`` gives a value its rate."""
    z1, z2, z3, z4 = aim.zeta
    u1, u2 = aim.turn[0], aim.advance[0]
    zeta = (at(z1, u1), at(z2, u1 * z3), at(z3, u1 * z4), at(z4, u2))
    return LongDesired(zeta, tuple(map(at, aim.turn[:-1], aim.turn[1:])), at(u2, aim.advance[1]))


def desired_force(reference: AnyReference, rows: tuple[str, ...], t: Scalar) -> Vector:
    """lambda_d (m,) [N] at t [s]: the contact presses, every other row idles."""
    force = reference.aim.force if isinstance(reference, Known) else current(reference.contact_force, t)
    return tuple(force if name == "contact_normal" else 0.0 for name in rows)


def desired_object(reference: Reference | Known, surface: Surface, second: Desired) -> tuple[Scalar, Scalar]:
    """Place of the object along platform II's desired axes, lateral and forward [m].

    Args:
        reference: of the rollout, at one instant.
        surface: with the radius of the object's circle.
        second: desired motion of robot II.
    """
    if isinstance(reference, Reference):
        return surface.guide_radius, 0
    return second.z2 - reference.reference.offset[1], second.z3


def desired_contact(reference: Reference | Known, surface: Surface, desired: Pair[Desired]) -> Vector:
    """Place of tip I along arm II and across it (2,), from the centre of the object's arc, else from the object [m].

    Args:
        reference: of the rollout, at one instant.
        surface: of the object.
        desired: motion of both robots.
    """
    radius = surface.contact_radius
    if isinstance(reference, Known):
        along = shape_of(surface).along(reference.aim.contact)
        return along if surface.shape is not None else radius + along, reference.aim.contact
    one, two = desired
    s, c = sincos((one.z1 - two.z1) + (one.arm[0] - two.arm[0]))
    return radius * c, radius * s
