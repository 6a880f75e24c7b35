"""Start of a rollout: robots at rest on the constraints."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import plus
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.control.controller import Freedom
from coopmm_jax.control.reference import desired_force
from coopmm_jax.control.standing import standing_start
from coopmm_jax.loop.devices import initial_devices
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.compliant_contact import pressed_in
from coopmm_jax.mechanics.guide import carriage_step, first_phase, needs_carriage
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import dependent_solution, partition
from coopmm_jax.mechanics.plant import plant_kinematics
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import arm_moved
from coopmm_jax.parameters import Parameters, Structure

# Newton's steps: from the paper's printed angles six reach 1e-15; the rest is for distant starts.
_NEWTON_STEPS = 25


class Start(NamedTuple):
    """State at t = 0, and how well it meets the constraints."""

    state: State
    residual: Scalar  # the largest |phi| that remains [m]
    determinants: tuple[Scalar, ...]  # of J_dep's blocks
    facing: Scalar  # positive where tip I is on the object's surface, not on its circle's far half


def initial_state(structure: Structure, model: Model, parameters: Parameters) -> Start:
    """Robots at rest on the constraints, by Newton's iteration on the dependent joints and a rail's carriage."""
    zero = parameters.plant.gravity * 0.0
    part = partition(structure.rows, structure.joints)
    still = (0,) * sum(map(len, part.independent))
    rigid = structure._replace(contact="rigid")
    pressed = _pressed_in(structure, model, zero)

    def newton(carry: tuple, _: None) -> tuple[tuple, None]:
        at, _ = carry
        position, carriage = at
        k = plant_kinematics(rigid, model, zero, position, still, carriage)
        residual = plus(k.reduction.rows.phi, pressed)
        moved = per_robot(arm_moved, position, dependent_solution(k.reduction, residual))
        largest = functools.reduce(jnp.maximum, map(jnp.abs, residual))
        met = (largest, k.reduction.determinants, k.bodies.contact.facing)
        return ((moved, tuple(s + carriage_step(k.bodies.guide) for s in carriage)), (at, met)), None

    carriage = (zero + first_phase(model.guide, zero),) if needs_carriage(structure.rows, model) else ()
    first = (standing_start(model, parameters, zero), carriage)
    unknown = (zero, (zero,) * sum(map(bool, part.dependent)), zero)
    # The last evaluation is only looked at: what it would move to is dropped.
    (_, found), _ = jax.lax.scan(newton, (first, (first, unknown)), None, length=_NEWTON_STEPS + 1)
    (position, carriage), (residual, determinants, facing) = found
    started = model.gains.start(Freedom.of(structure), zero)
    controller = jax.tree.map(lambda x: jnp.asarray(x, jnp.result_type(zero)), started)
    velocity = (zero,) * sum(map(len, partition(structure.plant_rows, structure.joints).independent))
    state = State(position, velocity, controller, initial_devices(structure, zero), carriage)
    return Start(state, residual, determinants, facing)


def _pressed_in(structure: Structure, model: Model, zero: Scalar) -> Vector:
    """Depth of each row (m,) [m] at which the desired force holds a compliant contact; a constraint has none."""
    if not structure.compliant:
        return (0,) * len(structure.rows)
    desired = desired_force(model.reference, structure.rows, zero)[0]
    return (pressed_in(model.hardware, desired), *(0,) * (len(structure.rows) - 1))
