"""Computed torque on the nominal model: PD on the joints' positions, PI on the forces.

    acceleration = rdot - K_d (u^1 - r) - K_p p          with p and r of ``joint_errors``
    F as of ``model_based``

so that pddot + K_d pdot + K_p p = 0 where the nominal model and the heading are right. B. Siciliano, L. Sciavicco,
L. Villani and G. Oriolo, Robotics (2009), section 8.5.2 on inverse dynamics control. Its gains are
``kinds.baselines.ComputedTorque``.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.control import motion
from coopmm_jax.control.controller import Command, Freedom, Seen
from coopmm_jax.control.filtered_error import force_feedback
from coopmm_jax.control.joint_errors import joint_errors
from coopmm_jax.kinds.baselines import ComputedTorque

__all__ = ["command", "force_feedback", "start"]


class ForceState(NamedTuple):
    """State of the controller; also used for its rates."""

    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


def start(gains: ComputedTorque, freedom: Freedom, zero: Scalar) -> ForceState:
    """State at the start, zero.

    Args:
        gains: of the controller.
        freedom: numbers of velocities and rows.
        zero: a scalar of the rollout's dtype.
    """
    del gains
    return ForceState((zero,) * freedom.rows)


def command(gains: ComputedTorque, seen: Seen, state: ForceState) -> Command:
    """Generalised force F on all joints that gives the independent ones their PD's acceleration."""
    del state
    errors = joint_errors(seen)
    acceleration = tuple(
        rate - K_d * velocity - K_p * position
        for rate, K_d, velocity, K_p, position in zip(
            errors.reference_rate, gains.K_d, errors.velocity, gains.K_p, errors.position, strict=True
        )
    )
    force = motion.as_accelerated(seen.structure, seen.model, seen.k, acceleration)
    return Command(force, ForceState, {"position_error": errors.position, "velocity_error": errors.velocity})
