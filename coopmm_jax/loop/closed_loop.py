"""The closed loop of Theorem 3.1 as one vector field, and what both it and the sampled loop are made of."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Scalar, Vector, minus, plus, scaled
from coopmm_jax.control import force as force_control
from coopmm_jax.control.motion import Memory, MotionCommand, motion_control
from coopmm_jax.control.reference import desired_force
from coopmm_jax.mechanics import partitioning, plant, robot_kinematics
from coopmm_jax.mechanics.actuators import limited
from coopmm_jax.mechanics.constrained_dynamics import Accelerations
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import Structure


class Devices(NamedTuple):
    """States of sensors and actuators; empty where ideal."""

    torque: Vector = ()  # applied torques, robot I's five then robot II's, behind their lag [N m]
    force: Vector = ()  # what the force sensor shows (m,) [N]
    late_forces: tuple[Vector, ...] = ()  # measured forces on their way, the next to arrive first [N]


class State(NamedTuple):
    """State of one closed loop: 31 scalars with all four rows in force and ideal devices."""

    position: tuple[robot_kinematics.Position, robot_kinematics.Position]
    velocity: Vector  # u^1 (n,)
    memory: Memory
    devices: Devices = Devices()


class Signals(NamedTuple):
    """What an observer of the loop sees at one instant."""

    position: tuple[robot_kinematics.Position, robot_kinematics.Position]
    velocity: tuple[Vector, Vector]  # u of each robot (5,)
    sigma: Vector  # (n,)
    memory: Memory
    constraint_force: Vector  # lambda (m,) [N]
    force_error: Vector  # lambda - lambda_d (m,) [N]
    torque: tuple[Vector, Vector]  # applied, (right wheel, left wheel, joints 1-3) of each robot [N m]
    commanded: tuple[Vector, Vector]  # likewise, before limits and lag
    constraint_residual: Vector  # phi (m,) [m]
    tip: tuple[Vector, Vector]  # lateral, forward (from the world's origin, platform axes) and height of each tip [m]
    contact_point: Vector  # D = p1 - C along arm II and across it [m]
    determinants: tuple[Scalar, ...]  # singular arm where one vanishes


class Action(NamedTuple):
    """One decision of the force controller and what the robots do under it."""

    measured_error: Vector  # e_lambda as the controller sees it (m,) [N]
    commanded: tuple[Vector, Vector]  # torques of each robot [N m]
    target: tuple[Vector, Vector]  # likewise, within limits
    applied: tuple[Vector, Vector]  # likewise, behind the actuators' lag
    moved: Accelerations


def ideal_sensing(structure: Structure) -> bool:
    """Whether the controller sees the force its own torque causes, in the same instant."""
    return "force_lag" not in structure.features and structure.force_delay == 0


def act(
    structure: Structure,
    model: Model,
    t: Scalar,
    truth: partitioning.Kinematics,
    seen: partitioning.Kinematics,
    command: MotionCommand,
    state: State,
) -> Action:
    """Close the force loop below (17): from motion force and measured contact force to torques and accelerations.

    An instantaneous loop is solved as if torque had no limits and the controller's J were the plant's; the error that
    goes into the integral is that of the force which then really acts.

    Args:
        t: time [s]. truth, seen: kinematics of the plant, and as the controller measures them.
    """
    gains, integral = model.gains, state.memory.force_integral
    desired = desired_force(model.reference, structure.rows)
    lagging = "actuator_lag" in structure.features
    exact = None  # the response, where closing the loop gives it away
    if not ideal_sensing(structure):
        error = minus(biased(structure, model, state.devices.force), desired)
    elif lagging:
        exact = plant.respond(structure, model, t, truth, _force(model, state.position, _pair(state.devices.torque)))
        error = minus(biased(structure, model, exact.multipliers), desired)
    else:
        free = plant.respond(structure, model, t, truth, command.force)
        without_feedback = biased(structure, model, plus(free.multipliers, desired))
        error = force_control.ideal_force_error(gains, without_feedback, desired, integral)
    lambda_h = force_control.force_command(gains, desired, error, integral)
    commanded = _torque(model, seen, command.force, lambda_h)
    target = tuple(limited(structure, model.hardware, torque) for torque in commanded)
    applied = _pair(state.devices.torque) if lagging else target
    if exact is None and _feedback_is_exact(structure):
        # J^T lambda_h moves nothing and adds to the multipliers one for one, so no second solve is needed.
        exact = free._replace(multipliers=plus(free.multipliers, lambda_h))
    moved = exact or plant.respond(structure, model, t, truth, _force(model, state.position, applied))
    if ideal_sensing(structure) and exact is None:
        error = minus(biased(structure, model, moved.multipliers), desired)
    return Action(error, commanded, target, applied, moved)


def _feedback_is_exact(structure: Structure) -> bool:
    touched = {"torque_limits", "smooth_limits", "noise", "tip_friction"}
    return ideal_sensing(structure) and not touched & set(structure.features)


def biased(structure: Structure, model: Model, force: Vector) -> Vector:
    """A measured constraint force (m,) with the sensor's bias [N]."""
    if "force_bias" not in structure.features:
        return force
    return tuple(x + model.hardware.force_bias for x in force)


