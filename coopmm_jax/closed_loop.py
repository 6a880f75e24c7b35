"""The closed loop of Theorem 3.1 as one vector field: robots, coupling, motion and force control, disturbance."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax import coupling, robot
from coopmm_jax.components import Scalar, Vector, minus, plus, scaled, sincos
from coopmm_jax.control import force as force_control
from coopmm_jax.control.motion import Memory, motion_control, position_rates
from coopmm_jax.model import Model
from coopmm_jax.parameters import Disturbance, Structure
from coopmm_jax.reference import desired_force

# Rate [1/s] at which drift of the dependent joints off the constraints decays. RK4 at 1 ms leaves about 1e-12 m a step,
# so any rate of this order keeps |phi| below 1e-9; it is far below 1 / step, so it adds no stiffness.
DRIFT_RATE = 10.0


class State(NamedTuple):
    """State of one closed loop: 31 scalars with all four rows in force."""

    position: tuple[robot.Position, robot.Position]
    velocity: Vector  # u^1 (n,)
    memory: Memory


class Signals(NamedTuple):
    """What an observer of the loop sees at one instant."""

    position: tuple[robot.Position, robot.Position]
    velocity: tuple[Vector, Vector]  # u of each robot (5,)
    sigma: Vector  # (n,)
    memory: Memory
    constraint_force: Vector  # lambda (m,) [N]
    force_error: Vector  # lambda - lambda_d (m,) [N]
    torque: tuple[Vector, Vector]  # (right wheel, left wheel, joints 1-3) of each robot [N m]
    constraint_residual: Vector  # phi (m,) [m]
    tip: tuple[Vector, Vector]  # lateral, forward (from the world's origin, platform axes) and height of each tip [m]
    contact_point: Vector  # D = p1 - C along arm II and across it [m]
    determinants: tuple[Scalar, ...]  # singular arm where one vanishes


def disturbance_torque(disturbance: Disturbance, t: Scalar) -> Vector:
    """Torque on each of a robot's five actuators [N m]; on the left of (1), so it opposes tau."""
    wave = disturbance.scale * sincos(disturbance.frequency * t + disturbance.phase)[0]
    wheel, joint = disturbance.wheel * wave, disturbance.joint * wave
    return (wheel, wheel, joint, joint, joint)


def closed_loop(structure: Structure, model: Model, t: Scalar, state: State) -> tuple[State, Signals]:
    """Rates of the state and the loop's signals with ideal force measurement.

    Args:
        structure: static choices. model: pytree of scalars, from ``build_model``. t: time [s].

    Returns:
        The time derivative, as a ``State``, and the ``Signals`` at t.
    """
    gains, memory, geometry = model.gains, state.memory, model.geometry
    k = coupling.kinematics(model, structure.rows, state.position, state.velocity)
    command = motion_control(structure, model, t, k, state.velocity, memory)
    disturbing = disturbance_torque(model.disturbance, t)
    driving = tuple(
        minus(f, robot.actuator_force(g, p, disturbing))
        for f, g, p in zip(command.force, geometry, state.position, strict=True)
    )
    moved = coupling.constrained_accelerations(model, k, driving)

    desired = desired_force(model.reference, structure.rows)
    free = plus(moved.multipliers, desired)
    error = force_control.ideal_force_error(gains, free, desired, memory.force_integral)
    lambda_h = force_control.force_command(gains, desired, error, memory.force_integral)
    reaction = coupling.constraint_force(k.reduction, lambda_h)
    torque = tuple(
        robot.actuator_torque(g, p, minus(f, r))
        for g, p, f, r in zip(geometry, state.position, command.force, reaction, strict=True)
    )
    rates = State(
        _without_drift(position_rates(state.position, k.velocity), k.reduction),
        moved.independent,
        Memory(command.integral_rate, command.eta_rate, command.c_hat_rate, error),
    )
    signals = Signals(
        position=state.position,
        velocity=k.velocity,
        sigma=command.sigma,
        memory=memory,
        constraint_force=plus(desired, error),
        force_error=error,
        torque=torque,
        constraint_residual=k.reduction.rows.phi,
        tip=tuple(map(robot.tip_in_platform, geometry, state.position, k.bodies.arm)),
        contact_point=k.reduction.rows.contact_point,
        determinants=k.reduction.determinants,
    )
    return rates, signals


def _without_drift(rates: tuple, reduction: coupling.Reduction) -> tuple[robot.Position, robot.Position]:
    """Position rates whose dependent joints also work phi off at ``DRIFT_RATE``."""
    correction = coupling.dependent_solution(reduction, scaled(DRIFT_RATE, reduction.rows.phi))
    return tuple(robot.Position(*r[:3], *plus(r[3:], c[2:])) for r, c in zip(rates, correction, strict=True))
