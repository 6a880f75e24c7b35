"""Desired motion along a path at the stages of many steps, computed at once before they are taken.

A path's derivatives take as many operations as a quarter of the loop, but they do not depend on the state: side by side
for many instants they cost a tenth of that. Not for all of a rollout at once, as fetching fresh memory for them takes
longer than computing them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from coopmm_jax.algebra.types import PyTree, Scalar
from coopmm_jax.control.path_motion import Known, aim_at
from coopmm_jax.loop.form import Packed
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import PathReference

_EVENLY = 8  # instants that a vector instruction of any machine takes at once
Ahead = Callable[[jax.Array, int], Packed]  # (first step, number of steps) -> aims, packed: (steps, instants, ...)


def aims_ahead(reference: PathReference, step: Scalar, dtype: DTypeLike, sampled: bool) -> Ahead:
    """Function that gives the aims of some steps: at the begin, in the middle and at the end of each of them.

    Args:
        reference: of the rollout.
        step: its step [s].
        dtype: of the rollout.
        sampled: at the begin alone, as nothing else is asked of a path then; static.
    """

    def at_instants(halves: jax.Array) -> Packed:
        """Aims (n, ...) at instants (n,), numbered by half steps."""
        t = (halves // 2).astype(dtype) * step + (halves % 2).astype(dtype) * (0.5 * step)
        return jax.vmap(lambda t: Packed.of(aim_at(reference, t), dtype))(t)

    def aims(first: jax.Array, steps: int) -> Packed:
        if sampled:
            begins = at_instants(2 * (first + jnp.arange(steps, dtype=jnp.int32)))
            return Packed(begins.values[:, None], (), begins.layout)
        count = 2 * steps + 1
        found = at_instants(2 * first + jnp.arange(-(-count // _EVENLY) * _EVENLY, dtype=jnp.int32))
        values = found.values[:count]
        return Packed(jnp.stack([values[:-1:2], values[1::2], values[2::2]], axis=1), (), found.layout)

    return aims


def at_begin(aims: Packed | None) -> PyTree:
    """Aim at the begin of a step, from those of the step (instants, ...); None of none."""
    return None if aims is None else Packed(aims.values[0], aims.arrays, aims.layout)


def informed(model: Model, aim: Any, t: Scalar) -> Model:
    """A model, packed or not, whose reference is known at t [s]; ``aim`` is packed, or None where it is not."""
    return model if aim is None else model._replace(reference=Known(cast(PathReference, model.reference), aim, t))
