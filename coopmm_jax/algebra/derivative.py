"""Derivatives of functions of one scalar, forward, as many as are asked for.

>>> [float(x) for x in derivatives(lambda x: x**3, 2.0, 2)]
[8.0, 12.0, 12.0]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from coopmm_jax.algebra.later import jax, jnp, np
from coopmm_jax.algebra.types import Scalar


def derivatives(function: Callable[[Scalar], Any], x: Scalar, order: int) -> tuple[Any, ...]:
    """Value and derivatives of a function at a scalar x: f, f', ... up to the one of ``order`` (static).

    >>> [float(x) for x in derivatives(lambda x: (x, 2.0 * x), 1.5, 1)[1]]
    [1.0, 2.0]
    """
    if order == 0:
        return (function(x),)

    def last(x: Scalar) -> tuple[Any, tuple[Any, ...]]:
        *below, value = derivatives(function, x, order - 1)
        return value, tuple(below)

    value, rate, below = jax.jvp(last, (x,), (one_like(x),), has_aux=True)
    return (*below, value, rate)


def one_like(x: Scalar) -> Any:
    """A one of the dtype and shape of a scalar: the direction of a derivative by it.

    A constant, so that JAX knows what of further derivatives vanishes; x * 0 + 1 would have a derivative of its own.
    """
    return np.ones(np.shape(x), jnp.result_type(x))
