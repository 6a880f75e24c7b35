"""Friction of wheels, joints and the sliding contact."""

from __future__ import annotations

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.constraints import sliding_rows
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.robot import of_each_actuator, per_robot
from coopmm_jax.parameters import Hardware


def friction_torque(hardware: Hardware, rates: Vector) -> Vector:
    """Friction of a robot's actuators (5,) [N m]: viscous and Coulomb, smoothed around standstill.

    Args:
        hardware: coefficients, as scalars.
        rates: of wheels and joints (5,) [rad/s].
    """
    viscous = of_each_actuator(hardware.wheel_viscous, hardware.joint_viscous, len(rates))
    coulomb = of_each_actuator(hardware.wheel_coulomb, hardware.joint_coulomb, len(rates))
    return tuple(
        b * rate + c * smooth_sign(rate, hardware.friction_speed)
        for b, c, rate in zip(viscous, coulomb, rates, strict=True)
    )


def tip_friction(model: Model, k: Kinematics) -> Pair[Vector]:
    """Coulomb friction of the sliding tip for each newton of |lambda_n|, on each robot (5,).

    It acts along the surface; where no groove holds the tip's height, sliding up and down is free of it.
    """
    rows = sliding_rows(k.bodies)
    speed = sum(dot(row, u) for row, u in zip(rows, k.velocity, strict=True))
    share = -model.hardware.tip_friction * smooth_sign(speed, model.hardware.slip_speed)
    return per_robot(lambda row: scaled(share, row), rows)


def smooth_sign(x: Scalar, width: Scalar) -> Scalar:
    """x / sqrt(x^2 + width^2) of scalars: the sign of x, passing zero over about ``width``.

    Cheaper than tanh and as smooth.
    """
    return x / jnp.sqrt(x * x + width * width)