def _torque(
    model: Model, seen: partitioning.Kinematics, force: tuple[Vector, Vector], lambda_h: Vector
) -> tuple[Vector, Vector]:
    """B tau = F - J^T lambda_h, with the controller's J."""
    reaction = partitioning.constraint_force(seen.reduction, lambda_h)
    return tuple(
        robot_kinematics.actuator_torque(g, p, minus(f, r))
        for g, p, f, r in zip(model.geometry, seen.bodies.position, force, reaction, strict=True)
    )


def _force(model: Model, position: tuple, torque: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    return tuple(map(robot_kinematics.actuator_force, model.geometry, position, torque))


def _pair(torque: Vector) -> tuple[Vector, Vector]:
    return tuple(torque[:5]), tuple(torque[5:])


def closed_loop(structure: Structure, model: Model, t: Scalar, state: State) -> tuple[State, Signals]:
    """Rates of the state, (11) under (12)-(24), and the loop's signals; the controller runs in continuous time.

    Args:
        structure: static choices. model: pytree of scalars, from ``build_model``. t: time [s].

    Returns:
        The time derivative, as a ``State``, and the ``Signals`` at t.
    """
    truth = plant.plant_kinematics(structure, model, t, state.position, state.velocity)
    seen = truth
    if "surface_motion" in structure.features:
        seen = partitioning.kinematics(model, structure.rows, state.position, state.velocity)
    command = motion_control(structure, model, t, seen, state.velocity, state.memory)
    action = act(structure, model, t, truth, seen, command, state)
    rates = State(
        plant.rates_without_drift(truth),
        action.moved.independent,
        Memory(command.integral_rate, command.eta_rate, command.c_hat_rate, action.measured_error),
        _device_rates(structure, model, action, state.devices),
    )
    return rates, observe(structure, model, truth, state, command.sigma, action)


def torque_rates(model: Model, target: tuple[Vector, Vector], torque: Vector) -> Vector:
    """First-order lag of the actuators (10,) [N m/s]."""
    return scaled(1.0 / model.hardware.actuator_lag, minus((*target[0], *target[1]), torque))


def _device_rates(structure: Structure, model: Model, action: Action, devices: Devices) -> Devices:
    torque, force = (), ()
    if "actuator_lag" in structure.features:
        torque = torque_rates(model, action.target, devices.torque)
    if "force_lag" in structure.features:
        force = scaled(1.0 / model.hardware.force_lag, minus(action.moved.multipliers, devices.force))
    return Devices(torque, force)


def observe(
    structure: Structure, model: Model, truth: partitioning.Kinematics, state: State, sigma: Vector, action: Action
) -> Signals:
    """The signals at one instant, from the plant's kinematics, sigma (n,) below (15) and what was done."""
    lam = action.moved.multipliers
    return Signals(
        position=state.position,
        velocity=truth.velocity,
        sigma=sigma,
        memory=state.memory,
        constraint_force=lam,
        force_error=minus(lam, desired_force(model.reference, structure.rows)),
        torque=action.applied,
        commanded=action.commanded,
        constraint_residual=truth.reduction.rows.phi,
        tip=tuple(map(robot_kinematics.tip_in_platform, model.geometry, state.position, truth.bodies.arm)),
        contact_point=truth.reduction.rows.contact_point,
        determinants=truth.reduction.determinants,
    )
