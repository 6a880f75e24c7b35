"""Random numbers of a rollout, from its seed and stream alone: the same bits in any batch."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Vector
from coopmm_jax.kinds.disturbances import Uniform
from coopmm_jax.parameters import Hardware

_BEFORE = 2**31  # what is drawn once before a rollout; samples have the numbers below


def stream_key(hardware: Hardware) -> jax.Array:
    """Key of a rollout's seed and stream, a scalar."""
    upper, lower, stream = (jnp.asarray(x).astype(jnp.uint32) for x in (*hardware.noise_seed, hardware.noise_stream))
    return jax.random.fold_in(jax.random.key((upper << 16) | lower), stream)


def drawn_before(hardware: Hardware) -> Iterator[Uniform]:
    """Sources of uniform random numbers in (0, 1) for what is drawn once before a rollout, each with its own."""
    number = 0
    while True:
        yield _source(hardware, number)
        number += 1


def _source(hardware: Hardware, number: int) -> Uniform:
    def uniform(count: int) -> Vector:
        key = jax.random.fold_in(jax.random.fold_in(stream_key(hardware), _BEFORE), number)
        values = jax.random.uniform(key, (count,), jnp.result_type(float))
        return tuple(values[i] for i in range(count))

    return uniform
