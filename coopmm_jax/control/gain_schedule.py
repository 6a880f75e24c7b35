"""Gains that change over time or along the path: piecewise linear between knots.

>>> from coopmm_jax.parameters import Parameters
>>> model = Parameters(schedule=Schedule(times=(0.0, 10.0), values={"k2": (5.0, 7.0)}))
>>> float(in_force(model, 2.5).k2), float(rate("k2", model, 2.5))
(5.5, 0.2)
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Protocol

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.control.reference import AnyReference, phase, repeats
from coopmm_jax.parameters import PhaseSchedule, Schedule

TURN = 2.0 * math.pi  # of the phase, after which a closed path repeats itself


class Scheduled(Protocol):
    """Gains, what they change by and the reference whose phase that may be: a ``Model``, or ``Parameters``."""

    @property
    def gains(self) -> Any:
        """Gains of a controller."""
        ...

    @property
    def schedule(self) -> Schedule | PhaseSchedule | None:
        """Values in their place; None where all are constant."""
        ...

    @property
    def reference(self) -> AnyReference:
        """Desired motion."""
        ...


def in_force(model: Scheduled, t: Scalar) -> Any:
    """Gains at t [s]: those of the schedule where it has them."""
    if model.schedule is None:
        return model.gains
    return model.gains._replace(**_values(model.schedule, model.reference, t))


def rate(name: str, model: Scheduled, t: Scalar) -> Any:
    """Time derivative of a gain at t [s], a scalar or a vector (n,), at a knot the mean of both slopes.

    None for a gain that is constant.
    """
    schedule = model.schedule
    if schedule is None or name not in schedule.values:
        return None
    alone = schedule._replace(values={name: schedule.values[name]})
    t = jnp.asarray(t, jnp.result_type(float))
    return jax.jvp(lambda s: _values(alone, model.reference, s)[name], (t,), (jnp.ones_like(t),))[1]


def _values(schedule: Schedule | PhaseSchedule, reference: AnyReference, t: Scalar) -> dict[str, Any]:
    """Gains that change, at t [s]."""
    place, (places, values) = t, schedule
    if isinstance(schedule, PhaseSchedule):
        place = phase(reference, t)
        if repeats(reference):
            place, places, values = _once_round(place, places, values)
    covered = tuple(jnp.clip((place - a) / (b - a), 0.0, 1.0) for a, b in pairwise(places))
    return {name: _between(covered, knots) for name, knots in values.items()}


def _once_round(place: Scalar, places: Vector, values: dict[str, tuple]) -> tuple[Scalar, Vector, dict[str, tuple]]:
    """A phase within the turn that begins at the first knot, and knots (K + 2,) that go on to either side of it."""
    first, last = places[0], places[-1]
    ahead = place - first
    within = first + (ahead - TURN * jnp.floor(ahead / TURN))
    return within, (last - TURN, *places, first + TURN), {name: (k[-1], *k, k[0]) for name, k in values.items()}


def _between(covered: Vector, knots: tuple) -> Any:
    """Value, a scalar or a vector (n,), from those at the knots (K,), and the share of each interval that is behind."""

    def value(first: Scalar, *others: Scalar) -> Scalar:
        steps = (share * (b - a) for share, a, b in zip(covered, (first, *others), others, strict=False))
        return sum(steps, first)

    return jax.tree.map(value, *knots)
