"""Judging a rollout while it runs: it stops before anything overflows."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Bool, Scalar
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.status import CONTROLLER_LIMIT, SINGULAR_FRACTION, SPEED_LIMIT, Status


class Health(NamedTuple):
    """Status code of a running rollout and the step at which it left OK."""

    status: jax.Array
    step: jax.Array


def within(values: tuple[Scalar, ...], limit: float) -> Bool:
    """True if all scalars are finite and within +-limit (a comparison with NaN is false)."""
    return functools.reduce(lambda ok, value: ok & (jnp.abs(value) < limit), values, True)


def judge(proposed: State, signals: Signals, start_determinants: tuple[Scalar, ...]) -> jax.Array:
    """Status code (a scalar) of one step from the state it proposes and the signals at its start."""
    states = tuple(jax.tree.leaves(proposed.controller))
    code = jnp.where(within(states, CONTROLLER_LIMIT), Status.OK.value, Status.CONTROLLER.value)
    code = jnp.where(within(proposed.velocity, SPEED_LIMIT), code, Status.SPEED.value)
    singular = (Status.SINGULAR_CONTACT.value, Status.SINGULAR_GUIDE.value)
    for now, start, which in zip(signals.determinants, start_determinants, singular, strict=False):
        code = jnp.where(now / start > SINGULAR_FRACTION, code, which)
    return code.astype(jnp.int32)
