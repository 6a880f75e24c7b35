"""Motion along a path as both robots should carry it out: headings, inputs and arm yaw with their derivatives.

Both platforms run beside the object's path r(p(t)), at a constant offset to its right, and have its heading: then
z_d = (th, lateral . r + offset, forward . r) meets (8) with u_d = (dth/dt, dz_d3/dt), standstill and reversal
included. Robot II reaches straight across the path; robot I to the desired contact point on the object.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot
from coopmm_jax.algebra.types import Scalar
from coopmm_jax.kinds.courses import current
from coopmm_jax.kinds.paths import bent_frame, heading, one_like
from coopmm_jax.mechanics.surfaces import shape_of
from coopmm_jax.parameters import PathReference


class OverTime(NamedTuple):
    """A scalar at one instant, and its first two time derivatives."""

    value: Scalar
    rate: Scalar
    acceleration: Scalar

    def after(self, delay: Scalar) -> Scalar:
        """Value shortly after the instant [s], by Taylor's formula."""
        return self.value + delay * (self.rate + 0.5 * delay * self.acceleration)


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


class Known(NamedTuple):
    """A ``PathReference`` and its ``Aim`` at t [s]; stands for it in the neighbourhood of that instant."""

    reference: PathReference
    aim: Aim
    t: Scalar


def aim_at(reference: PathReference, t: Scalar) -> Aim:
    """Aim at t [s]."""
    one = one_like(t)

    def inputs(t: Scalar) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar, Scalar]]:
        phase, rate = jax.jvp(reference.timing.phase, (t,), (one,))
        at, curvature = bent_frame(reference.path, phase)
        speed, across = at.stretch * rate, dot(at.lateral, at.point)
        turn = curvature * speed
        return (turn, speed - turn * across), (heading(at), across, dot(at.forward, at.point))

    def rates(t: Scalar) -> tuple:
        now, rate, places = jax.jvp(inputs, (t,), (one,), has_aux=True)
        return rate, (now, places)

    (turn_rate, advance_rate), (turn_jerk, _), (now, places) = jax.jvp(rates, (t,), (one,), has_aux=True)
    (turn, advance), (angle, across, ahead) = now, places
    yaw, reach = _arm_over_time(reference, t)
    return Aim(
        heading=angle,
        across=across,
        ahead=ahead,
        turn=OverTime(turn, turn_rate, turn_jerk),
        advance=advance,
        advance_rate=advance_rate,
        yaw=yaw,
        reach=reach,
        contact=current(reference.contact, t) + 0.0 * t,
        force=current(reference.contact_force, t) + 0.0 * t,
    )


def known_at(reference: PathReference, t: Scalar) -> Known:
    """The reference with its aim at t [s]."""
    return Known(reference, aim_at(reference, t), t)


def _arm_over_time(reference: PathReference, t: Scalar) -> tuple[OverTime, OverTime]:
    """Yaw and reach of arm I to the contact point (e, n) of the object, whose origin is ``offset`` aside."""

    def polar(t: Scalar) -> tuple[Scalar, Scalar]:
        across = current(reference.contact, t) + 0.0 * t
        along = shape_of(reference.surface).along(across) + reference.offset[0]
        return jnp.arctan2(along, -across), jnp.sqrt(along * along + across * across)

    one = one_like(t)
    now, rate = jax.jvp(polar, (t,), (one,))
    _, acceleration = jax.jvp(lambda t: jax.jvp(polar, (t,), (one,))[1], (t,), (one,))
    yaw, reach = map(OverTime, now, rate, acceleration)
    return yaw, reach
