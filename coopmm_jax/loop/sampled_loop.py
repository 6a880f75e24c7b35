"""The loop as a computer runs it: measure, decide and adapt once per control period, hold the torque in between."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax

from coopmm_jax.algebra.matrix import minus, plus
from coopmm_jax.algebra.types import Pair, PyTree, Scalar, Vector
from coopmm_jax.control.controller import Seen, known_to_controller
from coopmm_jax.control.gain_schedule import in_force
from coopmm_jax.control.reference import at_instant, desired_force
from coopmm_jax.loop.devices import Noise, draw_noise, sense, torque_rates
from coopmm_jax.loop.force_loop import Instant, act, independent_velocity, observe
from coopmm_jax.loop.form import Form, Packed
from coopmm_jax.loop.integrate import recomputed, rk4_hold
from coopmm_jax.loop.lookahead import at_begin, informed
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics import plant
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.coordinates import AnyPosition
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.robot import by_robot, per_robot
from coopmm_jax.mechanics.robot_kinematics import actuator_force, mismeasured
from coopmm_jax.parameters import Structure


class _Motion(NamedTuple):
    """Part of the state that moves between two samples."""

    position: Pair[AnyPosition]
    velocity: Vector
    torque: Vector  # (10,) of lagging actuators; empty otherwise
    carriage: Vector  # (1,) of a rail; empty otherwise


class _Decision(NamedTuple):
    """Rates and noise of one sample, for what moves from this sample to the next."""

    controller: PyTree  # rates of its state
    noise: Noise | None


def sampled_step(
    structure: Structure,
    form: Form,
    model: PyTree,
    sample: Scalar,
    t: Scalar,
    period: Scalar,
    state: PyTree,
    aims: Packed | None = None,
) -> tuple[PyTree, PyTree]:
    """One control period: sample at t, act, integrate the robots under held torque by ``substeps`` RK4 steps.

    The controller state (adaptation, integrals, eta) moves by one Euler step per sample, as a control computer does it.

    Args:
        structure: static choices.
        form: of ``model`` (a ``Model``), of ``state`` (a ``State``) and of what comes back.
        model: of the rollout.
        sample: number of this sample.
        t: its time [s].
        period: control period [s].
        state: at t.
        aims: of a path at the sample and after (3, ...), if they are known ahead.

    Returns:
        The state at t + period, and the signals at t, just after the torque has been set.
    """
    decide = form.field(functools.partial(_decide, structure, sample))
    target, decision, signals = recomputed(decide)(informed(model, at_begin(aims), t), t, state)
    held = functools.partial(form.field(functools.partial(_driven, structure)), (model, target))
    step, (start,) = period / structure.substeps, form.lifted(_motion)(state)
    moved, forces = rk4_hold(held, t, step, structure.substeps, start)
    finish = form.lifted(functools.partial(_next, structure, sample, period))
    return finish(model, t, state, signals, decision, moved, forces)


def _decide(
    structure: Structure, sample: Scalar, model: Model, t: Scalar, state: State
) -> tuple[Pair[Vector], _Decision, Signals]:
    """Torques to be held [N m], rates of the controller, and the signals."""
    model = model._replace(reference=at_instant(model.reference, t), gains=in_force(model, t))
    truth = plant.plant_kinematics(structure, model, t, state.position, state.velocity, state.carriage)
    seen, independent, noise = _measure(structure, model, sample, t, truth, state)
    now = Instant(structure, model, t, truth, seen, state)
    command = model.gains.command(Seen(structure, known_to_controller(model), t, seen, independent), state.controller)
    action = act(now, command)
    return action.target, _Decision(command.rates(action.measured_error), noise), observe(now, command, action)


def _measure(
    structure: Structure, model: Model, sample: Scalar, t: Scalar, truth: Kinematics, state: State
) -> tuple[Kinematics, Vector, Noise | None]:
    """The robots' state as the controller measures it, and the sample's noise."""
    noise = draw_noise(structure, model, sample) if structure.features.noise else None
    position, independent = state.position, independent_velocity(structure, truth, state)
    if noise is None and not (structure.features.surface_motion or structure.compliant):
        return truth, independent, None
    if noise is not None:
        position = per_robot(mismeasured, model.geometry, position, noise.position, noise.steering)
        independent = plus(independent, noise.velocity)
    return plant.expected_kinematics(structure, model, t, position, independent, state.carriage), independent, noise


def _motion(state: State) -> tuple[_Motion]:
    return (_Motion(state.position, state.velocity, state.devices.torque, state.carriage),)


def _driven(structure: Structure, known: tuple[Model, Pair[Vector]], t: Scalar, x: _Motion) -> tuple[_Motion, Vector]:
    """Rates of robots and actuators under a constant torque command; also lambda (m,)."""
    model, target = known
    k = plant.plant_kinematics(structure, model, t, x.position, x.velocity, x.carriage)
    lagging = structure.features.actuator_lag
    applied = by_robot(x.torque, structure.joints[0]) if lagging else target
    force = per_robot(actuator_force, model.geometry, x.position, applied)
    moved = plant.respond(structure, model, t, k, force)
    torque = torque_rates(model, target, x.torque) if lagging else ()
    carriage = plant.carriage_rate(structure, model, k)
    return _Motion(plant.rates_without_drift(k), moved.independent, torque, carriage), moved.multipliers


def _next(
    structure: Structure,
    sample: Scalar,
    period: Scalar,
    model: Model,
    t: Scalar,
    state: State,
    signals: Signals,
    decision: _Decision,
    moved: _Motion,
    forces: Vector,
) -> tuple[State, Signals]:
    """State at the next sample; the signals with lambda of the first integration stage.

    That lambda is computed anyway; ``_decide`` need not find one, and behind a late sensor finds none.
    """
    controller = jax.tree.map(lambda x, rate: x + period * rate, state.controller, decision.controller)
    devices = sense(structure, model, sample, period, state.devices, forces, decision.noise)
    force_error = minus(forces, desired_force(model.reference, structure.rows, t))
    signals = signals._replace(constraint_force=forces, force_error=force_error)
    devices = devices._replace(torque=moved.torque)
    return State(moved.position, moved.velocity, controller, devices, moved.carriage), signals
