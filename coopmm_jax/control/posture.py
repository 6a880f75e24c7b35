"""Desired pitch joints of the arms, where no constraint row decides them."""

from __future__ import annotations

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.path_motion import Known
from coopmm_jax.control.reference import Desired, at_instant
from coopmm_jax.kinds.courses import current
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import Partition
from coopmm_jax.mechanics.robot import YAW, per_robot
from coopmm_jax.mechanics.robot_kinematics import arm_joints
from coopmm_jax.parameters import Geometry


def desired_postures(model: Model, part: Partition, t: Scalar) -> Pair[tuple[Vector, Vector]]:
    """Desired joints after the yaw (k,) of each robot at t [s] and their rates [rad, rad/s], a lift's [m, m/s].

    On circles they hold what meets every reference; along a path they follow the arms' reach and height.
    """
    free = any(joint > YAW for joints in part.independent for joint in joints)
    reference = at_instant(model.reference, t)
    if not free or not isinstance(reference, Known):
        return per_robot(lambda held: (held, (0.0,) * len(held)), model.posture)
    postures, rates = derivatives(lambda t: _along_the_path(model, reference, t), t, 1)
    return per_robot(lambda held, rate: (held, rate), postures, rates)


def _along_the_path(model: Model, known: Known, t: Scalar) -> Pair[Vector]:
    height = current(model.surface.guide_height, t)

    def angles(geometry: Geometry, reach: Scalar, before: Vector) -> Vector:
        return arm_joints(geometry, reach, height - 2.0 * geometry.l1, before)

    reaches = (known.aim.reach.at(t, known.t), known.reference.offset[1])
    return per_robot(angles, model.geometry, reaches, model.posture)


def with_posture(desired: Desired, posture: tuple[Vector, Vector], count: int) -> Desired:
    """Desired motion of one robot whose first ``count`` arm joints are independent.

    Args:
        desired: of its platform and arm yaw.
        posture: desired joints (k,), which follow the yaw, and their rates (k,).
        count: number of independent arm joints.
    """
    held, rate = (entries[: count - 1] for entries in posture)
    return desired._replace(arm=desired.arm + tuple(held), arm_rate=desired.arm_rate + tuple(rate))
