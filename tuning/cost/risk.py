"""Risk: from the costs of many samples to one number, differentiable.

>>> float(risk("cvar", level=0.5)(jnp.array([1.0, 2.0, 3.0, 4.0])))
3.5
"""

from __future__ import annotations

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.errors import UserError

Risk = Callable[[jax.Array], jax.Array]
KINDS = ("mean", "cvar", "soft_worst", "worst")


def risk(kind: str, level: float = 0.9, sharpness: float = 2.0) -> Risk:
    """A function from costs (N,) to one cost.

    Args:
        kind: mean; cvar, mean of the worst (1 - level) N costs; soft_worst, log(mean(exp(sharpness c))) / sharpness,
            between the mean and the worst; worst.

    Raises:
        UserError: another kind.
    """
    if kind == "mean":
        return jnp.mean
    if kind == "cvar":
        return lambda costs: _cvar(costs, level)
    if kind == "soft_worst":
        return lambda costs: (jax.nn.logsumexp(sharpness * costs) - math.log(costs.shape[0])) / sharpness
    if kind == "worst":
        return jnp.max
    raise UserError("tuning.risk", " or ".join(KINDS), kind)


def weighted(function: Risk, costs: np.ndarray) -> tuple[float, np.ndarray]:
    """The risk of costs (N,), and its derivative by each of them (N,): what each sample's gradient counts."""
    value, weights = jax.value_and_grad(function)(jnp.asarray(costs))
    return float(value), np.asarray(weights)


def tail_shares(samples: int, level: float) -> np.ndarray:
    """Share of each sample in the CVaR, the worst first (N,); the last that counts takes the remainder."""
    shares = np.clip((1.0 - level) * samples - np.arange(samples), 0.0, 1.0)
    return shares / shares.sum()


def _cvar(costs: jax.Array, level: float) -> jax.Array:
    return jnp.dot(-jnp.sort(-costs), jnp.asarray(tail_shares(costs.shape[0], level), costs.dtype))
