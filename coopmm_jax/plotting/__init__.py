"""Figures of trajectories: each function takes one or several, accepts ``axes`` and returns the matplotlib figure.

    import coopmm_jax as cm
    from coopmm_jax import plotting

    figure = plotting.contact_force(cm.simulate(cm.load_scenario("paper")))

In a notebook the figure shows itself; ``plotting.save(figure, "force.png")`` writes it.
"""

from __future__ import annotations

from coopmm_jax.plotting.control import adaptation, filtered_error, torques
from coopmm_jax.plotting.force import constraint_forces, constraint_residual, contact_force
from coopmm_jax.plotting.motion import arm_angles, chained_errors, platform_angle, platform_paths
from coopmm_jax.plotting.overview import overview
from coopmm_jax.plotting.series import series
from coopmm_jax.plotting.style import caption, save

__all__ = [
    "adaptation",
    "arm_angles",
    "caption",
    "chained_errors",
    "constraint_forces",
    "constraint_residual",
    "contact_force",
    "filtered_error",
    "overview",
    "platform_angle",
    "platform_paths",
    "save",
    "series",
    "torques",
]
