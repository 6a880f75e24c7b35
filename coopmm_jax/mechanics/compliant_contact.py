"""Contact that can open: a stiff surface in the place of the normal row, which the tip can leave and come back to.

The plant then has one independent velocity more. The force is that of Hunt and Crossley, which is continuous as the tip
lands and as it leaves, and never pulls:

    lambda_n = k d^1.5 max(0, 1 - c phidot),   d = max(0, -phi).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import add, dot, plus, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.constraints import Bodies, distance_row
from coopmm_jax.mechanics.contact_surface import SurfaceMotion
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.parameters import Hardware

PRESSED_BY = 15.0  # [N], the paper's force: what ``Hardware.penetration`` is given for


class Touch(NamedTuple):
    """Tip I against a compliant surface."""

    gap: Scalar  # phi; negative where the tip is pressed in [m]
    force: Scalar  # lambda_n [N]
    row: Pair[Vector]  # J of the normal row, (5,) of each robot


def touch(hardware: Hardware, b: Bodies, velocity: Pair[Vector], motion: SurfaceMotion | None) -> Touch:
    """Contact force at one state, and the row along which it acts.

    Args:
        hardware: how stiff and how damped the surface is.
        b: both robots' kinematics.
        velocity: u of each robot (5,).
        motion: of the surface, where it moves [m, m/s].
    """
    gap, row = distance_row(b, motion)
    rate = add(*per_robot(dot, row, velocity))
    if motion is not None:
        rate = rate + b.contact.phi_rates(motion)[0]
    return Touch(gap, contact_force(hardware, gap, rate), row)


def contact_push(touch: Touch, friction: Pair[Vector] | None) -> Pair[Vector]:
    """Force of the contact on each robot (5,); ``friction`` is that for each newton of lambda_n."""
    rows = touch.row if friction is None else per_robot(plus, touch.row, friction)
    return per_robot(lambda row: scaled(touch.force, row), rows)


def contact_force(hardware: Hardware, gap: Scalar, rate: Scalar) -> Scalar:
    """lambda_n [N] at a gap phi [m] that widens at ``rate`` [m/s].

    >>> float(contact_force(Hardware(penetration=1e-4), -1e-4, 0.0))
    15.0
    """
    pressed = gap < 0.0
    ratio = jnp.where(pressed, -gap, hardware.penetration) / hardware.penetration
    force = PRESSED_BY * ratio * jnp.sqrt(ratio) * jnp.maximum(1.0 - hardware.contact_damping * rate, 0.0)
    return jnp.where(pressed, force, 0.0)


def pressed_in(hardware: Hardware, force: Scalar) -> Scalar:
    """Depth [m] at which a contact at rest presses with a force [N]; 0 of a force that pulls."""
    pressing = force > 0.0
    ratio = jnp.where(pressing, force, PRESSED_BY) / PRESSED_BY
    return jnp.where(pressing, hardware.penetration * jnp.cbrt(ratio * ratio), 0.0)
