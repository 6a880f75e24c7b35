"""Motion along a path as both robots should carry it out: headings, inputs and arm yaw with their derivatives.

Both platforms run beside the object's path r(p(t)), at a constant offset to its right, and have its heading: then
z_d = (th, lateral . r + offset, forward . r) meets (8) with u_d = (dth/dt, dz_d3/dt), standstill and reversal
included. Robot II reaches straight across the path; robot I to the desired contact point on the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.angle import angle_of
from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.matrix import dot
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.polar_motion import PolarAim, polar_aim
from coopmm_jax.kinds.courses import current, is_course, value_and_rates
from coopmm_jax.kinds.paths import Frame, bent_frame, frame_of, heading
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.surfaces import shape_of
from coopmm_jax.parameters import LogPolar, PathReference


class OverTime(NamedTuple):
    """A scalar at one instant, and its first two time derivatives."""

    value: Scalar
    rate: Scalar
    acceleration: Scalar

    def at(self, t: Scalar, now: Scalar) -> Scalar:
        """Value at t [s], which is ``now``, the instant; its first two derivatives by t are rate and acceleration."""
        return moving(self.value, moving(self.rate, self.acceleration, t, now), t, now)


class LongAim(NamedTuple):
    """Further derivatives that platforms on two axles need."""

    z4: OverTime  # of either platform [m]
    turn_jerk: Scalar  # third derivative of u_d1 [rad/s^4]


class Aim(NamedTuple):
    """A ``PathReference`` at one instant: everything of it that depends on time."""

    heading: Scalar  # th of path and platforms, within half a turn [rad]
    across: Scalar  # lateral . r [m]
    ahead: Scalar  # forward . r [m]
    turn: OverTime  # u_d1 [rad/s]
    advance: Scalar  # u_d2 [m/s]
    advance_rate: Scalar  # [m/s^2]
    yaw: OverTime  # a1_d of robot I [rad]
    reach: OverTime  # of arm I [m]
    contact: Scalar  # n_d [m]
    force: Scalar  # lambda_d of the contact normal [N]
    long: LongAim | None = None  # of platforms on two axles
    polar: Pair[PolarAim | None] = (None, None)  # of those whose chart is polar


class Known(NamedTuple):
    """A ``PathReference`` and its ``Aim`` at t [s]; stands for it then."""

    reference: PathReference
    aim: Aim
    t: Scalar


@jax.custom_jvp
def moving(value: Scalar, rate: Scalar, t: Scalar, now: Scalar) -> Scalar:
    """value + rate (t - now) of scalars where t is ``now``: the value itself, whose derivative by t is the rate.

    >>> jax.jvp(lambda t: moving(2.0, 3.0, t, 0.5), (0.5,), (1.0,))[1].item()
    3.0
    """
    del rate, t, now
    return value


@moving.defjvp
def _moving_jvp(primals: tuple, tangents: tuple) -> tuple:
    (value, rate, t, now), (value_rate, _, t_rate, now_rate) = primals, tangents
    return moving(value, rate, t, now), value_rate + rate * (t_rate - now_rate)


def aim_at(reference: PathReference, t: Scalar) -> Aim:
    """Aim at t [s].

    Path, timing and surface are differentiated one by one and the rest is written out: nested derivatives of the whole
    take twice as many operations.
    """
    phase, *rates = derivatives(reference.timing.phase, t, 3)
    point, *slopes = derivatives(reference.path.point, phase, 4)
    at, turn = frame_of(point, slopes[0]), _turn(slopes, rates)
    across, ahead = dot(at.lateral, point), dot(at.forward, point)
    speed, speed_rate = _speed(at, slopes[1], rates)
    contact = _over_time(reference.contact, t)
    advance = speed - turn.value * across
    yaw, reach = _arm_over_time(reference, contact)
    return Aim(
        heading=heading(at),
        across=across,
        ahead=ahead,
        turn=turn,
        advance=advance,
        advance_rate=speed_rate - turn.rate * across - turn.value * turn.value * ahead,
        yaw=yaw,
        reach=reach,
        contact=contact.value,
        force=current(reference.contact_force, t) + 0.0 * t,
        long=_long_aim(reference, t, turn, ahead, speed - turn.value * across, across)
        if any(unit is not None and not isinstance(unit, LogPolar) for unit in reference.unit)
        else None,
        polar=per_robot(
            lambda unit, offset: (
                polar_aim(reference.path, reference.timing, offset, t) if isinstance(unit, LogPolar) else None
            ),
            reference.unit,
            reference.offset,
        ),
    )


def _long_aim(
    reference: PathReference, t: Scalar, turn: OverTime, ahead: Scalar, advance: Scalar, across: Scalar
) -> LongAim:
    """z4 = rho - z2 is 1/curvature less lateral . r, beside the path at any offset."""

    def radius(t: Scalar) -> Scalar:
        return 1.0 / bent_frame(reference.path, reference.timing.phase(t))[1]

    def turn_acceleration(t: Scalar) -> Scalar:
        phase, *rates = derivatives(reference.timing.phase, t, 3)
        return _turn(derivatives(reference.path.point, phase, 4)[1:], rates).acceleration

    rho, rho_rate, rho_acceleration = derivatives(radius, t, 2)
    z4 = OverTime(
        rho - across,
        rho_rate - turn.value * ahead,
        rho_acceleration - turn.rate * ahead - turn.value * advance,
    )
    return LongAim(z4, derivatives(turn_acceleration, t, 1)[1])


def _turn(slopes: Sequence[Vector], rates: Sequence[Scalar]) -> OverTime:
    """u_d1, from the first four derivatives (2,) of a path by its phase, and the first three of the phase by time.

    dth/dp = (r' x r'')/|r'|^2.
    """
    (a, b, c, d), (p1, p2, p3) = slopes, rates
    size, size_1, size_2 = dot(a, a), 2.0 * dot(a, b), 2.0 * (dot(b, b) + dot(a, c))
    inverse = 1.0 / size
    bend = inverse * _cross(a, b)
    bend_1 = inverse * (_cross(a, c) - bend * size_1)
    bend_2 = inverse * (_cross(b, c) + _cross(a, d) - 2.0 * bend_1 * size_1 - bend * size_2)
    squared = p1 * p1
    return OverTime(bend * p1, bend_1 * squared + bend * p2, p1 * (bend_2 * squared + 3.0 * bend_1 * p2) + bend * p3)


def _speed(at: Frame, bend: Vector, rates: list[Scalar]) -> tuple[Scalar, Scalar]:
    """Speed along a path [m/s] and its rate [m/s^2], positive where the phase rises.

    Args:
        at: frame of the path.
        bend: its second derivative (2,) by the phase [m].
        rates: derivatives of the phase by time, two at least.
    """
    p1, p2 = rates[:2]
    return at.stretch * p1, dot(at.forward, bend) * p1 * p1 + at.stretch * p2


def _over_time(course: Any, t: Scalar) -> OverTime:
    """A course or a plain number at t [s]."""
    if is_course(course):
        return OverTime(*value_and_rates(course, t))
    return OverTime(course + 0.0 * t, 0.0 * t, 0.0 * t)


def _arm_over_time(reference: PathReference, across: OverTime) -> tuple[OverTime, OverTime]:
    """Yaw and reach of arm I to the contact point (e, n) of the object, whose origin is ``offset`` aside.

    They are the polar coordinates of (x, y) = (-n, e + offset).
    """
    n, n1, n2 = across
    e, slope, bend = derivatives(shape_of(reference.surface).along, n, 2)
    x, x1, x2 = -n, -n1, -n2
    y, y1, y2 = e + reference.offset[0], slope * n1, bend * n1 * n1 + slope * n2
    squared, outward = x * x + y * y, x * x1 + y * y1
    reach, inverse = jnp.sqrt(squared), 1.0 / squared
    turn = inverse * (x * y1 - y * x1)
    stretch = outward / reach
    yaw = OverTime(angle_of(x, y), turn, inverse * (x * y2 - y * x2 - 2.0 * outward * turn))
    away = x1 * x1 + y1 * y1 + x * x2 + y * y2 - stretch * stretch
    return yaw, OverTime(reach, stretch, away / reach)


def _cross(a: Vector, b: Vector) -> Scalar:
    return a[0] * b[1] - a[1] * b[0]
