"""Actuators of the real loop: torque limits, friction of wheels and joints."""

from __future__ import annotations

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Scalar, Vector
from coopmm_jax.parameters import Hardware, Structure


def torque_limits(hardware: Hardware) -> Vector:
    """Largest torque of one robot's five actuators [N m]."""
    return (hardware.wheel_limit,) * 2 + (hardware.joint_limit,) * 3


def limited(structure: Structure, hardware: Hardware, torque: Vector) -> Vector:
    """Torques of one robot's five actuators held within their limits [N m].

    ``torque_limits`` clips; ``smooth_limits`` uses x / (1 + (x/limit)^8)^(1/8), within 0.1 % of x up to half the limit
    and never beyond it, whose gradient does not vanish at once.
    """
    limits = torque_limits(hardware)
    if "smooth_limits" in structure.features:
        return tuple(_smoothly(x, limit) for x, limit in zip(torque, limits, strict=True))
    if "torque_limits" in structure.features:
        return tuple(jnp.clip(x, -limit, limit) for x, limit in zip(torque, limits, strict=True))
    return torque


def _smoothly(x: Scalar, limit: Scalar) -> Scalar:
    # Written around the clipped value, so that no power overflows and rounding cannot lift it over the limit.
    ratio = jnp.minimum(jnp.abs(x), limit) / jnp.maximum(jnp.abs(x), limit)
    return jnp.clip(x, -limit, limit) / jnp.sqrt(jnp.sqrt(jnp.sqrt(1.0 + ratio**8)))


def friction_torque(hardware: Hardware, rates: Vector) -> Vector:
    """Friction of the five actuators [N m] at their rates [rad/s]: viscous and Coulomb, smoothed around standstill."""
    viscous = (hardware.wheel_viscous,) * 2 + (hardware.joint_viscous,) * 3
    coulomb = (hardware.wheel_coulomb,) * 2 + (hardware.joint_coulomb,) * 3
    return tuple(
        b * rate + c * smooth_sign(rate, hardware.friction_speed)
        for b, c, rate in zip(viscous, coulomb, rates, strict=True)
    )


def smooth_sign(x: Scalar, width: Scalar) -> Scalar:
    """x / sqrt(x^2 + width^2) of scalars: the sign of x, passing zero over about ``width``.

    Cheaper than tanh and as smooth.
    """
    return x / jnp.sqrt(x * x + width * width)
