"""Gains that change over time: piecewise linear between knots, constant before the first and after the last.

>>> from coopmm_jax.parameters import Gains, Schedule
>>> ramp = Schedule(times=(0.0, 10.0), values={"k2": (5.0, 7.0)})
>>> float(in_force(Gains(), ramp, 2.5).k2), float(rate("k2", ramp, 2.5))
(5.5, 0.2)
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.parameters import Schedule


def in_force(gains: Any, schedule: Schedule | None, t: Scalar) -> Any:
    """Gains at t [s]: those of the schedule where it has them."""
    if schedule is None:
        return gains
    covered = _covered(schedule.times, t)
    return gains._replace(**{name: _between(covered, knots) for name, knots in schedule.values.items()})


def rate(name: str, schedule: Schedule | None, t: Scalar) -> Any:
    """Time derivative of a gain at t [s], a scalar or a vector (n,), at a knot the mean of both slopes.

    None for a gain that is constant.
    """
    if schedule is None or name not in schedule.values:
        return None
    times, knots = schedule
    t = jnp.asarray(t, jnp.result_type(float))
    return jax.jvp(lambda s: _between(_covered(times, s), knots[name]), (t,), (jnp.ones_like(t),))[1]


def _covered(times: Vector, t: Scalar) -> Vector:
    """Share of each interval between two knots that lies before t (K - 1,)."""
    return tuple(jnp.clip((t - a) / (b - a), 0.0, 1.0) for a, b in pairwise(times))


def _between(covered: Vector, knots: tuple) -> Any:
    """Value, a scalar or a vector (n,), from those at the knots (K,)."""

    def value(first: Scalar, *others: Scalar) -> Scalar:
        steps = (share * (b - a) for share, a, b in zip(covered, (first, *others), others, strict=False))
        return sum(steps, first)

    return jax.tree.map(value, *knots)
