"""Fixed-step RK4 in a ``lax.scan``: the innermost loop of everything here.

The four stages are an inner scan of their own, so the vector field is compiled once instead of four times: half the
compile time at the same speed. Gradients through long horizons use nested checkpoints: a scan of scans that keeps the
state at every segment's start and recomputes inside, a few MB instead of gigabytes.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import PyTree, Scalar

# Nodes and weights of the classical Runge-Kutta method; each stage starts from the slope of the one before.
_NODES = (0.0, 0.5, 0.5, 1.0)
_WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_PLACES = (0, 1, 1, 2)  # of each stage among begin, middle and end of a step
_TOGETHER = 64  # steps for which something is prepared at once, so that it stays in the first-level cache


def rk4_step(field: Callable, t: Scalar, step: Scalar, state: PyTree, known: PyTree = None) -> tuple[PyTree, PyTree]:
    """One classical Runge-Kutta step.

    Args:
        field: (t, state) -> (rates, signals), or (t, state, given) where something is given at each stage.
        t: time, scalar [s].
        step: scalar [s].
        state: pytree of scalars.
        known: pytree of arrays (3, ...), of what is given at begin, middle and end of the step; None: nothing is.

    Returns:
        State at t + step, and signals at t: those of the first stage, so they cost nothing.

    >>> round(float(rk4_step(lambda t, x: (-x, x), 0.0, 0.1, jnp.float32(1.0))[0]), 6)
    0.904838
    """

    def stage(carry: tuple, entries: tuple) -> tuple:
        slope, total = carry
        node, weight, *place = entries
        given = [_entry(known, i) for i in place]
        rates, signals = field(t + node * step, jax.tree.map(lambda x, k: x + node * step * k, state, slope), *given)
        return (rates, jax.tree.map(lambda x, k: x + weight * step * k, total, rates)), signals

    dtype = jnp.result_type(*jax.tree.leaves(state))
    table = (jnp.asarray(_NODES, dtype), jnp.asarray(_WEIGHTS, dtype))
    if known is not None:
        table = (*table, jnp.asarray(_PLACES, jnp.int32))
    # Of a batch as soon as the state is: with constants JAX would trace the stages of a batch twice to find that out.
    zero = jax.tree.map(lambda x: 0.0 * x, state)
    (_, total), signals = jax.lax.scan(recomputed(stage), (zero, state), table)
    return total, jax.tree.map(lambda s: s[0], signals)


def _entry(arrays: PyTree, i: jax.Array) -> PyTree:
    """Entry i of arrays (n, ...)."""
    return jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, i, keepdims=False), arrays)


def recomputed(function: Callable) -> Callable:
    """``function``, whose intermediate values the reverse pass computes again instead of keeping.

    The right-hand side has some 3000 of them: writing and reading those costs ten times what computing them does.
    Inside a scan nothing can be merged across the boundary, so XLA need not be kept from trying (``prevent_cse``). No
    effect without ``jax.grad``.
    """
    return jax.checkpoint(function, prevent_cse=False)


def rk4_hold(field: Callable, t: Scalar, step: Scalar, count: int, state: PyTree) -> tuple[PyTree, PyTree]:
    """State after ``count`` (static) Runge-Kutta steps from t [s], and the signals at t."""
    if count == 1:
        return rk4_step(field, t, step, state)

    def advance(state: PyTree, i: jax.Array) -> tuple[PyTree, PyTree]:
        return rk4_step(field, t + i.astype(jnp.result_type(step)) * step, step, state)

    state, signals = jax.lax.scan(advance, state, jnp.arange(count, dtype=jnp.int32))
    return state, jax.tree.map(lambda s: s[0], signals)


def scan_segments(
    advance: Callable, carry: PyTree, segments: int, length: int, checkpoint: bool, ahead: Callable | None = None
) -> tuple[PyTree, PyTree, PyTree]:
    """Run ``advance`` segments * length times, and keep what the first step of each segment reports.

    Args:
        advance: (carry, i) -> (carry, (report, kept)) for step i; (carry, i, given) where something is given for each
            step. Where it is, ``advance`` may be called for some steps more.
        carry: at the start.
        segments: number of segments.
        length: steps of each.
        checkpoint: recompute segments in the reverse pass instead of keeping every step's intermediate values; pays
            off only under ``jax.grad``.
        ahead: (i, n) -> pytree of arrays (n, ...): what is given for n steps from step i on.

    Returns:
        Last carry, the reports stacked along a leading axis of ``segments``, and what is kept of every step along one
        of segments * length.
    """

    def one(carry: PyTree, entries: tuple) -> tuple[PyTree, PyTree]:
        return advance(carry, *entries)

    def segment(carry: PyTree, entries: tuple) -> tuple[PyTree, PyTree]:
        start, *within = entries
        carry, (reports, kept) = jax.lax.scan(one, carry, (start + jnp.arange(length, dtype=jnp.int32), *within))
        return carry, (jax.tree.map(lambda x: x[0], reports), kept)

    body = recomputed(segment) if checkpoint else segment
    if ahead is None:
        carry, (reports, kept) = jax.lax.scan(body, carry, (length * jnp.arange(segments, dtype=jnp.int32),))
        return carry, reports, jax.tree.map(_joined, kept)
    together = min(segments, max(1, _TOGETHER // length))

    def block(carry: PyTree, start: jax.Array) -> tuple[PyTree, PyTree]:
        given = jax.tree.map(lambda x: x.reshape(together, length, *x.shape[1:]), ahead(start, together * length))
        return jax.lax.scan(body, carry, (start + length * jnp.arange(together, dtype=jnp.int32), given))

    blocks = -(-segments // together)
    carry, found = jax.lax.scan(block, carry, together * length * jnp.arange(blocks, dtype=jnp.int32))
    reports, kept = jax.tree.map(lambda x: _joined(x)[:segments], found)
    return carry, reports, jax.tree.map(_joined, kept)


def _joined(x: jax.Array) -> jax.Array:
    """(a, b, ...) as (a * b, ...)."""
    return x.reshape(-1, *x.shape[2:])
