"""The loop as a computer runs it: measure, decide and adapt once per control period, hold the torque in between."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax

from coopmm_jax.algebra.matrix import minus, plus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.controller import motion_control
from coopmm_jax.control.reference import desired_force
from coopmm_jax.loop.devices import Noise, draw_noise, sense, torque_rates
from coopmm_jax.loop.force_loop import Instant, act, observe
from coopmm_jax.loop.form import Form
from coopmm_jax.loop.integrate import recomputed, rk4_hold
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics import plant
from coopmm_jax.mechanics.constrained_kinematics import Kinematics, kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.robot import by_robot, per_robot
from coopmm_jax.mechanics.robot_kinematics import Position, actuator_force
from coopmm_jax.parameters import Structure


class _Motion(NamedTuple):
    """What moves between two samples."""

    position: Pair[Position]
    velocity: Vector
    torque: Vector  # (10,) of lagging actuators; empty otherwise


def sampled_step(
    structure: Structure,
    constants: tuple,
    form: Form,
    sample: Scalar,
    t: Scalar,
    period: Scalar,
    state: Any,
) -> tuple[Any, Any]:
    """One control period: sample at t, act, integrate the robots under held torque by ``substeps`` RK4 steps.

    The controller state (adaptation, integrals, eta) moves by one Euler step per sample, as a control computer does it.

    Args:
        constants: the parts of a ``Model``. form: of these, of ``state`` (a ``State``) and of what comes back.
        sample: number of this sample. period: control period [s].

    Returns:
        The state at t + period, and the signals at t, just after the torque has been set.
    """

    def decide(constants: tuple, t: Scalar, state: State) -> tuple:
        model = Model(*constants)
        truth = plant.plant_kinematics(structure, model, t, state.position, state.velocity)
        seen, independent, noise = _measure(structure, model, sample, truth, state)
        now = Instant(structure, model, t, truth, seen, state)
        command = motion_control(structure, model, t, seen, independent, state.controller)
        action = act(now, command)
        return (action.target, command.rates(action.measured_error), noise), observe(now, command.sigma, action)

    decision, signals = recomputed(form.field(decide, constants, form.pack_read))(t, state)
    (target, rates, noise), signals, state = form.unpack(decision), form.unpack_read(signals), form.unpack(state)
    moved, forces = _hold(structure, constants, form, t, period, state, target)
    model = Model(*form.unpack_each(constants))
    controller = jax.tree.map(lambda x, rate: x + period * rate, state.controller, rates)
    devices = sense(structure, model, period, state.devices, forces, noise)._replace(torque=moved.torque)
    # The multipliers of the first integration stage are computed anyway; those of ``decide`` then need not be.
    force_error = minus(forces, desired_force(model.reference, structure.rows))
    signals = signals._replace(constraint_force=forces, force_error=force_error)
    return form.pack(State(moved.position, moved.velocity, controller, devices)), form.pack_read(signals)


def _measure(
    structure: Structure, model: Model, sample: Scalar, truth: Kinematics, state: State
) -> tuple[Kinematics, Vector, Noise | None]:
    """What the controller takes the robots' state for, and the sample's noise."""
    noise = draw_noise(structure, model, sample) if structure.features.noise else None
    if noise is None and not structure.features.surface_motion:
        return truth, state.velocity, None
    position, independent = state.position, state.velocity
    if noise is not None:
        position = per_robot(lambda p, error: Position(*plus(p, error)), position, noise.position)
        independent = plus(independent, noise.velocity)
    return kinematics(model, structure.rows, position, independent), independent, noise


def _hold(
    structure: Structure,
    constants: tuple,
    form: Form,
    t: Scalar,
    period: Scalar,
    state: State,
    target: Pair[Vector],
) -> tuple[_Motion, Vector]:
    """Robots and actuators over one period under a constant torque command; also lambda (m,) at its start."""
    lagging = structure.features.actuator_lag

    def field(known: tuple, at: Scalar, x: _Motion) -> tuple[_Motion, Vector]:
        *parts, target = known
        model = Model(*parts)
        k = plant.plant_kinematics(structure, model, at, x.position, x.velocity)
        applied = by_robot(x.torque) if lagging else target
        force = per_robot(actuator_force, model.geometry, x.position, applied)
        moved = plant.respond(structure, model, at, k, force)
        torque = torque_rates(model, target, x.torque) if lagging else ()
        return _Motion(plant.rates_without_drift(k), moved.independent, torque), moved.multipliers

    start = _Motion(state.position, state.velocity, state.devices.torque)
    held = form.field(field, (*constants, form.pack(target)))
    end, forces = rk4_hold(held, t, period / structure.substeps, structure.substeps, form.pack(start))
    return form.unpack(end), form.unpack(forces)
