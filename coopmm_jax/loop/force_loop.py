"""The force loop below (17) at one instant: from motion force and measured contact force to torques and motion."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import minus, plus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.controller import Command
from coopmm_jax.control.force import ForceFeedback, force_command, ideal_force_error
from coopmm_jax.control.path_motion import Known
from coopmm_jax.control.reference import desired_force
from coopmm_jax.loop.devices import biased, ideal_sensing, limited
from coopmm_jax.loop.state import Action, Signals, State
from coopmm_jax.mechanics import plant
from coopmm_jax.mechanics.constrained_dynamics import Accelerations
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import constraint_force, parted, partition
from coopmm_jax.mechanics.robot import by_robot, per_robot
from coopmm_jax.mechanics.robot_kinematics import actuator_force, actuator_torque, steering, tip_in_platform
from coopmm_jax.parameters import Structure


class Instant(NamedTuple):
    """All that a decision depends on."""

    structure: Structure
    model: Model
    t: Scalar  # [s]
    truth: Kinematics  # of the plant
    seen: Kinematics  # as the controller measures it
    state: State


def independent_velocity(structure: Structure, truth: Kinematics, state: State) -> Vector:
    """u^1 (n,) of the controller, which takes the contact for rigid, out of the plant's velocities."""
    if not structure.compliant:
        return state.velocity
    return parted(partition(structure.rows, structure.joints), truth.velocity)[0]


def act(now: Instant, command: Command) -> Action:
    """Torques and accelerations from the motion controller's force and the measured contact force.

    A sensor that is late shows a force of the past, and actuators that lag still exert a torque of the past; only where
    both are ideal does the force depend on the torque that it decides.
    """
    if not ideal_sensing(now.structure):
        return _with_late_sensor(now, command)
    if now.structure.features.actuator_lag:
        return _with_lagging_actuators(now, command)
    return _at_once(now, command)


def _with_late_sensor(now: Instant, command: Command) -> Action:
    """The error is that of the force which the sensor shows."""
    error = _error(now, now.state.devices.force)
    commanded, target = _torques(now, command, _wanted(now, error))
    lagging = now.structure.features.actuator_lag
    applied = by_robot(now.state.devices.torque, now.structure.joints[0]) if lagging else target
    if now.structure.substeps:
        # Nothing here depends on the motion, and the integration of the period finds it (``sampled_loop._next``).
        return Action(error, commanded, target, applied, Accelerations((), ((), ()), _desired(now)))
    return Action(error, commanded, target, applied, _response(now, applied))


def _with_lagging_actuators(now: Instant, command: Command) -> Action:
    """The force follows from the torque applied now, whatever is decided."""
    applied = by_robot(now.state.devices.torque, now.structure.joints[0])
    moved = _response(now, applied)
    error = _error(now, moved.multipliers)
    return Action(error, *_torques(now, command, _wanted(now, error)), applied, moved)


def _at_once(now: Instant, command: Command) -> Action:
    """The algebraic loop, solved as if torque had no limits and the controller's J were the plant's.

    Where that is not so, the error that goes into the integral is that of the force which then really acts.
    """
    structure, model, desired = now.structure, now.model, _desired(now)
    known = _known_error(now)
    free = plant.respond(structure, model, now.t, now.truth, _with_known_feedback(now, command, known))
    without_feedback = biased(structure, model, plus(free.multipliers, desired))
    error = ideal_force_error(_feedback(now), without_feedback, desired)
    error = (*known, *error[len(known) :])
    lambda_h = _wanted(now, error)
    commanded, target = _torques(now, command, lambda_h)
    if _solution_is_exact(structure):
        # J^T lambda_h moves nothing and adds to the multipliers one for one, so no second solve is needed.
        added = (*(0 for _ in known), *lambda_h[len(known) :])
        moved = free._replace(multipliers=plus(free.multipliers, added))
        return Action(error, commanded, target, target, moved)
    moved = _response(now, target)
    return Action(_error(now, moved.multipliers), commanded, target, target, moved)


def _known_error(now: Instant) -> Vector:
    """Error (1,) of a compliant contact's force [N], known before any torque is; none, (0,), where it is rigid."""
    if now.truth.touch is None:
        return ()
    return minus(biased(now.structure, now.model, (now.truth.touch.force,)), _desired(now)[:1])


def _with_known_feedback(now: Instant, command: Command, known: Vector) -> Pair[Vector]:
    """F less what the force loop does about the errors known (m,) [N], on each robot (5,)."""
    if not known:
        return command.force
    feedback = _wanted(now, (*known, *_desired(now)[len(known) :]))[: len(known)]
    others = (0,) * (len(now.structure.rows) - len(known))
    return per_robot(minus, command.force, constraint_force(now.seen.reduction, (*feedback, *others)))


def _solution_is_exact(structure: Structure) -> bool:
    """True if the solution holds; friction of a compliant tip does not depend on the torque."""
    features = structure.features
    return not (features.limits or features.noise or (features.tip_friction and not structure.compliant))


def _desired(now: Instant) -> Vector:
    return desired_force(now.model.reference, now.structure.rows, now.t)


def _error(now: Instant, force: Vector) -> Vector:
    return minus(biased(now.structure, now.model, force), _desired(now))


def _feedback(now: Instant) -> ForceFeedback:
    return now.model.gains.force_feedback(now.state.controller)


def _wanted(now: Instant, error: Vector) -> Vector:
    """lambda_h (m,) [N]."""
    return force_command(_feedback(now), _desired(now), error)


def _torques(now: Instant, command: Command, lambda_h: Vector) -> tuple[Pair[Vector], Pair[Vector]]:
    """B tau = F - J^T lambda_h with the controller's J: torques of each robot, and these within limits."""
    model, seen = now.model, now.seen
    wanted = per_robot(minus, command.force, constraint_force(seen.reduction, lambda_h))
    commanded = per_robot(actuator_torque, model.geometry, seen.bodies.position, wanted)
    return commanded, per_robot(lambda torque: limited(now.structure, model.hardware, torque), commanded)


def _response(now: Instant, torque: Pair[Vector]) -> Accelerations:
    force = per_robot(actuator_force, now.model.geometry, now.state.position, torque)
    return plant.respond(now.structure, now.model, now.t, now.truth, force)


def observe(now: Instant, command: Command, action: Action) -> Signals:
    """Signals at one instant, from what the controller has answered and the action taken."""
    truth, lam = now.truth, action.moved.multipliers
    return Signals(
        position=truth.bodies.place,
        velocity=truth.velocity,
        computed=command.signals,
        controller=now.state.controller,
        constraint_force=lam,
        force_error=minus(lam, _desired(now)),
        torque=action.applied,
        commanded=action.commanded,
        constraint_residual=truth.reduction.rows.phi
        if truth.touch is None
        else (truth.touch.gap, *truth.reduction.rows.phi),
        tip=per_robot(tip_in_platform, now.model.geometry, truth.bodies.place, truth.bodies.arm),
        contact_point=truth.reduction.rows.contact_point,
        determinants=(now.seen if truth.touch else truth).reduction.determinants,
        carriage=now.state.carriage,
        aim=now.model.reference.aim if isinstance(now.model.reference, Known) else None,
        steering=steering(now.model.geometry, now.state.position),
    )
