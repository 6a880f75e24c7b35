"""The quantities a rollout's inner loop reads, derived once from its parameters."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax import robot
from coopmm_jax.components import Scalar
from coopmm_jax.parameters import Disturbance, Gains, Geometry, Parameters, Reference, Surface


class Model(NamedTuple):
    """Parameters of one rollout with inertias lumped, so that the loop does not lump them again at every stage."""

    geometry: tuple[Geometry, Geometry]
    surface: Surface
    gravity: Scalar
    plant: tuple[robot.Lumped, robot.Lumped]
    nominal: tuple[robot.Lumped, robot.Lumped]  # the controller's
    gains: Gains
    disturbance: Disturbance
    reference: Reference


def build_model(parameters: Parameters) -> Model:
    """Lump the inertias of plant and nominal model.

    >>> from coopmm_jax.parameters import Parameters
    >>> build_model(Parameters()).plant[0].Sp
    0.375
    """
    plant = parameters.plant
    return Model(
        geometry=plant.geometry,
        surface=plant.surface,
        gravity=plant.gravity,
        plant=tuple(map(robot.lump, plant.geometry, plant.inertia)),
        nominal=tuple(map(robot.lump, plant.geometry, parameters.nominal)),
        gains=parameters.gains,
        disturbance=parameters.disturbance,
        reference=parameters.reference,
    )
