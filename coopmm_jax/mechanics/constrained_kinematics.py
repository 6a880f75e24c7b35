"""The constrained motion (10) at one state: bodies, constraint rows, the map L, all velocities, Ldot u^1."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, plus
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics import robot_dynamics
from coopmm_jax.mechanics.compliant_contact import Touch
from coopmm_jax.mechanics.constraints import Bodies, bodies, constraint_rows, convective
from coopmm_jax.mechanics.contact_surface import SurfaceMotion
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import Reduction, dependent_solution, expand, reduce
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_dynamics import Factors
from coopmm_jax.mechanics.robot_kinematics import Position, Posture
from coopmm_jax.parameters import Geometry


class Kinematics(NamedTuple):
    """The constrained motion at one state: everything (10) says."""

    bodies: Bodies
    reduction: Reduction
    velocity: Pair[Vector]  # u = L u^1 of each robot (5,)
    factors: Pair[Factors]
    L_rate: Pair[Vector]  # Ldot u^1 of each robot (5,)
    touch: Touch | None = None  # of a compliant contact


def kinematics(
    model: Model,
    rows: tuple[str, ...],
    position: Pair[Position],
    independent: Vector,
    motion: SurfaceMotion | None = None,
) -> Kinematics:
    """(10) at one state.

    Args:
        model: geometry and gravity.
        rows: names of the constraint rows in force.
        position: of each robot.
        independent: u^1 (n,).
        motion: of the object's surface. It adds to what (10) says: u = L u^1 + c with J c = -dphi/dt.
    """
    b = bodies(model.surface, model.geometry, position)
    reduction = reduce(constraint_rows(model.surface, rows, b, motion), rows)
    velocity = expand(reduction, independent)
    phi_rate, phi_acceleration = (0, 0) if motion is None else b.contact.phi_rates(motion)
    if motion is not None:
        carried = dependent_solution(reduction, _in_normal_row(rows, phi_rate))
        velocity = per_robot(plus, velocity, carried)
    bias = convective(model.surface, model.geometry, rows, b, velocity)
    if motion is not None:
        bias = plus(bias, _in_normal_row(rows, phi_acceleration))

    def factors(geometry: Geometry, arm: Posture, T: Matrix, u: Vector) -> Factors:
        return robot_dynamics.factors(geometry, model.gravity, arm, T @ u)

    each = per_robot(factors, model.geometry, b.arm, b.T, velocity)
    return Kinematics(b, reduction, velocity, each, dependent_solution(reduction, bias))


def _in_normal_row(rows: tuple[str, ...], value: Scalar) -> Vector:
    return tuple(value if name == "contact_normal" else 0 for name in rows)
