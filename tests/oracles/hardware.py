"""Friction and the moving surface of the real loop, on arrays and from the bodies' positions.

Both robots together: q (2, 6), u (10,) = robot I's u followed by robot II's, actuator torques (2, 5).

>>> import numpy as np
>>> from coopmm_jax.parameters import Hardware
>>> friction_torque(Hardware(wheel_viscous=2.0, joint_coulomb=3.0), np.full((2, 5), 4.0)).round(3)[0].tolist()
[8.0, 8.0, 3.0, 3.0, 3.0]
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.kinds.disturbances import Disturbance, Sine
from coopmm_jax.mechanics.surfaces import Shape
from coopmm_jax.parameters import Hardware, Parameters, Plant
from tests.oracles import lagrangian


def _per_actuator(wheel: Scalar, joint: Scalar) -> jax.Array:
    return jnp.array([wheel, wheel, joint, joint, joint])


def _fading_sign(x: jax.Array, width: Scalar) -> jax.Array:
    return jnp.sin(jnp.arctan(x / width))


def friction_torque(hardware: Hardware, rates: jax.Array) -> jax.Array:
    """Viscous and Coulomb friction [N m] at the actuators' rates (..., 5) [rad/s]."""
    viscous = _per_actuator(hardware.wheel_viscous, hardware.joint_viscous)
    coulomb = _per_actuator(hardware.wheel_coulomb, hardware.joint_coulomb)
    return viscous * rates + coulomb * _fading_sign(rates, hardware.friction_speed)


def strength(disturbance: Disturbance, t: Scalar) -> jax.Array:
    """Scale times the value of a sine, or of a step that has risen, a scalar [-]."""
    if isinstance(disturbance.wave, Sine):
        return disturbance.scale * jnp.sin(disturbance.wave.frequency * t + disturbance.wave.phase)
    return disturbance.scale * jnp.where(t > disturbance.wave.start + disturbance.wave.edge, 1.0, 0.0)


def _of_both_robots(amplitude: Scalar | tuple | None) -> jax.Array | None:
    if amplitude is None:
        return None
    return jnp.stack(amplitude) if isinstance(amplitude, tuple) else jnp.stack([amplitude, amplitude])


def disturbance_torque(disturbance: Disturbance, t: Scalar) -> jax.Array:
    """Torques that oppose the actuators of both robots (2, 5) [N m]."""
    wheel, joint, *own = map(_of_both_robots, disturbance[2:9])
    actuators = (wheel, wheel, joint, joint, joint)
    amplitudes = [x if single is None else single for x, single in zip(actuators, own, strict=True)]
    return strength(disturbance, t) * jnp.stack(amplitudes, axis=1)


def force_on_object(parameters: Parameters, t: Scalar, q: jax.Array) -> jax.Array:
    """Generalised force (10,) of the disturbances' forces on the object, which act at tip II in the world."""
    forces = [strength(each, t) * jnp.stack(each.force) for each in parameters.disturbance if each.force is not None]
    if not forces:
        return jnp.zeros(10)
    tip = jax.jacobian(lambda q: lagrangian.bodies(parameters.plant.geometry[1], q).tip)(q[1])
    return jnp.concatenate([jnp.zeros(5), (tip @ lagrangian.chained_basis(q[1])).T @ sum(forces)])


class Moved(NamedTuple):
    """A surface that has given way by ``shift`` [m]."""

    shape: Shape
    shift: Scalar

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        return self.shape.level(e, n) + self.shift


def surface_shift(hardware: Hardware, t: Scalar) -> jax.Array:
    """Distance by which the surface has given way [m]."""
    return hardware.surface_amplitude * jnp.sin(hardware.surface_frequency * t + hardware.surface_phase)


def plant_now(plant: Plant, hardware: Hardware, t: Scalar) -> Plant:
    """Plant with its surface where it is at t [s]; an arc's row sees the motion in its rates alone."""
    if plant.surface.shape is None:
        return plant
    shift = float(surface_shift(hardware, t))
    return plant._replace(surface=plant.surface._replace(shape=Moved(plant.surface.shape, shift)))


