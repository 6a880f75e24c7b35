"""Sliding mode control with a boundary layer, on the surface sigma = 0 below (15).

    acceleration = nudot - K_sigma sigma - K_switch tanh(sigma / layer), entry by entry
    F as of ``model_based``

With the nominal model right it is W. Gao and J. C. Hung's reaching law with constant and proportional rate, "Variable
structure control of nonlinear systems: a new approach", IEEE Trans. Industrial Electronics 40 (1993); the layer is that
of J.-J. Slotine and W. Li, Applied Nonlinear Control (1991), section 7.2, with tanh for their saturation so that
gradients exist. Its gains are ``kinds.baselines.SlidingMode``.
"""

from __future__ import annotations

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.control import motion
from coopmm_jax.control.controller import Command, Seen
from coopmm_jax.control.filtered_error import FilterState, filtered, force_feedback, start, state_rates
from coopmm_jax.kinds.baselines import SlidingMode

__all__ = ["command", "force_feedback", "start"]


def command(gains: SlidingMode, seen: Seen, state: FilterState) -> Command:
    """Generalised force F on all joints that drives sigma into its boundary layer."""
    now = filtered(gains, seen, state.integral, state.eta)
    switching = tuple(K * jnp.tanh(s / gains.layer) for K, s in zip(gains.K_switch, now.sigma, strict=True))
    force = motion.as_accelerated(seen.structure, seen.model, seen.k, minus(now.acceleration, switching))
    return Command(force, state_rates(now), {"sigma": now.sigma, "switching": switching})
