"""The closed loop of Theorem 3.1 as one vector field: robots, coupling, motion and force control, disturbance."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax import coupling, robot
from coopmm_jax.components import Scalar, Vector, minus, plus, scaled, sincos
from coopmm_jax.control import force as force_control
from coopmm_jax.control.motion import Memory, motion_control, position_rates
from coopmm_jax.parameters import Disturbance, Parameters, Structure
from coopmm_jax.reference import desired_force

# Rate [1/s] at which drift of the dependent joints off the constraints decays. RK4 at 1 ms leaves about 1e-12 m a step, so
# any rate of this order keeps |phi| below 1e-9; it is far below 1 / step, so it adds no stiffness.
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
    c_hat: Vector  # (5,)
    constraint_force: Vector  # lambda (m,) [N]
    force_error: Vector  # lambda - lambda_d (m,) [N]
    torque: tuple[Vector, Vector]  # (right wheel, left wheel, joints 1-3) of each robot [N m]
    constraint_residual: Vector  # phi (m,) [m]
    determinants: tuple[Scalar, ...]  # singular arm where one vanishes


def disturbance_torque(disturbance: Disturbance, t: Scalar) -> Vector:
    """Torque on each of a robot's five actuators [N m]; on the left of (1), so it opposes tau."""
    wave = disturbance.scale * sincos(disturbance.frequency * t + disturbance.phase)[0]
    wheel, joint = disturbance.wheel * wave, disturbance.joint * wave
    return (wheel, wheel, joint, joint, joint)


class Kinematics(NamedTuple):
    """Constraint, its solution and velocities at one state."""

    bodies: coupling.Bodies
    reduction: coupling.Reduction
    velocity: tuple[Vector, Vector]
    L_rate: tuple[Vector, Vector]


def kinematics(structure: Structure, parameters: Parameters, position: tuple, independent: Vector) -> Kinematics:
    """(10) at one state."""
    plant = parameters.plant
    bodies = coupling.bodies(plant.geometry, position)
    rows = coupling.constraint_rows(plant.surface, plant.geometry, structure.rows, bodies)
    reduction = coupling.reduce(rows, structure.rows)
    velocity = coupling.expand(reduction, independent)
    bias = coupling.convective(plant.surface, plant.geometry, structure.rows, bodies, velocity)
    return Kinematics(bodies, reduction, velocity, coupling.dependent_solution(reduction, bias))


def closed_loop(structure: Structure, parameters: Parameters, t: Scalar, state: State) -> tuple[State, Signals]:
    """Rates of the state and the loop's signals with ideal force measurement.

    Args:
        structure: static choices. parameters: pytree of scalars. t: time [s].

    Returns:
        The time derivative, as a ``State``, and the ``Signals`` at t.
    """
    plant, gains, memory = parameters.plant, parameters.gains, state.memory
    k = kinematics(structure, parameters, state.position, state.velocity)
    command = motion_control(
        structure,
        gains,
        parameters.reference,
        plant.geometry,
        parameters.nominal,
        plant.gravity,
        t,
        k.bodies,
        k.reduction,
        state.velocity,
        k.velocity,
        k.L_rate,
        memory,
    )
    disturbing = tuple(
        robot.actuator_force(g, p, disturbance_torque(parameters.disturbance, t))
        for g, p in zip(plant.geometry, state.position, strict=True)
    )
    driving = tuple(minus(f, d) for f, d in zip(command.force, disturbing, strict=True))
    lumped = tuple(map(robot.lump, plant.geometry, plant.inertia))
    moved = coupling.constrained_accelerations(plant, lumped, k.bodies, k.reduction, k.velocity, k.L_rate, driving)

    desired = desired_force(parameters.reference, structure.rows)
    free = plus(moved.multipliers, desired)
    error = force_control.ideal_force_error(gains, free, desired, memory.force_integral)
    lambda_h = force_control.force_command(gains, desired, error, memory.force_integral)
    reaction = coupling.constraint_force(k.reduction, lambda_h)
    torque = tuple(
        robot.actuator_torque(g, p, minus(f, r))
        for g, p, f, r in zip(plant.geometry, state.position, command.force, reaction, strict=True)
    )
    correction = coupling.dependent_solution(k.reduction, scaled(DRIFT_RATE, k.reduction.rows.phi))
    rates = State(
        _with_correction(position_rates(state.position, k.velocity), correction),
        moved.independent,
        Memory(command.integral_rate, command.eta_rate, command.c_hat_rate, error),
    )
    signals = Signals(
        state.position,
        k.velocity,
        command.sigma,
        memory.c_hat,
        plus(desired, error),
        error,
        torque,
        k.reduction.rows.phi,
        k.reduction.determinants,
    )
    return rates, signals


def _with_correction(rates: tuple, correction: tuple[Vector, Vector]) -> tuple:
    return tuple(
        robot.Position(*r[:3], *plus(r[3:], c[2:])) for r, c in zip(rates, correction, strict=True)
    )
