"""The quantities a rollout's inner loop reads, derived once from its parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.types import Pair, PyTree, Scalar, Vector
from coopmm_jax.kinds.courses import current
from coopmm_jax.kinds.disturbances import Disturbance
from coopmm_jax.mechanics.randomness import drawn_before
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_dynamics import AnyLumped, lump
from coopmm_jax.mechanics.robot_kinematics import arm_joints
from coopmm_jax.mechanics.units import units_of, with_unit
from coopmm_jax.parameters import (
    Geometry,
    Hardware,
    Parameters,
    PathReference,
    PhaseSchedule,
    Pose,
    Reference,
    Schedule,
    Surface,
)


class Model(NamedTuple):
    """Parameters of one rollout with inertias lumped, so that the loop does not lump them again at every stage."""

    geometry: Pair[Geometry]
    surface: Surface
    gravity: Scalar
    plant: Pair[AnyLumped]
    nominal: Pair[AnyLumped]  # the controller's
    gains: PyTree  # in force: the loop puts those of the schedule here at each instant
    disturbance: tuple[Disturbance, ...]
    reference: Reference | PathReference
    posture: Pair[Vector]  # desired joints of each robot after its yaw, where they are independent [rad], a lift's [m]
    hardware: Hardware
    guide: Any  # Rail, MovingRail or None
    schedule: Schedule | PhaseSchedule | None  # of gains that change


def build_model(parameters: Parameters) -> Model:
    """Lump the inertias of plant and nominal model.

    >>> from coopmm_jax.parameters import Parameters
    >>> build_model(Parameters()).plant[0].Sp
    0.375
    """
    plant, units = parameters.plant, units_of(parameters)
    return Model(
        geometry=per_robot(with_unit, plant.geometry, units),
        surface=plant.surface,
        gravity=plant.gravity,
        plant=per_robot(lump, plant.geometry, plant.inertia),
        nominal=per_robot(lump, plant.geometry, parameters.nominal),
        gains=parameters.gains,
        disturbance=_prepared(parameters),
        reference=parameters.reference._replace(unit=units),
        posture=nominal_posture(parameters),
        hardware=parameters.hardware,
        guide=plant.guide,
        schedule=parameters.schedule,
    )


def _prepared(parameters: Parameters) -> tuple[Disturbance, ...]:
    """Disturbances with what their kinds make once before a rollout, such as the phases of a noise."""
    return tuple(
        each._replace(wave=each.wave.prepared(uniform)) if hasattr(each.wave, "prepared") else each
        for each, uniform in zip(parameters.disturbance, drawn_before(parameters.hardware))
    )


def nominal_posture(parameters: Parameters) -> Pair[Vector]:
    """Joints after the yaw, (a2, a3), of each robot when every reference is met.

    It is what a joint that no row fixes is asked to hold. Joints that no reference needs stay where they start.

    Robot II's arm works over its back (arm yaw pi/2 points at the centre), so its reach is the platform's radius less
    the object's; robot I reaches Rc to the object's arc, and to the middle of another surface what is between its
    platform's radius and the object's. Elbows stay on the side they start on. Beside a path this is the posture in the
    middle of the object, from which ``control/posture.py`` takes the elbows.
    """
    plant, surface, reference = parameters.plant, parameters.plant.surface, parameters.reference
    height = current(surface.guide_height, plant.gravity * 0.0)
    if isinstance(reference, PathReference):
        reaches = reference.offset
    else:
        radius = reference.radius
        to_surface = surface.contact_radius if surface.shape is None else radius[0] - surface.guide_radius
        reaches = (to_surface, radius[1] - surface.guide_radius)

    def angles(g: Geometry, reach: Scalar, start: Pose) -> Vector:
        return arm_joints(g, reach, height - 2.0 * g.l1, start.joints)

    return per_robot(angles, plant.geometry, reaches, parameters.start)
