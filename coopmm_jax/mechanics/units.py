"""Units of length of the chained forms of platforms on two axles, from the turning radius of the desired motion."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Pair, Scalar
from coopmm_jax.kinds.paths import bent_frame, span
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.parameters import Geometry, LogPolar, Parameters, PathReference, Reference

_PHASES = 64


def units_of(parameters: Parameters) -> Pair[Any]:
    """Unit of length of the chained form of each platform on two axles [m], or its chart; None of others.

    Of a platform that has none given it makes u2 the rate of the steering at a turning radius in the middle of the
    desired motion: wheelbase + rho^2 / wheelbase.
    """

    def unit(geometry: Geometry, rho: Scalar) -> Any:
        front = geometry.front
        if front is not None and front.chart is not None:
            return front.chart
        if front is None or front.unit is not None:
            return None if front is None else front.unit
        return front.wheelbase + rho * rho / front.wheelbase

    if all(geometry.front is None for geometry in parameters.plant.geometry):
        return None, None
    return per_robot(unit, parameters.plant.geometry, mean_radii(parameters.reference))


def mean_radii(reference: Reference | PathReference) -> Pair[Scalar]:
    """Turning radius of each platform's desired motion [m], along a path the mean over its phases."""
    if isinstance(reference, Reference):
        return reference.radius
    phases = jnp.linspace(*span(reference.path), _PHASES, endpoint=False)
    curvatures = jax.vmap(lambda phase: bent_frame(reference.path, phase)[1])(phases)
    return per_robot(lambda offset: jnp.mean(jnp.abs(1.0 / curvatures + offset)), reference.offset)


def with_unit(geometry: Geometry, unit: Any) -> Geometry:
    """Geometry of a robot whose chained form has a unit of length [m], or none; None where it has no front axle."""
    if geometry.front is None or isinstance(unit, LogPolar):
        return geometry
    return geometry._replace(front=geometry.front._replace(unit=unit))
