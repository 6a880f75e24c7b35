"""Desired pitch joints of the arms, where no constraint row decides them."""

from __future__ import annotations

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.path_motion import Known
from coopmm_jax.control.reference import Desired, at_instant
from coopmm_jax.kinds.courses import current
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import Partition
from coopmm_jax.mechanics.robot import PITCH_JOINTS, per_robot
from coopmm_jax.mechanics.robot_kinematics import arm_angles
from coopmm_jax.parameters import Geometry

_STILL = (0.0,) * len(PITCH_JOINTS)


def desired_postures(model: Model, part: Partition, t: Scalar) -> Pair[tuple[Vector, Vector]]:
    """Desired pitch joints (2,) of each robot at t [s] and their rates [rad, rad/s].

    On circles they hold what meets every reference; along a path they follow the arms' reach and height.
    """
    free = any(joint in PITCH_JOINTS for joints in part.independent for joint in joints)
    reference = at_instant(model.reference, t)
    if not free or not isinstance(reference, Known):
        return per_robot(lambda held: (held, _STILL), model.posture)
    postures, rates = derivatives(lambda t: _along_the_path(model, reference, t), t, 1)
    return per_robot(lambda held, rate: (held, rate), postures, rates)


def _along_the_path(model: Model, known: Known, t: Scalar) -> Pair[Vector]:
    height = current(model.surface.guide_height, t)

    def angles(geometry: Geometry, reach: Scalar, before: Vector) -> Vector:
        return arm_angles(geometry, reach, height - 2.0 * geometry.l1, before[1])

    reaches = (known.aim.reach.at(t, known.t), known.reference.offset[1])
    return per_robot(angles, model.geometry, reaches, model.posture)


def with_posture(desired: Desired, posture: tuple[Vector, Vector], count: int) -> Desired:
    """Desired motion of one robot whose first ``count`` arm joints are independent.

    Args:
        desired: of its platform and arm yaw.
        posture: desired pitch joints (2,) [rad], which follow the yaw, and their rates (2,) [rad/s].
        count: number of independent arm joints.
    """
    held, rate = (entries[: count - 1] for entries in posture)
    return desired._replace(arm=desired.arm + tuple(held), arm_rate=desired.arm_rate + tuple(rate))
