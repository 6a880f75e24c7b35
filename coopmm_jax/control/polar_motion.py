"""Desired motion of a platform beside a path in the chart of ``mechanics/log_polar.py``.

Bearing and ln r of the desired place are functions of the phase p, and the chained form follows from them:
z3 = (dz2/dp)/(dz1/dp), z4 = (dz3/dp)/(dz1/dp), u_d1 = dz1/dt, u_d2 = dz4/dt. So a phase that stands still is nothing
special, but a place seen from the origin in one direction is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.angle import angle_of
from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.matrix import dot
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.paths import frame_of


class PolarAim(NamedTuple):
    """Desired motion of one platform at one instant."""

    zeta: Vector  # z1, ..., z4 (4,)
    turn: Vector  # u_d1 and its first three derivatives (4,) [rad/s, ...]
    advance: Vector  # u_d2 and its derivative (2,) [1/s, 1/s^2]


def polar_aim(path: Any, timing: Any, offset: Scalar, t: Scalar) -> PolarAim:
    """``PolarAim`` at t [s].

    Args:
        path: of the object.
        timing: of its phase.
        offset: of the platform to the right of the path [m].
        t: time [s].
    """

    def place(phase: Scalar) -> Vector:
        at = frame_of(*derivatives(path.point, phase, 1))
        x, y = at.point
        return x + offset * at.lateral[0], y + offset * at.lateral[1]

    def turning(phase: Scalar) -> Scalar:
        (x, y), (x_rate, y_rate) = derivatives(place, phase, 1)
        return (x * y_rate - y * x_rate) / (x * x + y * y)

    def z3(phase: Scalar) -> Scalar:
        (x, y), (x_rate, y_rate) = derivatives(place, phase, 1)
        return (x * x_rate + y * y_rate) / (x * y_rate - y * x_rate)

    def z4(phase: Scalar) -> Scalar:
        return derivatives(z3, phase, 1)[1] / turning(phase)

    def u_d1(t: Scalar) -> Scalar:
        phase, rate = derivatives(timing.phase, t, 1)
        return turning(phase) * rate

    def u_d2(t: Scalar) -> Scalar:
        phase, rate = derivatives(timing.phase, t, 1)
        return derivatives(z4, phase, 1)[1] * rate

    phase = timing.phase(t)
    x, y = at = place(phase)
    zeta = (angle_of(x, y), 0.5 * jnp.log(dot(at, at)), z3(phase), z4(phase))
    return PolarAim(zeta, derivatives(u_d1, t, 3), derivatives(u_d2, t, 1))
