"""Start of a rollout: robots at rest on the constraints."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Pair, Scalar
from coopmm_jax.control.controller import at_rest
from coopmm_jax.loop.devices import initial_devices
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import dependent_solution, partition
from coopmm_jax.mechanics.plant import plant_kinematics
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import Position, arm_moved, chained
from coopmm_jax.parameters import Parameters, Structure

# Newton's steps: from the paper's printed angles six reach 1e-15; the rest is for distant starts.
_NEWTON_STEPS = 25


class Start(NamedTuple):
    """State at t = 0, and how well it meets the constraints."""

    state: State
    residual: Scalar  # the largest |phi| that remains [m]
    determinants: tuple[Scalar, ...]  # of J_dep's blocks


def initial_state(structure: Structure, model: Model, parameters: Parameters) -> Start:
    """Robots at rest on the constraints: Newton's iteration on the dependent joints from ``parameters.start``."""
    n = sum(map(len, partition(structure.rows).independent))
    zero = parameters.plant.gravity * 0.0
    still = (zero,) * n

    def solve(position: Pair[Position]) -> Kinematics:
        return plant_kinematics(structure, model, zero, position, still)

    def newton(position: Pair[Position], _: None) -> tuple[Pair[Position], None]:
        k = solve(position)
        return per_robot(arm_moved, position, dependent_solution(k.reduction, k.reduction.rows.phi)), None

    position, _ = jax.lax.scan(newton, per_robot(chained, parameters.start), None, length=_NEWTON_STEPS)
    reduction = solve(position).reduction
    residual = jnp.abs(reduction.rows.phi[0])
    for phi in reduction.rows.phi[1:]:
        residual = jnp.maximum(residual, jnp.abs(phi))
    controller = at_rest(parameters.gains, n, len(structure.rows), zero)
    state = State(position, still, controller, initial_devices(structure, zero))
    return Start(state, residual, reduction.determinants)
