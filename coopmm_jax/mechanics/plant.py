"""The two coupled robots under given actuator torques: (1), (2) and (11) with disturbance, friction, moving surface."""

from __future__ import annotations

from coopmm_jax.algebra.matrix import dot, minus, plus, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.compliant_contact import contact_push, touch
from coopmm_jax.mechanics.constrained_dynamics import Accelerations, constrained_accelerations
from coopmm_jax.mechanics.constrained_kinematics import Kinematics, kinematics
from coopmm_jax.mechanics.contact_surface import surface_motion
from coopmm_jax.mechanics.coordinates import AnyPosition
from coopmm_jax.mechanics.disturbance import disturbing, force_on_joints
from coopmm_jax.mechanics.friction import friction_torque, tip_friction
from coopmm_jax.mechanics.guide import carriage_step, guide_at, needs_carriage, tip_velocity
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import dependent_solution
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import actuator_force, actuator_rates, arm_moved, position_rates
from coopmm_jax.parameters import Geometry, Structure

# Rate [1/s] at which drift of the dependent joints off the constraints decays. RK4 at 1 ms leaves about 1e-12 m a step;
# 10 keeps |phi| below 1e-9 over the paper's run where 1 does not, and is far below 1 / step, so it adds no stiffness.
DRIFT_RATE = 10.0


def plant_kinematics(
    structure: Structure,
    model: Model,
    t: Scalar,
    position: Pair[AnyPosition],
    independent: Vector,
    carriage: Vector = (),
) -> Kinematics:
    """The true constrained motion (10) at t [s], moving surface included.

    Args:
        structure: static choices.
        model: of the plant.
        t: time [s].
        position: of each robot.
        independent: u^1 of the plant (n,).
        carriage: of a rail (1,), a phase of its path; of no rail (0,).
    """
    motion = surface_motion(model.hardware, t) if structure.features.surface_motion else None
    guide = guide_at(structure.rows, model, t, carriage)
    k = kinematics(model, structure.plant_rows, position, independent, motion, guide)
    return k._replace(touch=touch(model.hardware, k.bodies, k.velocity, motion)) if structure.compliant else k


def expected_kinematics(
    structure: Structure,
    model: Model,
    t: Scalar,
    position: Pair[AnyPosition],
    independent: Vector,
    carriage: Vector = (),
) -> Kinematics:
    """As ``plant_kinematics``, for a controller that knows neither how the surface moves nor that it gives way.

    Args:
        structure: static choices.
        model: of the plant.
        t: time [s].
        position: of each robot.
        independent: u^1 (n,).
        carriage: as for the plant.
    """
    guide = guide_at(structure.rows, model, t, carriage)
    return kinematics(model, structure.rows, position, independent, guide=guide)


def respond(structure: Structure, model: Model, t: Scalar, k: Kinematics, force: Pair[Vector]) -> Accelerations:
    """Accelerations and multipliers under a generalised actuator force B tau of each robot (5,), at t [s].

    The multipliers are those of all rows, the force of a compliant contact among them.
    """
    opposing = disturbing(model.disturbance, t, per_robot(len, k.velocity))

    def driving(exerted: Vector, geometry: Geometry, position: AnyPosition, u: Vector, losses: Vector | None) -> Vector:
        if structure.features.friction:
            rubbing = friction_torque(model.hardware, actuator_rates(geometry, position, u))
            losses = rubbing if losses is None else plus(losses, rubbing)
        return exerted if losses is None else minus(exerted, actuator_force(geometry, position, losses))

    torques = opposing.torque or (None, None)
    left = per_robot(driving, force, model.geometry, k.bodies.position, k.velocity, torques)
    if opposing.force is not None:
        left = left[0], plus(left[1], force_on_joints(opposing.force, k))
    friction = tip_friction(model, k) if structure.features.tip_friction else None
    if k.touch is None:
        return constrained_accelerations(model, k, left, friction)
    moved = constrained_accelerations(model, k, per_robot(plus, left, contact_push(k.touch, friction)))
    return moved._replace(multipliers=(k.touch.force, *moved.multipliers))


def rates_without_drift(k: Kinematics) -> Pair[AnyPosition]:
    """Rates of all twelve coordinates; the dependent joints' also work phi off at ``DRIFT_RATE``."""
    correction = dependent_solution(k.reduction, scaled(DRIFT_RATE, k.reduction.rows.phi))
    return per_robot(arm_moved, per_robot(position_rates, k.bodies.position, k.velocity), correction)


def carriage_rate(structure: Structure, model: Model, k: Kinematics) -> Vector:
    """Rate of a rail's carriage (1,), which follows the object; also works off, at ``DRIFT_RATE``, how far it lags."""
    guide = k.bodies.guide
    if guide is None or not needs_carriage(structure.rows, model):
        return ()
    along = dot(guide.tangent, tip_velocity(k.bodies.tip[1], k.bodies.T[1] @ k.velocity[1]))
    return ((1.0 / guide.track.at.stretch) * along + DRIFT_RATE * carriage_step(guide),)
