"""The two coupled robots under given actuator torques: (1), (2) and (11) with disturbance, friction, moving surface."""

from __future__ import annotations

import functools

from coopmm_jax.algebra.matrix import Scalar, Vector, dot, minus, plus, scaled, sincos
from coopmm_jax.control.motion import position_rates
from coopmm_jax.mechanics import constrained_dynamics, partitioning, robot_kinematics
from coopmm_jax.mechanics.actuators import friction_torque, smooth_sign
from coopmm_jax.mechanics.constraints import sliding_rows, surface_motion
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import Disturbance, Structure

# Rate [1/s] at which drift of the dependent joints off the constraints decays. RK4 at 1 ms leaves about 1e-12 m a step;
# 10 keeps |phi| below 1e-9 over the paper's run where 1 does not, and is far below 1 / step, so it adds no stiffness.
DRIFT_RATE = 10.0


@functools.singledispatch
def disturbance_torque(disturbance: Disturbance, t: Scalar) -> Vector:
    """Torque on each of a robot's five actuators (5,) at time t [s] [N m]; on the left of (1), so it opposes tau.

    Another shape of disturbance is a NamedTuple of scalars of your own, in the place of ``Parameters.disturbance``, and
    a function for it: ``@disturbance_torque.register``.

    >>> from typing import NamedTuple
    >>> class Push(NamedTuple):
    ...     force: Scalar = 2.0
    >>> @disturbance_torque.register
    ... def _(push: Push, t: Scalar) -> Vector:
    ...     return (push.force, push.force, 0.0, 0.0, 0.0)
    >>> disturbance_torque(Push(), 0.0)
    (2.0, 2.0, 0.0, 0.0, 0.0)
    """
    wave = disturbance.scale * sincos(disturbance.frequency * t + disturbance.phase)[0]
    wheel, joint = disturbance.wheel * wave, disturbance.joint * wave
    return (wheel, wheel, joint, joint, joint)


def plant_kinematics(
    structure: Structure, model: Model, t: Scalar, position: tuple, independent: Vector
) -> partitioning.Kinematics:
    """The true constrained motion (10) at t [s], moving surface included; ``independent`` is u^1 (n,)."""
    moving = "surface_motion" in structure.features
    motion = surface_motion(model.hardware, model.surface, t) if moving else None
    return partitioning.kinematics(model, structure.rows, position, independent, motion)


def respond(
    structure: Structure, model: Model, t: Scalar, k: partitioning.Kinematics, force: tuple[Vector, Vector]
) -> constrained_dynamics.Accelerations:
    """Accelerations and multipliers under a generalised actuator force B tau of each robot (5,)."""
    opposing = disturbance_torque(model.disturbance, t)
    driving = []
    for f, g, p, u in zip(force, model.geometry, k.bodies.position, k.velocity, strict=True):
        losses = opposing
        if "friction" in structure.features:
            losses = plus(opposing, friction_torque(model.hardware, robot_kinematics.actuator_rates(g, p, u)))
        driving.append(minus(f, robot_kinematics.actuator_force(g, p, losses)))
    friction = _tip_friction(model, k) if "tip_friction" in structure.features else None
    return constrained_dynamics.constrained_accelerations(model, k, tuple(driving), friction)


def _tip_friction(model: Model, k: partitioning.Kinematics) -> tuple[Vector, Vector]:
    """Coulomb friction of the sliding tip for each newton of |lambda_n|, on each robot (5,).

    It acts along the arc; where no groove holds the tip's height, sliding up and down is free of it.
    """
    rows = sliding_rows(model.surface, k.bodies)
    speed = sum(dot(row, u) for row, u in zip(rows, k.velocity, strict=True))
    share = -model.hardware.tip_friction * smooth_sign(speed, model.hardware.slip_speed)
    return tuple(scaled(share, row) for row in rows)


def rates_without_drift(k: partitioning.Kinematics) -> tuple[robot_kinematics.Position, robot_kinematics.Position]:
    """Rates of all twelve coordinates; the dependent joints' also work phi off at ``DRIFT_RATE``."""
    correction = partitioning.dependent_solution(k.reduction, scaled(DRIFT_RATE, k.reduction.rows.phi))
    rates = position_rates(k.bodies.position, k.velocity)
    return tuple(robot_kinematics.Position(*r[:3], *plus(r[3:], c[2:])) for r, c in zip(rates, correction, strict=True))
