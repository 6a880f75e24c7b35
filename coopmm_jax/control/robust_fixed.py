"""The paper's law (18) with bounds of the uncertainty that are given, in the place of estimates that adapt.

    U2 = (19) with c in the place of chat, F as of ``robust_adaptive``; no (20)-(24)

The robust control of M. J. Corless and G. Leitmann, "Continuous state feedback guaranteeing uniform ultimate
boundedness for uncertain dynamic systems", IEEE Trans. Automatic Control 26 (1981), which (19) adapts. Its gains are
``kinds.baselines.RobustFixed``.
"""

from __future__ import annotations

from coopmm_jax.control import motion
from coopmm_jax.control.controller import Command, Seen
from coopmm_jax.control.filtered_error import FilterState, filtered, force_feedback, start, state_rates
from coopmm_jax.control.robust_adaptive import robust_term
from coopmm_jax.kinds.baselines import RobustFixed

__all__ = ["command", "force_feedback", "start"]


def command(gains: RobustFixed, seen: Seen, state: FilterState) -> Command:
    """Generalised force F on all joints with L^T F = U1 + U2, (18) and (19)."""
    structure, model, _, k, _ = seen
    now = filtered(gains, seen, state.integral, state.eta)
    U2, _ = robust_term(gains, seen, now, gains.c)
    force = motion.on_all_joints(structure, k.reduction, motion.nominal_force(model, k, now.acceleration), U2)
    return Command(force, state_rates(now), {"sigma": now.sigma, "robust_force": U2})
