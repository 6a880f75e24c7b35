"""Desired motion along a path at every stage of a rollout, computed at once before the loop.

A path's derivatives take as many operations as half of the dynamics, but they do not depend on the state: side by side
for all instants they cost a tenth of that.
"""

from __future__ import annotations

from typing import Any, cast

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from coopmm_jax.algebra.types import PyTree, Scalar
from coopmm_jax.control.path_motion import Known, aim_at
from coopmm_jax.loop.form import Packed
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import PathReference

_TOGETHER = 64  # instants in one vector loop, whose values stay in the first-level cache


def aims_ahead(reference: PathReference, step: Scalar, segments: int, length: int, dtype: DTypeLike) -> Packed:
    """Aims at the begin, in the middle and at the end of every step, packed: (segments, length, 3, ...).

    Args:
        reference: of the rollout.
        step: its step [s].
        segments: of the rollout.
        length: steps of each.
        dtype: of the rollout.
    """
    count = segments * length
    halves = jnp.arange(-(-(2 * count + 1) // _TOGETHER) * _TOGETHER, dtype=jnp.int32)
    t = (halves // 2).astype(dtype) * step + (halves % 2).astype(dtype) * (0.5 * step)

    def packed(t: jax.Array) -> Packed:
        return jax.vmap(lambda t: Packed.of(aim_at(reference, t), dtype))(t)

    aims = jax.lax.map(packed, t.reshape(-1, _TOGETHER))
    values = aims.values.reshape(len(halves), -1)[: 2 * count + 1]
    stages = jnp.stack([values[:-1:2], values[1::2], values[2::2]], axis=1)
    return Packed(stages.reshape(segments, length, 3, -1), (), aims.layout)


def at_stages(aims: Packed | None) -> PyTree:
    """Aims (4, ...) at the four stages of a Runge-Kutta step, from those of the step (3, ...); None of none."""
    if aims is None:
        return None
    begin, middle, end = jnp.split(aims.values, 3)
    return Packed(jnp.concatenate([begin, middle, middle, end]), aims.arrays, aims.layout)


def at_begin(aims: Packed | None) -> PyTree:
    """Aim at the begin of a step, from those of the step (3, ...); None of none."""
    return None if aims is None else Packed(aims.values[0], aims.arrays, aims.layout)


def informed(model: Model, aim: Any, t: Scalar) -> Model:
    """A model, packed or not, whose reference is known at t [s]; ``aim`` is packed, or None where it is not."""
    return model if aim is None else model._replace(reference=Known(cast(PathReference, model.reference), aim, t))
