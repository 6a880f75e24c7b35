"""Sensors and actuators between controller and robots: torque limits, lag, force sensor, noise, delay."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import minus, plus, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.coordinates import Position, at_place
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.randomness import stream_key
from coopmm_jax.mechanics.robot import CHAINED, JOINTS, PLATFORM, by_robot, of_each_actuator, per_robot
from coopmm_jax.parameters import Hardware, Structure


class Devices(NamedTuple):
    """States of sensors and actuators; empty where ideal."""

    torque: Vector = ()  # applied torques, robot I's five then robot II's, behind their lag [N m]
    force: Vector = ()  # reading of the force sensor (m,) [N]
    late_forces: jax.Array | None = None  # measured forces on their way (waiting, m), a ring [N]; None: none wait


class Noise(NamedTuple):
    """Measurement errors of one sample."""

    position: Pair[Position]
    velocity: Vector  # (n,)
    force: Vector  # (m,) [N]
    steering: Pair[Scalar | None] = (None, None)  # of front axles [rad]


def torque_limits(hardware: Hardware, count: int = JOINTS) -> Vector:
    """Largest torque of each of one robot's actuators, as many as ``count`` [N m], a lift's [N]."""
    return of_each_actuator(hardware.wheel_limit, hardware.joint_limit, count)


def limited(structure: Structure, hardware: Hardware, torque: Vector) -> Vector:
    """Torques of one robot's actuators (5,) held within their limits [N m].

    ``torque_limits`` clips; ``smooth_limits`` uses x / (1 + (x/limit)^8)^(1/8), within 0.1 % of x up to half the limit
    and never beyond it, whose gradient does not vanish at once.
    """
    limits = torque_limits(hardware, len(torque))
    if structure.features.smooth_limits:
        return tuple(_smoothly(x, limit) for x, limit in zip(torque, limits, strict=True))
    if structure.features.torque_limits:
        return tuple(jnp.clip(x, -limit, limit) for x, limit in zip(torque, limits, strict=True))
    return torque


def _smoothly(x: Scalar, limit: Scalar) -> Scalar:
    # Written around the clipped value, so that no power overflows and rounding cannot lift it over the limit.
    ratio = jnp.minimum(jnp.abs(x), limit) / jnp.maximum(jnp.abs(x), limit)
    return jnp.clip(x, -limit, limit) / jnp.sqrt(jnp.sqrt(jnp.sqrt(1.0 + ratio**8)))


def torque_rates(model: Model, target: Pair[Vector], torque: Vector) -> Vector:
    """First-order lag of the actuators (10,) [N m/s]."""
    return scaled(1.0 / model.hardware.actuator_lag, minus((*target[0], *target[1]), torque))


def device_rates(structure: Structure, model: Model, target: Pair[Vector], forces: Vector, devices: Devices) -> Devices:
    """Rates of lagging actuators [N m/s] and of a lagging force sensor [N/s], in continuous time.

    Args:
        structure: static choices.
        model: time constants.
        target: torques (5,) that each robot's actuators go to [N m].
        forces: lambda (m,) [N].
        devices: where they stand.
    """
    torque, shown = (), ()
    if structure.features.actuator_lag:
        torque = torque_rates(model, target, devices.torque)
    if structure.features.force_lag:
        shown = scaled(1.0 / model.hardware.force_lag, minus(forces, devices.force))
    return Devices(torque, shown)


def ideal_sensing(structure: Structure) -> bool:
    """True if the controller sees the force that its own torque causes, in the same instant."""
    return not structure.features.force_lag and structure.force_delay == 0


def biased(structure: Structure, model: Model, force: Vector) -> Vector:
    """A measured constraint force (m,) with the sensor's bias [N]."""
    if not structure.features.force_bias:
        return force
    return tuple(x + model.hardware.force_bias for x in force)


def draw_noise(structure: Structure, model: Model, sample: Scalar) -> Noise:
    """Gaussian errors of one sample; ``sample`` is its number, a scalar.

    The key is folded from seed, stream and sample number, so a rollout's noise does not depend on the batch it is in.
    """
    hardware, n = model.hardware, sum(structure.joints) - len(structure.rows)
    key = stream_key(hardware)
    each = per_robot(lambda joints: joints - PLATFORM + CHAINED, structure.joints)
    coordinates = sum(each)
    steered = [geometry.front is not None for geometry in model.geometry]
    others = coordinates + n + len(structure.rows)
    count = others + sum(steered)
    values = jax.random.normal(jax.random.fold_in(key, sample), (count,), jnp.result_type(hardware.noise_stream))
    values = [values[i] for i in range(count)]
    encoders = [hardware.encoder_noise * x for x in values[:coordinates]]
    further = iter(values[others:])
    return Noise(
        per_robot(lambda own: at_place(own[:CHAINED], own[CHAINED:]), by_robot(encoders, each[0])),
        tuple(hardware.velocity_noise * x for x in values[coordinates : coordinates + n]),
        tuple(hardware.force_noise * x for x in values[coordinates + n : others]),
        per_robot(lambda steers: hardware.encoder_noise * next(further) if steers else None, steered),
    )


def sense(
    structure: Structure,
    model: Model,
    sample: Scalar,
    period: Scalar,
    devices: Devices,
    forces: Vector,
    noise: Noise | None,
) -> Devices:
    """The force sensor at the next sample: noise, delay line, then the exact first-order lag over one period.

    Args:
        structure: static choices.
        model: time constant of the sensor.
        sample: number of this sample.
        period: control period [s].
        devices: at this sample.
        forces: lambda (m,) at this sample [N].
        noise: of this sample, if there is any.
    """
    if ideal_sensing(structure):
        return devices
    arriving = forces if noise is None else plus(forces, noise.force)
    late = devices.late_forces
    # The sample just taken is itself seen one sample later, so a delay of one needs no line.
    if late is not None:
        place = sample % len(late)  # of the oldest, which the newest replaces: no delay makes a program longer
        oldest = jax.lax.dynamic_index_in_dim(late, place, keepdims=False)
        late = jax.lax.dynamic_update_index_in_dim(late, jnp.stack(arriving), place, 0)
        arriving = tuple(oldest[i] for i in range(len(forces)))
    shown = arriving
    if structure.features.force_lag:
        keep = jnp.exp(-period / model.hardware.force_lag)
        shown = tuple(keep * old + (1.0 - keep) * new for old, new in zip(devices.force, arriving, strict=True))
    return devices._replace(force=shown, late_forces=late)


def initial_devices(structure: Structure, zero: Scalar) -> Devices:
    """Sensors and actuators at rest; ``zero`` is a scalar of the rollout's dtype."""
    rows = len(structure.rows)
    waiting = structure.force_delay if structure.features.force_lag else structure.force_delay - 1
    return Devices(
        torque=(zero,) * sum(structure.joints) if structure.features.actuator_lag else (),
        force=() if ideal_sensing(structure) else (zero,) * rows,
        late_forces=jnp.zeros((waiting, rows), jnp.result_type(zero)) if waiting > 0 else None,
    )
