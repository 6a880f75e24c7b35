"""The paper's law for a system that is certain, (17): nominal model and feedback of sigma, without a robust term.

    acceleration = nudot - K_sigma sigma
    F = M0 (L acceleration + Ldot u^1) + h0                                   (17), feedforward "full"
    F = L (L^T L)^-1 U1, U1 = L^T (the same) as in (18) with U2 = 0           feedforward "projected"

Where the nominal model is right and nothing disturbs, sigmadot = -K_sigma sigma. Its gains are
``kinds.baselines.ModelBased``.
"""

from __future__ import annotations

from coopmm_jax.control import motion
from coopmm_jax.control.controller import Command, Seen
from coopmm_jax.control.filtered_error import FilterState, filtered, force_feedback, start, state_rates
from coopmm_jax.kinds.baselines import ModelBased

__all__ = ["command", "force_feedback", "start"]


def command(gains: ModelBased, seen: Seen, state: FilterState) -> Command:
    """Generalised force of (17) on all joints."""
    now = filtered(gains, seen, state.integral, state.eta)
    force = motion.as_accelerated(seen.structure, seen.model, seen.k, now.acceleration)
    return Command(force, state_rates(now), {"sigma": now.sigma})
