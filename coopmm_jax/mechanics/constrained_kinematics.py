"""The constrained motion (10) at one state: bodies, constraint rows, the map L, all velocities, Ldot u^1."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, is_zero, plus
from coopmm_jax.algebra.types import Pair, Vector
from coopmm_jax.mechanics import robot_dynamics
from coopmm_jax.mechanics.compliant_contact import Touch
from coopmm_jax.mechanics.constraints import Bodies, bodies, constraint_rows, convective
from coopmm_jax.mechanics.contact_surface import SurfaceMotion
from coopmm_jax.mechanics.coordinates import AnyPosition, LongPosition
from coopmm_jax.mechanics.guide import Guide, in_rows, sideways_rate
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import Reduction, dependent_solution, expand, reduce
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_dynamics import AnyFactors
from coopmm_jax.mechanics.robot_kinematics import AnyPosture, body_map_rate
from coopmm_jax.mechanics.two_axles import FrontMotion, front_motion
from coopmm_jax.parameters import Geometry

NO_GUIDE = Guide()


class Kinematics(NamedTuple):
    """The constrained motion at one state: everything (10) says."""

    bodies: Bodies
    reduction: Reduction
    velocity: Pair[Vector]  # u = L u^1 of each robot (5,)
    factors: Pair[AnyFactors]
    L_rate: Pair[Vector]  # Ldot u^1 of each robot (5,)
    T_rate: Pair[Vector]  # Tdot u of each robot (5,)
    front: Pair[FrontMotion | None] = (None, None)  # of each platform on two axles
    touch: Touch | None = None  # of a compliant contact


def kinematics(
    model: Model,
    rows: tuple[str, ...],
    position: Pair[AnyPosition],
    independent: Vector,
    motion: SurfaceMotion | None = None,
    guide: Guide = NO_GUIDE,
) -> Kinematics:
    """(10) at one state.

    Args:
        model: geometry and gravity.
        rows: names of the constraint rows in force.
        position: of each robot.
        independent: u^1 (n,).
        motion: of the object's surface. It adds to what (10) says: u = L u^1 + c with J c = -dphi/dt.
        guide: of the object, as far as it is not the circle; one that moves adds to (10) likewise.
    """
    surface = model.surface if guide.lift is None else model.surface._replace(guide_height=guide.lift.height)
    b = bodies(surface, model.geometry, position, guide.track)
    joints = per_robot(lambda T: len(T.rows[0]), b.T)
    reduction = reduce(constraint_rows(surface, rows, b, motion), rows, joints)
    velocity = expand(reduction, independent)
    phi_rate, phi_acceleration = _over_time(rows, b, motion, guide)
    if not all(map(is_zero, phi_rate)):
        velocity = per_robot(plus, velocity, dependent_solution(reduction, phi_rate))
    T_rate = per_robot(body_map_rate, model.geometry, position, velocity)
    bias = plus(convective(surface, model.geometry, rows, b, velocity, T_rate), phi_acceleration)

    def factors(geometry: Geometry, arm: AnyPosture, T: Matrix, u: Vector) -> AnyFactors:
        return robot_dynamics.factors(geometry, model.gravity, arm, T @ u)

    each = per_robot(factors, model.geometry, b.arm, b.T, velocity)
    front = per_robot(_front, model.geometry, position, velocity)
    return Kinematics(b, reduction, velocity, each, dependent_solution(reduction, bias), T_rate, front)


def _front(geometry: Geometry, position: AnyPosition, u: Vector) -> FrontMotion | None:
    if geometry.front is None or not isinstance(position, LongPosition):
        return None
    return front_motion(geometry.front, position, u)


def _over_time(rows: tuple[str, ...], b: Bodies, motion: SurfaceMotion | None, guide: Guide) -> tuple[Vector, Vector]:
    """dphi/dt (m,) at fixed robots [m/s], and what their motion leaves out of d2phi/dt2 [m/s^2]."""
    rate, acceleration = {}, {}
    if motion is not None:
        rate["contact_normal"], acceleration["contact_normal"] = b.contact.phi_rates(motion)
    if b.guide is not None:
        rate["guide_radial"] = sideways_rate(b.guide)  # its acceleration is in the row's convective part
    if guide.lift is not None:
        rate["guide_height"], acceleration["guide_height"] = -guide.lift.rate, -guide.lift.acceleration
    return in_rows(rows, rate), in_rows(rows, acceleration)