@jax.jit
def sliding_speed(plant: Plant, q: jax.Array, u: jax.Array) -> jax.Array:
    """Speed of tip I against the object's surface, which turns with arm II, along the arc [m/s].

    Times (distance from the arc's centre) / Rc, as the normal row's gradient is.
    """

    def tip(geometry: object, q: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(lambda q: lagrangian.bodies(geometry, q).tip[:2], (q,), (lagrangian.chained_basis(q) @ u,))

    (p1, v1), (p2, v2) = map(tip, plant.geometry, q, u.reshape(2, 5))
    yaw = q[1, 2] + q[1, 3]
    if plant.surface.shape is None:
        outward = -jax.grad(lambda p: lagrangian.normal_residual(plant.surface, p - p2, yaw))(p1)
    else:
        gradient = jax.grad(lambda p: lagrangian.level(plant.surface.shape, p - p2, yaw))(p1)
        outward = -gradient / jnp.linalg.norm(gradient)
    quarter = jnp.array([[0.0, -1.0], [1.0, 0.0]])
    against_surface = v1 - v2 - (u[5] + u[7]) * quarter @ (p1 - p2)
    return against_surface @ quarter @ outward


def tip_friction(plant: Plant, hardware: Hardware, q: jax.Array, u: jax.Array, normal: Scalar) -> jax.Array:
    """Generalised force (10,) of Coulomb friction under the normal force lambda_n [N]."""
    speed, row = sliding_row(plant, q, u)
    return -hardware.tip_friction * jnp.abs(normal) * _fading_sign(speed, hardware.slip_speed) * row


@jax.jit
def surface_rates(plant: Plant, hardware: Hardware, t: Scalar, q: jax.Array) -> tuple[jax.Array, jax.Array]:
    """First and second partial time derivative of the normal row's phi [m/s, m/s^2]."""
    p1, p2 = (lagrangian.bodies(geometry, q_i).tip[:2] for geometry, q_i in zip(plant.geometry, q, strict=True))

    def phi(t: Scalar) -> jax.Array:
        shift = surface_shift(hardware, t)
        if plant.surface.shape is None:
            return (plant.surface.contact_radius + shift) ** 2 / (2 * plant.surface.contact_radius)
        gradient = jax.grad(lambda p: lagrangian.level(plant.surface.shape, p - p2, q[1, 2] + q[1, 3]))(p1)
        return shift / jnp.linalg.norm(gradient)

    rate = jax.grad(phi)
    return rate(t), jax.grad(rate)(t)


@jax.jit
def surface_acceleration(plant: Plant, hardware: Hardware, t: Scalar, q: jax.Array, u: jax.Array) -> jax.Array:
    """Share of the surface's motion in d2phi/dt2 of the normal row [m/s^2]: phi_tt + 2 phi_tq qdot."""
    q_dot = jnp.stack([lagrangian.chained_basis(q_i) @ u_i for q_i, u_i in zip(q, u.reshape(2, 5), strict=True)])
    _, mixed = jax.jvp(lambda q: surface_rates(plant, hardware, t, q)[0], (jnp.asarray(q),), (q_dot,))
    return surface_rates(plant, hardware, t, q)[1] + 2.0 * mixed


@jax.jit
def driving_force(
    parameters: Parameters, t: Scalar, q: jax.Array, u: jax.Array, torque: jax.Array, normal: Scalar
) -> jax.Array:
    """Generalised force (10,) of actuators, disturbance and all friction; constraint forces and gravity left out."""
    plant, hardware = parameters.plant, parameters.hardware
    force = []
    for geometry, q_i, u_i, torque_i in zip(plant.geometry, q, u.reshape(2, 5), torque, strict=True):
        B = lagrangian.input_matrix(geometry, q_i)
        losses = sum(disturbance_torque(each, t)[len(force)] for each in parameters.disturbance)
        force.append(B @ (torque_i - losses - friction_torque(hardware, B.T @ u_i)))
    rubbing = tip_friction(plant, hardware, q, u, normal)
    return jnp.concatenate(force) + rubbing + force_on_object(parameters, t, q)


@jax.jit
def power(
    parameters: Parameters, t: Scalar, q: jax.Array, u: jax.Array, torque: jax.Array, normal: Scalar
) -> jax.Array:
    """Power into the robots' energy [W]: besides the driving force only the moving surface, -lambda_n dphi/dt."""
    rate, _ = surface_rates(parameters.plant, parameters.hardware, t, q)
    return driving_force(parameters, t, q, u, torque, normal) @ u - normal * rate


@jax.jit
def energy(plant: Plant, q: jax.Array, u: jax.Array) -> jax.Array:
    """Kinetic and potential energy of both robots and the object [J]."""
    terms = zip(plant.geometry, plant.inertia, q, u.reshape(2, 5), strict=True)
    return sum(lagrangian.energy(geometry, inertia, plant.gravity, q_i, u_i) for geometry, inertia, q_i, u_i in terms)


@jax.jit
def energy_rate(plant: Plant, q: jax.Array, u: jax.Array, u_dot: jax.Array) -> jax.Array:
    """Rate of ``energy`` [W] of robots that move with u (10,) and udot (10,)."""
    q_dot = jnp.stack([lagrangian.chained_basis(q_i) @ u_i for q_i, u_i in zip(q, u.reshape(2, 5), strict=True)])
    return jax.jvp(lambda q, u: energy(plant, q, u), (q, u), (q_dot, u_dot))[1]


@jax.jit
def sliding_row(plant: Plant, q: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Speed of tip I along the surface [m/s], and its derivatives by u (10,)."""
    return jax.value_and_grad(lambda u: sliding_speed(plant, q, u))(u)


def constraint_residual(
    parameters: Parameters,
    rows: tuple[str, ...],
    t: float,
    q: np.ndarray,
    u: np.ndarray,
    torque: np.ndarray,
    lam: np.ndarray,
) -> np.ndarray:
    """d2phi/dt2 (m,) [m/s^2] under applied torques (2, 5) and multipliers (m,): zero if they belong together."""
    terms = lagrangian.coupled_terms(parameters.plant, rows, q, u)
    force = np.asarray(driving_force(parameters, t, q, u, torque, lam[0])) + terms.J.T @ lam
    acceleration = terms.J @ np.linalg.solve(terms.M, force - terms.h) + terms.J_dot_u
    acceleration[0] += float(surface_rates(parameters.plant, parameters.hardware, t, q)[1])
    return acceleration
