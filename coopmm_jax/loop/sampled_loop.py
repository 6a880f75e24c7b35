"""The loop as a computer runs it: measure, decide and adapt once per control period, hold the torque in between."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Scalar, Vector, minus, plus
from coopmm_jax.control.motion import Memory, motion_control
from coopmm_jax.control.reference import desired_force
from coopmm_jax.loop.closed_loop import Devices, State, act, ideal_sensing, observe, torque_rates
from coopmm_jax.loop.form import Form
from coopmm_jax.loop.integrate import recomputed, rk4_hold
from coopmm_jax.mechanics import partitioning, plant, robot_kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import Structure


class Noise(NamedTuple):
    """Measurement errors of one sample."""

    position: tuple[robot_kinematics.Position, robot_kinematics.Position]
    velocity: Vector  # (n,)
    force: Vector  # (m,) [N]


def draw_noise(structure: Structure, model: Model, sample: Scalar) -> Noise:
    """Gaussian errors of one sample; ``sample`` is its number, a scalar.

    The key is folded from seed, stream and sample number, so a rollout's noise does not depend on the batch it is in.
    """
    hardware, n = model.hardware, partitioning.JOINTS * 2 - len(structure.rows)
    upper, lower = (half.astype(jnp.uint32) for half in hardware.noise_seed)
    key = jax.random.fold_in(jax.random.key((upper << 16) | lower), hardware.noise_stream.astype(jnp.uint32))
    count = 12 + n + len(structure.rows)
    values = jax.random.normal(jax.random.fold_in(key, sample), (count,), hardware.noise_stream.dtype)
    values = [values[i] for i in range(count)]
    encoders = [hardware.encoder_noise * x for x in values[:12]]
    return Noise(
        (robot_kinematics.Position(*encoders[:6]), robot_kinematics.Position(*encoders[6:])),
        tuple(hardware.velocity_noise * x for x in values[12 : 12 + n]),
        tuple(hardware.force_noise * x for x in values[12 + n :]),
    )


class _Motion(NamedTuple):
    """What moves between two samples."""

    position: tuple[robot_kinematics.Position, robot_kinematics.Position]
    velocity: Vector
    torque: Vector  # of lagging actuators (10,); empty otherwise


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

    Memory (adaptation, integrals, eta) moves by one Euler step per sample, as a control computer would do it.

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
        command = motion_control(structure, model, t, seen, independent, state.memory)
        action = act(structure, model, t, truth, seen, command, state)
        rates = Memory(command.integral_rate, command.eta_rate, command.c_hat_rate, action.measured_error)
        return (action.target, rates, noise), observe(structure, model, truth, state, command.sigma, action)

    decision, signals = recomputed(form.field(decide, constants, form.pack_read))(t, state)
    (target, rates, noise), signals, state = form.unpack(decision), form.unpack_read(signals), form.unpack(state)
    moved, forces = _hold(structure, constants, form, t, period, state, target)
    model = Model(*form.unpack_each(constants))
    memory = jax.tree.map(lambda x, rate: x + period * rate, state.memory, rates)
    devices = sense(structure, model, period, state.devices, forces, noise)._replace(torque=moved.torque)
    # The multipliers of the first integration stage are computed anyway; those of ``decide`` then need not be.
    force_error = minus(forces, desired_force(model.reference, structure.rows))
    signals = signals._replace(constraint_force=forces, force_error=force_error)
    return form.pack(State(moved.position, moved.velocity, memory, devices)), form.pack_read(signals)


def _measure(
    structure: Structure, model: Model, sample: Scalar, truth: partitioning.Kinematics, state: State
) -> tuple[partitioning.Kinematics, Vector, Noise | None]:
    """What the controller takes the robots' state for, and the sample's noise."""
    noise = draw_noise(structure, model, sample) if "noise" in structure.features else None
    if noise is None and "surface_motion" not in structure.features:
        return truth, state.velocity, None
    position, independent = state.position, state.velocity
    if noise is not None:
        position = tuple(
            robot_kinematics.Position(*plus(p, error)) for p, error in zip(position, noise.position, strict=True)
        )
        independent = plus(independent, noise.velocity)
    return partitioning.kinematics(model, structure.rows, position, independent), independent, noise


def _hold(
    structure: Structure,
    constants: tuple,
    form: Form,
    t: Scalar,
    period: Scalar,
    state: State,
    target: tuple[Vector, Vector],
) -> tuple[_Motion, Vector]:
    """Robots and actuators over one period under a constant torque command; also lambda (m,) at its start."""
    lagging = "actuator_lag" in structure.features

    def field(known: tuple, at: Scalar, x: _Motion) -> tuple[_Motion, Vector]:
        *parts, target = known
        model = Model(*parts)
        k = plant.plant_kinematics(structure, model, at, x.position, x.velocity)
        applied = (tuple(x.torque[:5]), tuple(x.torque[5:])) if lagging else target
        force = tuple(map(robot_kinematics.actuator_force, model.geometry, x.position, applied))
        moved = plant.respond(structure, model, at, k, force)
        torque = torque_rates(model, target, x.torque) if lagging else ()
        return _Motion(plant.rates_without_drift(k), moved.independent, torque), moved.multipliers

    start = _Motion(state.position, state.velocity, state.devices.torque)
    held = form.field(field, (*constants, form.pack(target)))
    end, forces = rk4_hold(held, t, period / structure.substeps, structure.substeps, form.pack(start))
    return form.unpack(end), form.unpack(forces)


def sense(
    structure: Structure, model: Model, period: Scalar, devices: Devices, forces: Vector, noise: Noise | None
) -> Devices:
    """The force sensor at the next sample: noise, delay line, then the exact first-order lag over one period.

    Args:
        period: control period [s]. forces: lambda (m,) at this sample [N].
    """
    if ideal_sensing(structure):
        return devices
    arriving = forces if noise is None else plus(forces, noise.force)
    late = devices.late_forces
    # The sample just taken is itself seen one sample later, so a delay of one needs no line.
    if late:
        arriving, late = late[0], (*late[1:], arriving)
    shown = arriving
    if "force_lag" in structure.features:
        keep = jnp.exp(-period / model.hardware.force_lag)
        shown = tuple(keep * old + (1.0 - keep) * new for old, new in zip(devices.force, arriving, strict=True))
    return devices._replace(force=shown, late_forces=late)


def initial_devices(structure: Structure, zero: Scalar) -> Devices:
    """Sensors and actuators at rest; ``zero`` is a scalar of the rollout's dtype."""
    force = (zero,) * len(structure.rows)
    waiting = structure.force_delay if "force_lag" in structure.features else structure.force_delay - 1
    return Devices(
        torque=(zero,) * 10 if "actuator_lag" in structure.features else (),
        force=() if ideal_sensing(structure) else force,
        late_forces=(force,) * max(waiting, 0),
    )
